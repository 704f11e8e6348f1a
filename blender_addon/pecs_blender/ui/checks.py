# SPDX-License-Identifier: GPL-3.0-or-later
"""Problems that would make a job fail, each with the operator that fixes it if there is one. Fast enough for every
redraw."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import bpy
from pecs._errors import PecsError

from ..camera import denoise
from ..job.options import DEVICES, RULES
from ..job.resources import readable
from ..scene.timeline import MAX_INSTANTS
from ..spectral.spectra import spectrum
from . import disk, library, paths, settings


@dataclass(frozen=True)
class Problem:
    """is_error: the job would fail. fix: operator that fixes the problem."""

    text: str
    is_error: bool = True
    fix: str = ""


def problems(scene) -> list[Problem]:
    """Problems of a render."""
    rendering = (_lens_problems, _light_problems, _output_problems, _device_problems, _denoiser_problems)
    return [one for part in (_scene_problems, _chip_problems, *rendering) for one in part(scene)]


def sensor_problems(scene) -> list[Problem]:
    """Problems of a simulation."""
    if not _chip(scene):
        return list(_chip_problems(scene))
    known = settings.parameters(scene.pecs)
    wrong = [text for one in scene.pecs.sensor.overrides if (text := settings.override_error(one, known))]
    wrong = wrong or [text for text in [settings.sensor_error(scene)] if text]
    events = paths.events(scene)
    frames = settings.frames_path(scene, events)
    if frames and frames != events and disk.is_folder(frames):
        wrong.append(f"{frames}: exists. Rename or delete it, or write an .aedat4 file")
    return [*map(Problem, wrong), *_folder_problems(events.parent)]


def run_problems(scene) -> list[Problem]:
    """Problems of a render and of the simulation after it."""
    return list(dict.fromkeys([*problems(scene), *sensor_problems(scene)]))


def _scene_problems(scene) -> Iterator[Problem]:
    if not scene.camera:
        yield Problem("The scene has no camera", fix="pecs.add_camera")
    elif scene.camera.type != "CAMERA":
        yield Problem(f"{scene.camera.name} is not a camera")
    if scene.frame_end < scene.frame_start:
        yield Problem("The scene's end frame is before its start frame")
    count = settings.frame_count(scene)
    if count > MAX_INSTANTS:
        yield Problem(f"{count:,} frames exceed the maximum of {MAX_INSTANTS:,}. Shorten the range")
    duration = count / scene.pecs.fps * scene.render.fps / scene.render.fps_base
    if duration < 1:
        yield Problem(f"The rendered time is {duration:.2g} of one frame of the scene", False, "pecs.whole_range")
    if _is_still(scene):
        yield Problem("Nothing in the scene is animated, so only noise causes events", False)


_MOVERS = "CLOTH DYNAMIC_PAINT EXPLODE FLUID MESH_SEQUENCE_CACHE MESH_CACHE NODES OCEAN PARTICLE_SYSTEM SOFT_BODY WAVE"


def _is_still(scene) -> bool:
    """Whether no action, driver, simulation or handler changes the scene."""
    handlers = bpy.app.handlers
    if any(one.users for one in bpy.data.actions) or handlers.frame_change_pre or handlers.frame_change_post:
        return False
    if scene.rigidbody_world or any(image.source in ("MOVIE", "SEQUENCE") for image in bpy.data.images):
        return False
    if any(m.type in _MOVERS.split() for thing in scene.objects for m in thing.modifiers):
        return False
    owners = (one for kind in _DRIVEN for one in getattr(bpy.data, kind))
    parts = (
        part for one in owners for part in (one, *(getattr(one, name, None) for name in ("node_tree", "shape_keys")))
    )
    return not any(part.animation_data and part.animation_data.drivers for part in parts if part)


_DRIVEN = "objects", "cameras", "lights", "worlds", "materials", "meshes", "curves", "armatures"


def _chip(scene):
    try:
        return library.chip(scene.pecs.chip)
    except RuntimeError:
        return None


def _chip_problems(scene) -> Iterator[Problem]:
    try:
        chip = library.chip(scene.pecs.chip)
    except RuntimeError as e:
        yield Problem(f"Chip: {e}")
        return
    width, height = settings.size(scene)
    if (chip.width and width > chip.width) or (chip.height and height > chip.height):
        text = f"{width} x {height} pixels exceed the chip's {chip.width} x {chip.height}"
        yield Problem(text, fix="pecs.chip_resolution")


def _lens_problems(scene) -> Iterator[Problem]:
    s = scene.pecs
    if not settings.has_lens(s) or not _chip(scene):
        return
    if s.engine != "cycles":
        yield Problem("The engine EEVEE has no lens. Set Lens to none, or the engine to Cycles")
    try:
        settings.lens_now(scene)
    except RuntimeError as e:
        too_wide = str(e).startswith("f-number")
        yield Problem(f"Lens: {e}", fix="pecs.wide_open" if too_wide else "")
    if not bpy.app.build_options.cycles_osl:
        text = (
            "This Blender was built without OSL and cannot render a lens. Use Blender from blender.org, or set Lens to "
            "none"
        )
        yield Problem(text)
    if s.device not in ("CPU", "OPTIX"):
        yield Problem(f"A lens requires the device CPU or OPTIX; {s.device} is set")


def spare_gpu(scene) -> str:
    """The GPU backend of Cycles' preferences if this render could use it but does not; otherwise empty."""
    addon = bpy.context.preferences.addons.get("cycles")
    named = getattr(addon.preferences, "compute_device_type", "NONE") if addon else "NONE"
    fits = named in DEVICES and (named == "OPTIX" or not settings.has_lens(scene.pecs))
    fits = fits and scene.pecs.engine == "cycles"
    return named if scene.pecs.device == "CPU" and fits else ""


