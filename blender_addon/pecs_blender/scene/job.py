# SPDX-License-Identifier: GPL-3.0-or-later
"""One render job: a scene, a lens, bands and instants in; an EXR stack (docs/exr_stack.md) out.

Film irradiance is a ratio estimate. Cycles averages w L over the rays of a pixel, where the lens's weights w scatter
(lost rays, one band per ray). Their average over the very same rays is known from a white furnace rendered once per
pass, and its expectation from the exact pupil (relative illumination RI). So E = E0 RI <w L> / <w>: what scatters is
the scene's radiance alone. (Seed and samples are fixed, so frames and furnace share their rays.)

Radiance in Cycles is relative so that values are O(1): in band k every lamp is divided by the strongest lamp's value
n_k there (core/light.py). Absolute radiance = rendered * n_k * s, where s is the scene's (Source.radiance_per_unit).
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import bpy  # before pecs: both carry libtbb.so.12
import numpy as np
import pecs

from ..core.chip import chip_threshold
from ..core.errors import USAGE, RenderError, bad_input
from ..core.plan import passes, timeline
from ..core.progress import Progress
from ..core.resources import Restart, check_disk, resident_mb
from ..core.spectra import spectrum
from . import cycles
from .source import Source
from .spectral import SpectralScene

PILOT_SAMPLES = 8
FILM_WIDTH_MM = 6.2208  # IMX636: 1280 pixels of 4.86 um


@dataclass(frozen=True)
class Options:
    bands: int = 6
    placement: str = "gauss"
    chip: str = "imx636"
    min_nm: float | None = None  # None: where chip and lamps begin and end
    max_nm: float | None = None
    illuminant: str = "d65"  # of RGB lamps and skies
    light_scale: float = 1.0
    fps: float = 10000.0
    frames: str = "100"
    moving_px: tuple[int, int, int, int] | None = None  # left, top, right, bottom: nothing changes elsewhere
    only: slice | None = None  # the frames of the plan that this run renders
    width: int | None = None  # None: the scene's
    height: int | None = None
    film_width_mm: float = FILM_WIDTH_MM
    film_shift_mm: Sequence[float] = (0.0, 0.0)  # of the film's centre off the lens' axis, in lens axes x, y
    film_tilt_deg: Sequence[float] = (0.0, 0.0)  # about its x axis, then the lens' y axis
    samples: int = 8
    noise_target: float | None = None  # then samples are chosen
    denoise: bool = False
    device: str = "CPU"
    seed: int = 1
    lens: str | None = None  # None: the scene's; "none": a pinhole of focal_mm, or the .blend's own camera
    stop_diameter_mm: float | None = None  # None: the scene's
    fnumber: float | None = None  # instead of a diameter
    focus_m: float | None = None
    focal_mm: float = 15.02
    colour_tolerance_px: float = 0.1  # bands of a pass that lie closer on the film share their rays
    bands_per_pass: int = 3
    threads: int = 0  # 0: all; does not change the result
    restart_growth_mb: float = 1000.0  # growth of resident memory at which the process starts afresh


@dataclass(frozen=True)
class Lens:
    """A lens as this job uses it."""

    lens: pecs.Lens
    setting: dict
    film: dict  # its shift and tilt


def render(source: Source, folder: Path, options: Options) -> None:
    width, height = _size(source, options)
    if moving := options.moving_px:
        if not (0 <= moving[0] < moving[2] <= width and 0 <= moving[1] < moving[3] <= height):
            raise RenderError(USAGE, f"--moving-px: got {moving}, wanted a part of {width} x {height} pixels")
    illuminant = spectrum(options.illuminant, source.folder)
    devices = cycles.device_names(options.device)
    sampling = cycles.Sampling(
        options.samples, options.seed, source.bounces, options.threads, options.device, options.denoise
    )
    cycles.configure(source.scene, width, height, sampling)
    plan = timeline(options.frames, options.fps, source.period_s, source.duration_s)
    spectral = SpectralScene(illuminant, source.folder)
    lamps = spectral.emitters.mean_pairs()
    bands = pecs.bands(options.chip, options.bands, options.placement, lamps, options.min_nm, options.max_nm)
    lambda_nm = np.array([b["lambda_nm"] for b in bands])
    slices = passes(len(bands), options.bands_per_pass)
    check_disk(folder, len(plan.times_ns[options.only or slice(None)]) * len(bands) * width * height)

    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch, cycles.Film(source.scene) as film:
        source.set_time(0.0)
        scale = source.radiance_per_unit(spectral) * options.light_scale
        lens = _lens(source, options, width, height)
        if lens:
            cameras, e0, record, blurs = _lens_cameras(lens, options, lambda_nm, slices, width, Path(scratch))
        else:
            cameras = [source.camera(options.focal_mm, options.film_width_mm)] * len(slices)
            e0, record, blurs = 1.0, None, []
        to_film = spectral.emitters.norm(lambda_nm) * scale * e0
        job = _Job(
            source, film, spectral, lens, cameras, slices, lambda_nm, to_film, blurs, record, (width, height), moving
        )
        samples = _samples(job, sampling, bands, options) if options.noise_target else options.samples
        job.sample(replace(sampling, samples=samples))
        stack = {
            "pecs_stack": 1,
            "quantity": "irradiance" if lens else "radiance",
            "width": width,
            "height": height,
            "pixel_pitch_m": options.film_width_mm * 1e-3 / width,
            "bands": bands,
            "times_ns": plan.times_ns,
            "period_ns": plan.period_ns,
            "lens": record,
            "scene": source.record,
            "render": _settings(options, source, scale, spectral) | {"samples": samples, "device": ", ".join(devices)},
            "versions": {"pecs": pecs.__version__, "blender": bpy.app.version_string},
        }
        with pecs.StackWriter(folder, stack) as writer:
            _render_frames(job, plan.times_ns, writer, options)


@dataclass
class _Job:
    source: Source
    film: cycles.Film
    spectral: SpectralScene
    lens: Lens | None
    cameras: list
    slices: list[slice]
    lambda_nm: np.ndarray
    unit: np.ndarray  # per band: film irradiance (or radiance) of a rendered 1
    blurs: list
    record: dict | None  # the lens, for stack.json
    size: tuple[int, int]  # pixels
    moving_px: tuple[int, int, int, int] | None = None

    def sample(self, sampling: cycles.Sampling) -> None:
        """Chooses samples and seed, and renders the white furnace with them."""
        rays = sampling.samples
        if self.record and self.record["channel_mode"] == "per_channel":
            rays *= 3  # so that every band gets its samples
        self.source.scene.cycles.samples, self.source.scene.cycles.seed = rays, sampling.seed
        self.to_film = self.unit[:, None, None]
        if self.lens and not any(
            value for key, value in self.lens.film.items() if "tilt" in key
        ):  # tables of flat films
            self.to_film = self.to_film * _even_out(self, replace(sampling, samples=rays))
        self.to_film = self.to_film.astype(np.float32)
        if self.moving_px:
            cycles.set_border(self.source.scene, None)
            self.set_time(0.0)
            self.still = np.empty((len(self.lambda_nm), *self.size[::-1]), np.float32)
            self._passes(self.still)
            cycles.set_border(self.source.scene, self.moving_px)

    def set_time(self, t_s: float) -> None:
        self.spectral.before_instant()
        self.source.set_time(t_s)
        self.spectral.after_instant()
        if self.lens:
            self.source.place(self.cameras)

    def frame(self, out: np.ndarray) -> None:
        """Renders the instant into out [bands, height, width]."""
        self._passes(out)
        if self.moving_px:
            left, top, right, bottom = self.moving_px
            fresh = out[:, top:bottom, left:right].copy()
            out[:] = self.still
            out[:, top:bottom, left:right] = fresh
        out *= self.to_film
        for picture, blur in zip(out, self.blurs, strict=False):  # none without diffraction
            blur(picture)

    def _passes(self, out: np.ndarray) -> None:
        for camera, bands in zip(self.cameras, self.slices, strict=True):
            if self.lens:
                self.source.scene.camera = camera
            self.spectral.set_pass(_rgb_nm(self.lambda_nm[bands]))
            out[bands] = self.film.render()[: bands.stop - bands.start]


def _rgb_nm(lambda_nm: np.ndarray) -> np.ndarray:
    """A short pass repeats its last wavelength."""
    return np.pad(lambda_nm, (0, 3 - len(lambda_nm)), mode="edge")


def _render_frames(job: _Job, times_ns, writer, options) -> None:
    wanted = range(len(times_ns))[options.only or slice(None)]
    missing = [i for i in wanted if not writer.has_frame(i)]
    progress = Progress("render", len(wanted), len(wanted) - len(missing))
    frame, first_mb = np.empty(writer.shape, np.float32), None
    for done, index in enumerate(missing, len(wanted) - len(missing) + 1):
        job.set_time(times_ns[index] * 1e-9)
        job.frame(frame)
        writer.write_frame(index, frame)
        progress.at(done)
        first_mb = first_mb or resident_mb()
        if resident_mb() > first_mb + options.restart_growth_mb and index != missing[-1]:
            raise Restart


def _size(source: Source, options: Options) -> tuple[int, int]:
    """Pixels; a width alone keeps the scene's shape."""
    width, height = source.size
    if options.width:
        width, height = options.width, options.height or round(options.width * height / width)
    elif options.height:
        width, height = round(options.height * width / height), options.height
    return width, height


