# SPDX-License-Identifier: GPL-3.0-or-later
"""The lens of a render: one camera per pass, and the normalisation of their light.

Film irradiance is a ratio estimate. Cycles averages w L over the rays of a pixel, where the lens's weights w scatter
(lost rays, one band per ray). Their average over the very same rays is known from a white furnace rendered once per
pass, and its expectation from the exact pupil (relative illumination RI). So E = E0 RI <w L> / <w>: what scatters is
the scene's radiance alone. (Seed and samples are fixed, so frames and furnace share their rays.)
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import bpy
import numpy as np
import pecs
from pecs._arguments import flag
from pecs._errors import ExitCode, PecsError, UsageError

from ..scene import cycles
from ..scene.cycles import Sampling
from ..scene.source import Source
from ..spectral.bands import BandSet, Chosen, passes
from .plan import View

COLOUR_TOLERANCE_PX = 0.1  # shift of edges up to which the bands of a pass share their rays


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens with its settings and film, as arguments of pecs.Lens."""

    lens: pecs.Lens
    setting: dict  # focus and stop
    film_mm: tuple[float, float]
    shift_mm: tuple[float, float]
    tilt_deg: tuple[float, float]
    pixel_pitch_mm: float
    focus_bands_nm: tuple[float, ...]  # empty: all bands

    def focus_bands(self, lambda_nm: np.ndarray) -> list[float]:
        return list(self.focus_bands_nm) or lambda_nm.tolist()

    @property
    def film(self) -> dict:
        """Shift and tilt, named as in stack.json."""
        named = (("film_shift_{}_mm", self.shift_mm), ("film_tilt_{}_deg", self.tilt_deg))
        return {name.format(axis): v for name, values in named for axis, v in zip("xy", values, strict=True)}

    @property
    def frame(self) -> dict:
        return dict(zip(("film_width_mm", "film_height_mm"), self.film_mm, strict=True))


@dataclass(frozen=True)
class Pass:
    """One RGB render of up to three bands. camera: of a lens; None: the scene's own (Stage.camera_of). blurs: of each
    band's picture, by diffraction."""

    bands: slice
    channels: BandSet  # of red, green and blue; a pass of fewer bands repeats its last
    camera: bpy.types.Object | None
    blurs: tuple = ()  # none without diffraction


@dataclass(frozen=True)
class Cameras:
    """e0: film irradiance per radiance in each band of a lens. record: of a lens, for stack.json. rays_per_sample: 3 if
    only one band of a pass gets light from a ray."""

    passes: tuple[Pass, ...]
    e0: np.ndarray | float = 1.0
    record: dict | None = None
    rays_per_sample: int = 1


def choose(source: Source, view: View) -> Lens | None:
    """None: the scene's own camera. A stop beyond the lens's widest is an error if an option asks for it; one from
    scene.json is clamped."""
    name = view.lens or source.lens["lens"]
    if name == "none":
        return None
    beside = source.folder / name
    lens = pecs.Lens(name if "/" in name or not beside.is_file() else beside)
    stop_mm = view.stop_diameter_mm
    if view.fnumber:
        _check_stop(lens, name, "fnumber", view.fnumber)
    elif stop_mm:
        _check_stop(lens, name, "stop_diameter_mm", stop_mm)
    elif own_mm := source.lens["stop_diameter_mm"]:
        stop_mm = min(own_mm, lens.info(field_rows=2)["stop_diameter_mm"])
    focus_m = view.focus_m or source.lens["focus_m"]
    width, height = view.size
    return Lens(
        lens=lens,
        setting={"focus_m": focus_m, "stop_diameter_mm": stop_mm, "fnumber": view.fnumber},
        film_mm=(view.film_width_mm, view.film_width_mm * height / width),
        shift_mm=view.film_shift_mm,
        tilt_deg=view.film_tilt_deg,
        pixel_pitch_mm=view.film_width_mm / width,
        focus_bands_nm=view.focus_bands_nm,
    )


def _check_stop(lens: pecs.Lens, name: str, option: str, value: float) -> None:
    try:
        lens.info(field_rows=2, **{option: value})
    except pecs.PecsInputError:
        widest = lens.info(field_rows=2)[option]
        limit = f"at least f/{widest:.4g}" if option == "fnumber" else f"at most {widest:.4g}mm"
        raise UsageError(f"{flag(option)}: got {value:g}, wanted {limit}, where {name} is wide open") from None


def own_camera(band_set: BandSet, per_pass: int) -> Cameras:
    """Passes through the scene's own camera."""
    slices = passes(len(band_set.lambda_nm), per_pass)
    return Cameras(tuple(Pass(bands, band_set.of_pass(bands), None) for bands in slices))