@cache
def _has_device(kind: str) -> bool:
    addon = bpy.context.preferences.addons.get("cycles")
    return not addon or any(one.type == kind for one in addon.preferences.get_devices_for_type(kind))


def _device_problems(scene) -> Iterator[Problem]:
    if scene.pecs.device != "CPU" and not _has_device(scene.pecs.device):
        yield Problem(f"Cycles finds no {scene.pecs.device} device on this computer")
    if device := spare_gpu(scene):
        text = f"Cycles' preferences select {device}, but the render uses the CPU"
        yield Problem(text, False, "pecs.use_gpu")


_has_denoiser = cache(denoise.is_available)


def _denoiser_problems(scene) -> Iterator[Problem]:
    s = scene.pecs
    if s.engine == "cycles" and not s.no_denoise and not _has_denoiser():
        text = "This Blender was built without a denoiser. Use Blender from blender.org, or keep the render noise"
        yield Problem(text, fix="pecs.keep_noise")


def _light_problems(scene) -> Iterator[Problem]:
    s = scene.pecs
    try:
        spectrum(s.illuminant, Path(bpy.data.filepath or ".").absolute().parent)
    except PecsError as e:
        yield Problem(f"Lamp spectrum: {e}")
    if s.min_nm and s.max_nm and s.min_nm >= s.max_nm:
        yield Problem("The minimum wavelength is not below the maximum wavelength")
    if s.moving_px and s.time == "uniform":
        try:
            RULES["moving_px"].parse(s.moving_px)
        except argparse.ArgumentTypeError as e:
            yield Problem(f"Moving region: {e}")


def _output_problems(scene) -> Iterator[Problem]:
    folder = paths.stack(scene)
    if not bpy.data.filepath:
        yield Problem(f"The file is not saved. Outputs go to {paths.events(scene).parent}", False)
    yield from _folder_problems(folder)
    wanted, free = settings.stack_bytes(scene), disk.place(folder).free
    if scene.pecs.time == "uniform" and free is not None and wanted > free:
        yield Problem(f"The stack requires up to {readable(wanted)}; {readable(free)} are free")


def _folder_problems(folder: Path) -> Iterator[Problem]:
    place = disk.place(folder)
    if not place.is_folder:
        yield Problem(f"{place.path}: is a file; choose a folder")
    elif not place.is_writable:
        yield Problem(f"{place.path}: is not writable")
