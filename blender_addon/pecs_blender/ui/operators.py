# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons that render. Renders run in a Blender of their own, on the file as saved; this one stays usable."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import bpy

from ..render.colour import linear_rgb
from . import background, checks, paths, settings
from .background import BackgroundJob
from .interface import areas, say
from .preferences import ROOT, preferences

PREVIEW_WIDTH = 320
# For the eye.
PREVIEW_BANDS = "--bands 12 --placement uniform --min-wavelength 400nm --max-wavelength 700nm".split()
AT_ONCE = ("--time", "uniform")
PREVIEW_IMAGE = "PECS preview"
BUSY = "A job is running: wait, or stop it"


class InBackground:
    """Starts a job, whose end background.poll notices. Subclasses have job(context)."""

    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context) -> bool:
        if background.state.job:
            cls.poll_message_set(say(BUSY))
            return False
        return True

    def execute(self, context):
        if background.state.job:
            self.report({"ERROR"}, say(BUSY))
            return {"CANCELLED"}
        try:
            background.start(self.job(context))
        except (OSError, RuntimeError) as e:  # no program; a chip that cannot be read
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        return {"FINISHED"}


def is_saved() -> bool:
    return bool(bpy.data.filepath) and not bpy.data.is_dirty


def wants_saving() -> bool:
    """By the user: a file that has a name is saved by the button, where that is preferred."""
    return not is_saved() and not (bpy.data.filepath and preferences().save_first)


class Renders(InBackground):
    @classmethod
    def poll(cls, context) -> bool:
        if not super().poll(context):
            return False
        if wants_saving():
            cls.poll_message_set(say("Save the file first: it is rendered as saved"))
            return False
        wrong = [one.text for one in checks.problems(context.scene) if one.is_error]
        if wrong:
            cls.poll_message_set(wrong[0])
        return not wrong

    def execute(self, context):
        if not is_saved():  # as wanted
            try:
                bpy.ops.wm.save_mainfile()
            except RuntimeError as e:
                self.report({"ERROR"}, str(e))
                return {"CANCELLED"}
        return super().execute(context)


def blender(scene, verb: str, output: Path | None, *words: str) -> list[str]:
    """The command of a verb of cli.py that renders; without output, it answers."""
    command = program(verb, bpy.data.filepath)
    return [*command, *(["-o", str(output)] if output else []), *settings.render_arguments(scene), *words]


def program(verb: str, *blend: str) -> list[str]:
    """cli.py in a process of its own."""
    if not bpy.app.binary_path:
        return [sys.executable, "-m", "pecs_blender", verb, *blend]  # the wheel has no program
    ours = ["--addons", ROOT]  # also where the preferences are not saved yet
    return [bpy.app.binary_path, "--background", *blend, *ours, "--command", "pecs", verb]


def frame_words(scene) -> list[str]:
    return ["--frames", "all" if scene.pecs.whole_range else str(scene.pecs.frames)]


def remember_stack(scene_name: str, folder: Path) -> None:
    """A new version has a name of its own."""
    scene = bpy.data.scenes.get(scene_name)
    if scene and paths.stack(scene).parent == folder.parent:
        scene.pecs.last_stack = str(folder)


class PECS_OT_render(Renders, bpy.types.Operator):
    """Render the EXR stack. A stopped render continues where it was"""

    bl_idname = "pecs.render"
    bl_label = "Render stack"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, output = context.scene, paths.stack(context.scene)
        name = scene.name

        def done(job: BackgroundJob) -> str:
            remember_stack(name, job.folder)
            return say("{path}: rendered", path=job.folder)

        command = blender(scene, "render", output, *frame_words(scene), *settings.exists_words(scene))
        return BackgroundJob("Render stack", command, output, done, continues=True)


class PECS_OT_run(Renders, bpy.types.Operator):
    """Render the EXR stack, then simulate its events. A stopped render continues where it was"""

    bl_idname = "pecs.run"
    bl_label = "Render and simulate"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, stack, events = context.scene, paths.stack(context.scene), paths.events(context.scene)
        name = scene.name

        def done(job: BackgroundJob) -> str:
            remember_stack(name, job.folder if job.folder != events else stack)
            return job.answer[-1] if job.answer else say("{path}: simulated", path=events)

        words = ["--stack", str(stack), *frame_words(scene), *settings.exists_words(scene)]
        command = blender(scene, "run", events, *words, "--sense", *settings.sensor_arguments(scene))
        return BackgroundJob("Render and simulate", command, events, done, continues=True)


class PECS_OT_plan(Renders, bpy.types.Operator):
    """Say how many frames, hours and gigabytes the stack will take, from a probe of seconds"""

    bl_idname = "pecs.plan"
    bl_label = "Plan"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, output = context.scene, paths.stack(context.scene)
        command = blender(scene, "render", output, *frame_words(scene), "--plan")
        return BackgroundJob("Plan", command, output, lambda job: job.last_line.removeprefix("render: "))


class PECS_OT_preview(Renders, bpy.types.Operator):
    """Render the current frame, small, and show its colours through CIE 1931"""

    bl_idname = "pecs.preview"
    bl_label = "Preview"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, render = context.scene, context.scene.render
        t_s = (scene.frame_current_final - scene.frame_start) * render.fps_base / render.fps
        index = max(0, round(t_s * scene.pecs.fps))
        width = min(PREVIEW_WIDTH, render.resolution_x)
        folder = Path(tempfile.mkdtemp(prefix="pecs_", dir=bpy.app.tempdir)) / "preview_stack"
        words = ["--frames", f"{index}:{index + 1}", "--width", str(width), *PREVIEW_BANDS, *AT_ONCE]
        return BackgroundJob("Preview", blender(scene, "render", folder, *words), folder, _show, for_file=True)


def _show(job: BackgroundJob) -> str:
    """The preview, in the image editor."""
    import numpy as np
    import pecs

    with pecs.StackReader(job.output) as stack:
        picture = linear_rgb(stack.read_frame(0), stack.info["bands"])
    height, width, _ = picture.shape
    if old := bpy.data.images.get(PREVIEW_IMAGE):
        bpy.data.images.remove(old)
    image = bpy.data.images.new(PREVIEW_IMAGE, width, height, float_buffer=True)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1]  # Blender's row 0 is at the bottom
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    shutil.rmtree(job.output.parent, ignore_errors=True)
    return show_image(image)


def show_image(image: bpy.types.Image) -> str:
    """In every image editor that is open."""
    editors = list(areas("IMAGE_EDITOR"))
    for area in editors:
        area.spaces.active.image = image
    text = "{image}: in the image editor" if editors else "{image}: in the image editor (open one)"
    return say(text, image=image.name)


class PECS_OT_stop(bpy.types.Operator):
    """Stop the job; finished instants are kept. A second time: at once. Esc does it over the properties"""

    bl_idname = "pecs.stop"
    bl_label = "Stop"

    @classmethod
    def poll(cls, _context) -> bool:
        return bool(background.state.job)

    def execute(self, context):
        if background.state.job:
            background.state.job.stop()
        return {"FINISHED"}


CLASSES = (PECS_OT_render, PECS_OT_run, PECS_OT_plan, PECS_OT_preview, PECS_OT_stop)