def cameras(lens: Lens, chosen: Chosen, view: View, per_pass: int, unit_m: float, scratch: Path) -> Cameras:
    band_set, lambda_nm = chosen.bands, chosen.bands.lambda_nm
    slices = passes(len(lambda_nm), per_pass)
    made = [
        lens.lens.camera(
            bands_nm=lambda_nm[bands].tolist(),
            focus_bands_nm=lens.focus_bands(lambda_nm),
            colour_tolerance_px=COLOUR_TOLERANCE_PX * view.subpixels,
            **chosen.shares(bands),
            **lens.setting,
            **lens.frame,
            **lens.film,
            pixel_pitch_mm=lens.pixel_pitch_mm,
            unit_m=unit_m,
        )
        for bands in slices
    ]
    diffraction = any(camera.diffraction for camera in made)
    rendered, e0, working = [], [], []
    for k, (bands, camera) in enumerate(zip(slices, made, strict=True)):
        count = bands.stop - bands.start
        thing = osl_camera(f"{camera.shader_name}_{k}", camera.osl, scratch)
        blurs = tuple(partial(camera.diffract, band=band) for band in range(count)) if diffraction else ()
        rendered.append(Pass(bands, band_set.of_pass(bands), thing, blurs))
        e0 += camera.e0[:count]
        working += camera.working_fnumber[:count]
    mode = max((camera.channel_mode for camera in made), key=("mean", "mixed", "per_channel").index)
    last = made[-1]
    keys = ["sha256", "focus_m", "stop_diameter_mm", "fnumber", "film_z_mm", *(k for k, v in lens.film.items() if v)]
    record = {
        "name": last.lens_name,
        "file": Path(last.file).name,
        **{key: getattr(last, key) for key in keys},
        "focus_bands_nm": lens.focus_bands(lambda_nm),
        "channel_mode": mode,
        "colour_shift_px": float(f"{max(camera.colour_shift_px for camera in made):.3g}") / view.subpixels,
        "mixed_shift_px": round(max(camera.mixed_shift_px or 0 for camera in made), 3) / view.subpixels,
        "diffraction": diffraction,
        "working_fnumber": working,
        "e0": e0,
    }
    return Cameras(tuple(rendered), np.array(e0), record, 3 if mode == "per_channel" else 1)


def osl_camera(name: str, osl: str, folder: Path) -> bpy.types.Object:
    """A camera whose rays are computed by OSL source (pecs.Lens.camera), which is compiled into `folder`."""
    import _cycles

    if not _cycles.with_osl:
        raise PecsError(
            f"lens: got Blender {bpy.app.version_string} built without OSL, wanted blender.org's or `pip install bpy` "
            "(--lens none renders with the scene's own camera here)",
            ExitCode.UNSUPPORTED,
        )
    source, compiled = folder / f"{name}.osl", folder / f"{name}.oso"
    source.write_bytes(osl.encode())
    with cycles.quiet():
        ok = _cycles.osl_compile(str(source), str(compiled))
    if not ok or not compiled.is_file():
        raise PecsError(
            f"{source}: the lens shader does not compile in Blender {bpy.app.version_string}", ExitCode.UNSUPPORTED
        )
    camera = cycles.new_camera(name)
    camera.data.type = "CUSTOM"
    camera.data.custom_mode = "EXTERNAL"
    with cycles.quiet(), open(os.devnull, "w", encoding="utf-8") as null, contextlib.redirect_stderr(null):
        camera.data.custom_filepath = str(compiled)  # the wheel lacks oslquery: a harmless traceback
    return camera


def even_out(
    lens: Lens, rendered: tuple[Pass, ...], lambda_nm: np.ndarray, size: tuple[int, int], sampling: Sampling
) -> np.ndarray:
    """RI / <w> for each band and pixel, see above; infinite where no ray passes the lens."""
    (width, height), pitch_mm = size, lens.pixel_pitch_mm
    scene = cycles.white_furnace()
    cycles.configure(scene, width, height, sampling)
    gain = np.empty((len(lambda_nm), height, width))
    x_mm = lens.shift_mm[0] - (np.arange(width) + 0.5 - width / 2) * pitch_mm  # the image is upside down
    y_mm = lens.shift_mm[1] + (np.arange(height) + 0.5 - height / 2) * pitch_mm
    radius_mm = np.hypot(x_mm[None, :], y_mm[:, None])
    film = cycles.Film(scene)
    for one in rendered:
        scene.camera = one.camera
        gain[one.bands] = film.render()[: one.bands.stop - one.bands.start]
        for k in range(one.bands.start, one.bands.stop):
            pupil = lens.lens.pupil(lambda_nm=float(lambda_nm[k]), **lens.setting, **lens.frame)["pupil"]
            illumination = np.array([(p["r_mm"], p["relative_illumination"]) for p in pupil])
            with np.errstate(divide="ignore"):
                gain[k] = np.interp(radius_mm, illumination[:, 0], illumination[:, 1]) / gain[k]
    return gain
