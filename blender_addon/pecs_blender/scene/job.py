# SPDX-License-Identifier: GPL-3.0-or-later
"""One render job: a scene, a lens, bands and instants in; an EXR stack (docs/exr_stack.md) out.

Film irradiance is a ratio estimate. Cycles averages w L over the rays of a pixel, where the lens's weights w scatter
(lost rays, one band per ray). Their average over the very same rays is known from a white furnace rendered once per
pass, and its expectation from the exact pupil (relative illumination RI). So E = E0 RI <w L> / <w>: what scatters is
the scene's radiance alone. (Seed and samples are fixed, so frames and furnace share their rays.)

Radiance in Cycles is relative so that values are O(1): in band k every lamp is divided by the strongest lamp's value
n_k there. Absolute radiance = rendered * n_k * s, where s makes the illuminance at the scene's target what the scene
asks for (light meter, below).
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import bpy  # before pecs: both carry libtbb.so.12
import numpy as np
import pecs

from ..core.errors import bad_input
from ..core.plan import passes, timeline
from ..core.progress import Progress
from ..core.scene_file import SceneFile
from ..core.spectra import constant, illuminance_lux
from . import build, cycles

FILM_WIDTH_MM, FILM_HEIGHT_MM = 6.2208, 3.4992  # IMX636: 1280 x 720 pixels of 4.86 um
LOOK_ALONG_Y = (math.pi / 2, 0.0, 0.0)
METER_LAMBDA_NM = (450.0, 550.0, 650.0)
METER_REFLECTANCE = 0.5
METER_SAMPLES = 4096


@dataclass(frozen=True)
class Options:
    bands: int = 6
    placement: str = "gauss"
    chip: str = "imx636"
    fps: float = 10000.0
    frames: str = "100"
    width: int = 1280
    height: int = 720
    samples: int = 8
    seed: int = 1
    lens: str | None = None  # None: the scene's; "none": a pinhole of focal_mm
    stop_diameter_mm: float | None = None  # None: the scene's
    focus_m: float | None = None
    focal_mm: float = 15.02
    colour_tolerance_px: float = 0.1  # bands of a pass that lie closer on the film share their rays
    threads: int = 0  # 0: all; does not change the result


def render(scene_file: SceneFile, folder: Path, options: Options) -> None:
    if abs(options.width / options.height - FILM_WIDTH_MM / FILM_HEIGHT_MM) > 1e-2:
        raise bad_input("render", "--width --height", f"{options.width}x{options.height}", "16:9, the film's shape")
    scene = cycles.empty_scene()
    parts = scene_file.build()
    cycles.configure(scene, options.width, options.height, options.samples, options.seed, options.threads)
    plan = timeline(options.frames, options.fps, parts.period_s)
    illuminant = next((pairs for lamp in parts.lamps if (pairs := lamp.spectrum.pairs())), None)
    bands = pecs.bands(options.chip, options.bands, options.placement, illuminant if len(parts.lamps) == 1 else None)
    lambda_nm = np.array([b["lambda_nm"] for b in bands])

    film = cycles.Film(scene)
    try:
        parts.pose(0.0)
        lux_scale = _light_meter(scene, film, parts)
        with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
            cameras, e0, lens, blurs = _cameras(scene_file, options, lambda_nm, Path(scratch))
            rays = _rays(options, lens)
            scene.cycles.samples = rays
            to_film = (_norm(parts, lambda_nm) * lux_scale * e0)[:, None, None]
            if lens:
                to_film = to_film * _even_out(scene_file, options, cameras, lambda_nm, rays)
            stack = {
                "pecs_stack": 1,
                "quantity": "irradiance" if lens else "radiance",
                "width": options.width,
                "height": options.height,
                "pixel_pitch_m": FILM_WIDTH_MM * 1e-3 / options.width,
                "bands": bands,
                "times_ns": plan.times_ns,
                "period_ns": plan.period_ns,
                "lens": lens,
                "scene": {"name": scene_file.name, "parameters": scene_file.parameters},
                "render": _settings(options, lux_scale, parts.illuminance_lux),
                "versions": {"pecs": pecs.__version__, "blender": bpy.app.version_string},
            }
            with pecs.StackWriter(folder, stack) as writer:
                to_film = to_film.astype(np.float32)
                _render_frames(scene, film, parts, cameras, plan.times_ns, lambda_nm, to_film, blurs, writer)
    finally:
        film.close()


def _render_frames(scene, film, parts, cameras, times_ns, lambda_nm, to_film, blurs, writer) -> None:
    missing = [i for i in range(len(times_ns)) if not writer.has_frame(i)]
    progress = Progress("render", len(times_ns), len(times_ns) - len(missing))
    frame = np.empty(writer.shape, np.float32)
    for done, index in enumerate(missing, len(times_ns) - len(missing) + 1):
        parts.pose(times_ns[index] * 1e-9)
        for camera, bands in zip(cameras, passes(len(lambda_nm)), strict=True):
            scene.camera = camera
            _set_pass(parts, lambda_nm[bands])
            frame[bands] = film.render()[: bands.stop - bands.start]
        frame *= to_film
        for picture, blur in zip(frame, blurs, strict=False):  # none without diffraction
            blur(picture)
        writer.write_frame(index, frame)
        progress.at(done)


def _set_pass(parts: build.SceneParts, lambda_nm: np.ndarray) -> None:
    """Every material and lamp takes its values at the pass's wavelengths; a short pass repeats its last one."""
    rgb_nm = np.pad(lambda_nm, (0, 3 - len(lambda_nm)), mode="edge")
    norm = _norm(parts, rgb_nm)
    for material in parts.materials:
        material.set_pass(material.spectrum(rgb_nm))
    for lamp in parts.lamps:
        lamp.set_pass(np.divide(lamp.spectrum(rgb_nm), norm, out=np.zeros(3), where=norm > 0))