def _lens(source: Source, options: Options, width: int, height: int) -> Lens | None:
    name = options.lens or source.lens["lens"]
    if name == "none":
        return None
    beside = source.folder / name
    setting = {
        "focus_m": options.focus_m or source.lens["focus_m"],
        "stop_diameter_mm": None if options.fnumber else options.stop_diameter_mm or source.lens["stop_diameter_mm"],
        "fnumber": options.fnumber,
        "film_width_mm": options.film_width_mm,
        "film_height_mm": options.film_width_mm * height / width,
    }
    film = {}
    for key, values in (("film_shift_{}_mm", options.film_shift_mm), ("film_tilt_{}_deg", options.film_tilt_deg)):
        film |= {key.format(axis): value for axis, value in zip("xy", values, strict=True)}
    return Lens(pecs.Lens(name if "/" in name or not beside.is_file() else beside), setting, film)


def _lens_cameras(lens: Lens, options, lambda_nm, slices, width, scratch):
    """One camera per pass, film irradiance per radiance and band, what stack.json says of the lens, and each band's
    diffraction."""
    cameras, e0, modes, described, blurs, working = [], [], set(), None, [], []
    diffraction, colour_shift_px = False, 0.0
    for k, bands in enumerate(slices):
        camera = lens.lens.camera(
            bands_nm=lambda_nm[bands].tolist(),
            focus_bands_nm=lambda_nm.tolist(),
            colour_tolerance_px=options.colour_tolerance_px,
            **lens.setting,
            **lens.film,
            pixel_pitch_mm=options.film_width_mm / width,
        )
        cameras.append(cycles.lens_camera(f"{camera.shader_name}_{k}", camera.osl, scratch))
        e0 += camera.e0[: bands.stop - bands.start]
        modes.add(camera.channel_mode)
        colour_shift_px = max(colour_shift_px, camera.colour_shift_px)
        for band in range(bands.stop - bands.start):
            working.append(camera.working_fnumber[band])
            blurs.append(partial(camera.diffract, band=band))
        diffraction = diffraction or camera.diffraction
        described = camera
    keys = ["file", "sha256", "focus_m", "stop_diameter_mm", "fnumber", "film_z_mm"]
    keys += [key for key, value in lens.film.items() if value]
    record = {key: getattr(described, key) for key in keys}
    record["channel_mode"] = "per_channel" if "per_channel" in modes else "mean"
    record["colour_shift_px"] = float(f"{colour_shift_px:.3g}")
    record["file"] = Path(record["file"]).name
    record |= {"diffraction": diffraction, "working_fnumber": working}
    return cameras, np.array(e0), {"name": described.lens_name, **record, "e0": e0}, blurs if diffraction else []


