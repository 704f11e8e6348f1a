# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that render. Renders run in a second Blender process on a temporary copy of the open file, as it is in
memory; this one stays usable."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pecs
from pecs._arguments import latest

from ..job.resources import readable
from ..scene.blend import save_copy
from ..scene.cycles import fill
from ..spectral.colour import linear_rgb
from . import background, checks, paths, scene_checks, settings
from .background import BackgroundJob
from .interface import Action, areas
from .preferences import ROOT

PREVIEW_WIDTH = 320
# Visible light only.
PREVIEW_BANDS = "--bands 12 --placement uniform --min-wavelength 400nm --max-wavelength 700nm".split()
UNIFORM = ("--time", "uniform")
PREVIEW_IMAGE = "PECS preview"
BUSY = "A job is running. Wait for it or stop it"
TASKS = {"": "Starting Blender", "motion": "Motion", "sense": "Simulate"}


class InBackground(Action):
    """Starts the BackgroundJob of job(context), a method of the subclass."""

    bl_options = {"REGISTER"}

    @classmethod
    def why_not(cls, context) -> str:
        return BUSY if background.state.job else ""

    def act(self, context) -> None:
        if background.state.job:
            raise RuntimeError(BUSY)
        background.start(self.job(context))


class Renders(InBackground):
    problems = staticmethod(checks.problems)

    @classmethod
    def why_not(cls, context) -> str:
        if busy := super().why_not(context):
            return busy
        return next((one.text for one in cls.problems(context.scene) if one.is_error), "")

    @staticmethod
    def check_files(scene) -> None:
        """Missing files, and scripts that must not run: too slow for every redraw."""
        for one in scene_checks.files(scene):
            raise RuntimeError(one.text)

    def act(self, context) -> None:
        self.check_files(context.scene)
        super().act(context)


def copy_of_file() -> Path:
    """Saves the open file into a temporary folder that background.py removes after the job. Blender empties its own
    temporary folder with the preferences."""
    return save_copy(Path(tempfile.mkdtemp(prefix=background.COPIES)))


def blender(scene, verb: str, output: Path | None, *words: str) -> list[str]:
    """Command line of a render command of cli.py."""
    command = program(verb, str(copy_of_file()), allow_scripts=scene.pecs.allow_scripts)
    return [*command, *(["-o", str(output)] if output else []), *settings.render_arguments(scene), *words]


def program(verb: str, *blend: str, allow_scripts: bool = False) -> list[str]:
    """Command line that runs cli.py in another process. allow_scripts: of the .blend, which Blender opens before
    cli.py does, by the preferences unless it is told."""
    if not bpy.app.binary_path:
        return [sys.executable, "-m", "pecs_blender", verb, *blend]  # bpy as a module
    ours = ["--addons", ROOT]  # works before the preferences are saved
    scripts = "--enable-autoexec" if allow_scripts else "--disable-autoexec"  # before the file
    return [bpy.app.binary_path, "--background", scripts, *blend, *ours, "--command", "pecs", verb]


def frame_words(scene) -> list[str]:
    return ["--frames", "all" if scene.pecs.whole_range else str(scene.pecs.frames)]


def remember_stack(scene_name: str, folder: Path) -> None:
    """Keeps the folder of a new version, whose name has a suffix."""
    scene = bpy.data.scenes.get(scene_name)
    if scene and paths.stack(scene).parent == folder.parent:
        scene.pecs.last_stack = str(folder)


class PECS_OT_render(Renders, bpy.types.Operator):
    """Render the EXR stack. A stopped render resumes"""

    bl_label = "Render Stack"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, output = context.scene, paths.stack(context.scene)
        name = scene.name

        def done(job: BackgroundJob) -> str:
            remember_stack(name, job.folder)
            return f"{job.folder}: rendered"

        command = blender(scene, "render", output, *frame_words(scene), *settings.exists_words(scene))
        how = {"continues": True, "tasks": TASKS, "render_s": planned_s(scene)}
        return BackgroundJob("Render Stack", command, output, done, **how)


class PECS_OT_plan(Renders, bpy.types.Operator):
    """Estimate the frames, time and disk space of the stack from a short probe render"""

    bl_label = "Plan"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, output = context.scene, paths.stack(context.scene)
        name, used = scene.name, planned_with(scene)

        def done(job: BackgroundJob) -> str:
            background.state.plan[name] = job.plan | {"settings": used}
            (_, frames), (_, duration), *_rest = plan_rows(job.plan)
            return f"Plan: {frames} frames, {duration}"

        command = blender(scene, "render", output, *frame_words(scene), "--plan")
        return BackgroundJob("Plan", command, output, done, for_file=True, tasks=TASKS)