def _norm(parts: build.SceneParts, lambda_nm: np.ndarray) -> np.ndarray:
    """n_k: the strongest lamp's relative spectral power."""
    return np.max([lamp.spectrum(lambda_nm) for lamp in parts.lamps], axis=0)


def _light_meter(scene, film, parts) -> float:
    """Radiance per unit lamp that gives the scene's illuminance: a small grey card at the target is rendered close up,
    so light from the walls counts; its irradiance per n_k is smooth over the wavelength and interpolated."""
    (x, y, z), (nx, ny, nz) = parts.target
    size_m, gap_m = 0.01, 0.002
    card = build.diffuse("light meter", constant(METER_REFLECTANCE))
    camera = cycles.orthographic_camera("light meter", size_m / 2)
    camera.location = (x + 0.05 * nx, y + 0.05 * ny, z + 0.05 * nz)
    if (nx, ny, nz) != (0.0, -1.0, 0.0):
        raise bad_input("scene.py", "target", (nx, ny, nz), "a normal towards the camera, (0, -1, 0)")
    camera.rotation_euler = LOOK_ALONG_Y
    h = size_m / 2
    corners = [(x + sx * h, y - gap_m, z + sz * h) for sx, sz in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    plane = build.mesh_object("light meter card", corners, [(0, 1, 2, 3)], [card.material])

    saved = scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.cycles.samples = METER_SAMPLES // 64
    scene.camera = camera
    meter_nm = np.array(METER_LAMBDA_NM)
    _set_pass(parts, meter_nm)
    card.set_pass([METER_REFLECTANCE] * 3)
    # Lambert: E = pi L / reflectance
    irradiance = math.pi / METER_REFLECTANCE * film.render().astype(float).mean(axis=(1, 2))
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = saved
    for thing in (camera, plane):
        bpy.data.objects.remove(thing, do_unlink=True)

    lux = illuminance_lux(lambda nm: np.interp(nm, meter_nm, irradiance), lambda nm: _norm(parts, nm))
    # Rounded, so that a job continued on another machine finds the same number.
    return float(f"{parts.illuminance_lux / lux:.4g}")


def _cameras(scene_file, options, lambda_nm, scratch):
    """One camera per pass, film irradiance per radiance and band, and what stack.json says of the lens."""
    name = options.lens or scene_file.camera["lens"]
    if name == "none":
        camera = cycles.pinhole_camera("pinhole", options.focal_mm, FILM_WIDTH_MM)
        camera.rotation_euler = LOOK_ALONG_Y
        return [camera] * len(passes(len(lambda_nm))), np.ones(len(lambda_nm)), None, []
    lens = _lens(scene_file, options)
    cameras, e0, modes, described, blurs, working = [], [], set(), None, [], []
    diffraction = False
    for k, bands in enumerate(passes(len(lambda_nm))):
        camera = lens.camera(
            bands_nm=lambda_nm[bands].tolist(),
            focus_bands_nm=lambda_nm.tolist(),
            colour_tolerance_px=options.colour_tolerance_px,
            **_lens_setting(scene_file, options),
            pixel_pitch_mm=FILM_WIDTH_MM / options.width,
        )
        cameras.append(cycles.lens_camera(f"{camera.shader_name}_{k}", camera.osl, scratch))
        cameras[-1].rotation_euler = LOOK_ALONG_Y
        e0 += camera.e0[: bands.stop - bands.start]
        modes.add(camera.channel_mode)
        for band in range(bands.stop - bands.start):
            working.append(camera.working_fnumber[band])
            blurs.append(partial(camera.diffract, band=band))
        diffraction = diffraction or camera.diffraction
        described = camera
    keys = ("file", "sha256", "focus_m", "stop_diameter_mm", "fnumber", "film_z_mm")
    record = {key: getattr(described, key) for key in keys}
    record["channel_mode"] = "per_channel" if "per_channel" in modes else "mean"
    record["file"] = Path(record["file"]).name
    record |= {"diffraction": diffraction, "working_fnumber": working}
    return cameras, np.array(e0), {"name": described.lens_name, **record, "e0": e0}, blurs if diffraction else []


def _lens(scene_file, options) -> pecs.Lens:
    name = options.lens or scene_file.camera["lens"]
    return pecs.Lens(name if "/" in name or not (scene_file.folder / name).is_file() else scene_file.folder / name)


def _lens_setting(scene_file, options) -> dict:
    return {
        "focus_m": options.focus_m or scene_file.camera["focus_m"],
        "stop_diameter_mm": options.stop_diameter_mm or scene_file.camera["stop_diameter_mm"],
        "film_width_mm": FILM_WIDTH_MM,
        "film_height_mm": FILM_HEIGHT_MM,
    }


def _rays(options: Options, lens: dict | None) -> int:
    """Per pixel and pass, so that every band gets options.samples."""
    return options.samples * (3 if lens and lens["channel_mode"] == "per_channel" else 1)


def _even_out(scene_file, options, cameras, lambda_nm, rays) -> np.ndarray:
    """RI / <w> for each band and pixel, see above."""
    lens, setting = _lens(scene_file, options), _lens_setting(scene_file, options)
    scene = cycles.white_furnace()
    cycles.configure(scene, options.width, options.height, rays, options.seed, options.threads)
    film = cycles.Film(scene)
    gain = np.empty((len(lambda_nm), options.height, options.width))
    pitch_mm = FILM_WIDTH_MM / options.width
    x_mm = (np.arange(options.width) + 0.5) * pitch_mm - FILM_WIDTH_MM / 2
    y_mm = (np.arange(options.height) + 0.5) * pitch_mm - FILM_HEIGHT_MM / 2
    radius_mm = np.hypot(x_mm[None, :], y_mm[:, None])
    try:
        for camera, bands in zip(cameras, passes(len(lambda_nm)), strict=True):
            scene.camera = camera
            gain[bands] = film.render()[: bands.stop - bands.start]
            for k in range(bands.start, bands.stop):
                if not gain[k].all():
                    raise bad_input(
                        "render", "--samples", options.samples, "more: in some pixels no ray gets through the lens"
                    )
                pupil = lens.pupil(lambda_nm=float(lambda_nm[k]), **setting)["pupil"]
                illumination = np.array([(p["r_mm"], p["relative_illumination"]) for p in pupil])
                gain[k] = np.interp(radius_mm, illumination[:, 0], illumination[:, 1]) / gain[k]
    finally:
        film.close()
    return gain


def _settings(options: Options, lux_scale: float, illuminance_lux: float) -> dict:
    """What decides the picture; threads do not."""
    chosen = asdict(options)
    for key in ("threads", "frames", "bands", "width", "height"):
        del chosen[key]
    return {
        **chosen,
        "device": "CPU",
        "illuminance_lux": illuminance_lux,
        "radiance_per_relative_power": lux_scale,
        "cycles": cycles.SETTINGS,
    }