def _even_out(job: _Job, sampling: cycles.Sampling) -> np.ndarray:
    """RI / <w> for each band and pixel, see above."""
    (width, height), lens, lambda_nm = job.size, job.lens, job.lambda_nm
    scene = cycles.white_furnace()
    cycles.configure(scene, width, height, sampling)
    gain = np.empty((len(lambda_nm), height, width))
    pitch_mm = lens.setting["film_width_mm"] / width
    x_mm = lens.film["film_shift_x_mm"] - (np.arange(width) + 0.5 - width / 2) * pitch_mm  # the picture is upside down
    y_mm = lens.film["film_shift_y_mm"] + (np.arange(height) + 0.5 - height / 2) * pitch_mm
    radius_mm = np.hypot(x_mm[None, :], y_mm[:, None])
    with cycles.Film(scene) as film:
        for camera, bands in zip(job.cameras, job.slices, strict=True):
            scene.camera = camera
            gain[bands] = film.render()[: bands.stop - bands.start]
            for k in range(bands.start, bands.stop):
                if not gain[k].all():
                    raise bad_input(
                        "render", "--samples", sampling.samples, "more: in some pixels no ray gets through the lens"
                    )
                pupil = lens.lens.pupil(lambda_nm=float(lambda_nm[k]), **lens.setting)["pupil"]
                illumination = np.array([(p["r_mm"], p["relative_illumination"]) for p in pupil])
                gain[k] = np.interp(radius_mm, illumination[:, 0], illumination[:, 1]) / gain[k]
    bpy.data.scenes.remove(scene)
    return gain