def planned_s(scene) -> float | None:
    """Time of the render by the plan; None if there is none for these settings."""
    plan = background.state.plan.get(scene.name)
    return plan["frames"] * plan["each_s"] if plan and plan["settings"] == planned_with(scene) else None


def planned_with(scene) -> list[str]:
    """Settings on which the answer depends."""
    at = scene.frame_start, scene.frame_end, scene.render.fps, scene.render.fps_base
    return [*settings.render_arguments(scene), *frame_words(scene), *map(str, (*settings.size(scene), *at))]


def plan_rows(plan: dict) -> list[tuple[str, str]]:
    """Labels and values of the answer."""
    return [
        ("Rendered", f"{plan['frames']:,} of {plan['of']:,}"),
        ("Time", background.clock(plan["frames"] * plan["each_s"])),
        ("Disk", readable(plan["disk_bytes"])),
        ("Memory", readable(plan["memory_bytes"])),
    ]


class PECS_OT_preview(Renders, bpy.types.Operator):
    """Render the current frame at low resolution and show it in CIE 1931 colours"""

    bl_label = "Preview"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, render = context.scene, context.scene.render
        t_s = (scene.frame_current_final - scene.frame_start) * render.fps_base / render.fps
        index = max(0, round(t_s * scene.pecs.fps))
        width = min(PREVIEW_WIDTH, render.resolution_x)
        folder = Path(tempfile.mkdtemp(prefix="pecs_", dir=bpy.app.tempdir)) / "preview_stack"
        words = ["--frames", f"{index}:{index + 1}", "--width", str(width), *PREVIEW_BANDS, *UNIFORM]
        command = latest(blender(scene, "render", folder, *words))
        return BackgroundJob("Preview", command, folder, _show, for_file=True, tasks=TASKS)


def _show(job: BackgroundJob) -> str:
    """Shows the preview in the image editor."""
    with pecs.StackReader(job.output) as stack:
        picture = linear_rgb(stack.read_frame(0), stack.info["bands"])
    shutil.rmtree(job.output.parent, ignore_errors=True)
    return show_image(image_of(PREVIEW_IMAGE, picture))


def image_of(name: str, picture: np.ndarray) -> bpy.types.Image:
    """The image of this name, with a picture [height, width, 3]."""
    height, width, _ = picture.shape
    if old := bpy.data.images.get(name):
        bpy.data.images.remove(old)
    image = bpy.data.images.new(name, width, height, float_buffer=True)
    fill(image, picture)
    image.pack()  # otherwise Blender asks at its end whether to save the image
    image.update()
    return image


def show_image(image: bpy.types.Image) -> str:
    """Shows an image in all open image editors, or in a new window if there is none; the message about it."""
    if not bpy.app.background and not any(areas("IMAGE_EDITOR")):
        _open_editor()
    editors = list(areas("IMAGE_EDITOR"))
    for area in editors:
        area.spaces.active.image = image
        bpy.app.timers.register(lambda area=area: _fit(area), first_interval=0.2)  # after its first draw
    return f"{image.name}: " + ("shown in the image editor" if editors else "open an image editor to see it")


def _open_editor() -> None:
    """The image editor that Blender opens for a render (Preferences > Interface > Temporary Editors)."""
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window, area=window.screen.areas[0]):
        bpy.ops.render.view_show("INVOKE_DEFAULT")


def _fit(area) -> None:
    """The whole image."""
    for window in bpy.context.window_manager.windows:
        if area in window.screen.areas[:]:
            region = next(r for r in area.regions if r.type == "WINDOW")
            with bpy.context.temp_override(window=window, area=area, region=region):
                bpy.ops.image.view_all(fit_view=True)


class PECS_OT_message(Action, bpy.types.Operator):
    """Show the whole last message, or open the manual if there is none"""

    bl_label = "Last Message"
    bl_options = {"INTERNAL"}

    def act(self, context) -> None:
        if background.state.message:
            background.pop_up(background.state.message)
        else:
            bpy.ops.pecs.manual()


class PECS_OT_stop(Action, bpy.types.Operator):
    """Stop the job and keep the finished frames. Press again to kill it. Shortcut in the properties editor: Esc"""

    bl_label = "Stop"

    @classmethod
    def poll(cls, _context) -> bool:
        return bool(background.state.job)

    def act(self, _context) -> None:
        if background.state.job:
            background.state.job.stop()
