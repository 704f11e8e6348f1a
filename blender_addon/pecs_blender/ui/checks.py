# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a job before it starts, in words, with the button that mends it where there is one. Quick: buttons
ask at every redraw."""

from __future__ import annotations

import argparse
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..render.errors import RenderError
from ..render.options import DEVICES, RULES
from ..render.plan import MAX_INSTANTS
from ..render.resources import readable
from ..render.spectra import spectrum
from . import library, paths, settings
from .interface import say

NO_FOLDER = "{path}: a file, wanted a folder"


@dataclass(frozen=True)
class Problem:
    """text: translated. is_error: the job would fail. mend: an operator."""

    text: str
    is_error: bool = True
    mend: str = ""


def problems(scene) -> list[Problem]:
    """Of a render."""
    parts = (_of_scene, _of_chip, _of_lens, _of_light, _of_output, _of_device)
    return [one for part in parts for one in part(scene)]


def sensor_problems(scene) -> list[Problem]:
    """Of a simulation."""
    if not _chip(scene):
        return list(_of_chip(scene))
    known = settings.parameters(scene.pecs)
    wrong = [settings.wrong(one, known) for one in scene.pecs.sensor.overrides]
    return [*(Problem(text) for text in wrong if text), *_of_place(paths.events(scene).parent)]


def _of_scene(scene) -> Iterator[Problem]:
    if not scene.camera:
        yield Problem(say("The scene has no camera"))
    elif scene.camera.type != "CAMERA":
        yield Problem(say("{name} is no camera", name=scene.camera.name))
    if scene.frame_end < scene.frame_start:
        yield Problem(say("The scene's frame range ends before it begins"))
    if settings.instants(scene) > MAX_INSTANTS:
        text = "{count:,} instants; at most {most:,}: take a shorter range"
        yield Problem(say(text, count=settings.instants(scene), most=MAX_INSTANTS))


def _chip(scene):
    try:
        return library.chip(scene.pecs.chip)
    except RuntimeError:
        return None


def _of_chip(scene) -> Iterator[Problem]:
    try:
        chip = library.chip(scene.pecs.chip).profile
    except RuntimeError as e:
        yield Problem(say("Chip: {error}", error=e))
        return
    width, height = settings.size(scene)
    if (chip.width and width > chip.width) or (chip.height and height > chip.height):
        text = "{width} x {height} pixels are more than the chip's {most_width} x {most_height}"
        sizes = {"width": width, "height": height, "most_width": chip.width, "most_height": chip.height}
        yield Problem(say(text, **sizes), mend="pecs.chip_resolution")


def _of_lens(scene) -> Iterator[Problem]:
    s = scene.pecs
    if not settings.has_lens(s) or not _chip(scene):
        return
    try:
        settings.lens_now(scene)
    except RuntimeError as e:
        too_wide = str(e).startswith("f-number")
        yield Problem(say("Lens: {error}", error=e), mend="pecs.wide_open" if too_wide else "")
    if not bpy.app.build_options.cycles_osl:
        yield Problem(say("No lens: this Blender has no OSL (that of blender.org has)"))
    if s.device not in ("CPU", "OPTIX"):
        yield Problem(say("A lens needs the device CPU or OPTIX, not {device}", device=s.device))


def spare_gpu(scene) -> str:
    """The device that Cycles' own preferences name, where this render would leave it idle; nothing if it would not."""
    addon = bpy.context.preferences.addons.get("cycles")
    named = getattr(addon.preferences, "compute_device_type", "NONE") if addon else "NONE"
    fits = named in DEVICES and (named == "OPTIX" or not settings.has_lens(scene.pecs))
    return named if scene.pecs.device == "CPU" and fits else ""


def _of_device(scene) -> Iterator[Problem]:
    if device := spare_gpu(scene):
        text = say("Cycles has {device} in the preferences; this renders on the CPU", device=device)
        yield Problem(text, False, "pecs.use_gpu")


def _of_light(scene) -> Iterator[Problem]:
    s = scene.pecs
    try:
        spectrum(s.illuminant, Path(bpy.data.filepath or ".").absolute().parent)
    except RenderError as e:
        yield Problem(say("Lamps' spectrum: {error}", error=e))
    if s.min_nm and s.max_nm and s.min_nm >= s.max_nm:
        yield Problem(say("The shortest wavelength is not below the longest"))
    if s.moving_px and s.time == "uniform":
        try:
            RULES["moving_px"].parse(s.moving_px)
        except argparse.ArgumentTypeError as e:
            yield Problem(say("Moving part: {error}", error=e))


def _of_output(scene) -> Iterator[Problem]:
    folder = paths.stack(scene)
    if folder.exists() and not folder.is_dir():
        yield Problem(say(NO_FOLDER, path=folder))
        return
    yield from _of_place(folder)
    wanted = settings.stack_bytes(scene)
    disk = shutil.disk_usage(_there(folder))
    if disk.total and wanted > disk.free:  # /proc has none
        text = say("Up to {wanted}, and {free} are free", wanted=readable(wanted), free=readable(disk.free))
        yield Problem(text, is_error=scene.pecs.time == "uniform")


def _there(folder: Path) -> Path:
    """The folder, or the nearest above it that is there."""
    return next(place for place in (folder, *folder.absolute().parents) if place.exists())


def _of_place(folder: Path) -> Iterator[Problem]:
    place = _there(folder)
    if not place.is_dir():
        yield Problem(say(NO_FOLDER, path=place))
    elif not os.access(place, os.W_OK | os.X_OK):
        yield Problem(say("{path}: cannot be written", path=place))