def _samples(job: _Job, sampling: cycles.Sampling, bands: list[dict], options: Options) -> int:
    """Samples for a noise of ln(light) of noise_target contrast thresholds, from two pilot frames with other seeds; the
    variance falls as 1/samples. The next power of two, so that another machine's rounding chooses the same."""
    weight = np.array([band["weight_nm"] * band["lambda_nm"] for band in bands])
    frame = np.empty((len(bands), *job.size[::-1]), np.float32)
    pilots = []
    for seed in (sampling.seed + 1, sampling.seed + 2):
        job.sample(replace(sampling, samples=PILOT_SAMPLES, seed=seed))
        job.set_time(0.0)
        job.frame(frame)
        pilots.append(np.einsum("k,kyx->yx", weight, frame))
    lit = (pilots[0] > 0) & (pilots[1] > 0)
    difference = np.log(pilots[1][lit] / pilots[0][lit])
    variance = float(np.mean(difference**2)) / 2 if difference.size else 0.0
    wanted = (options.noise_target * chip_threshold(options.chip)) ** 2
    return int(2 ** np.clip(np.ceil(np.log2(max(PILOT_SAMPLES * variance / wanted, 1))), 0, 16))


def _settings(options: Options, source: Source, scale: float, spectral: SpectralScene) -> dict:
    """What decides the picture; threads do not."""
    chosen = asdict(options)
    for key in ("threads", "frames", "bands", "width", "height", "only", "restart_growth_mb"):
        del chosen[key]
    return {
        **chosen,
        "emitters": [s.name for s in spectral.emitters.spectra],
        "radiance_per_relative_power": scale,
        "approximated": spectral.approximated,
        "cycles": cycles.SETTINGS | source.bounces,
    }
