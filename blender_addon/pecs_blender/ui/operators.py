# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons. Renders run in a Blender of their own, on the file as saved; this one stays usable."""

from __future__ import annotations

import shutil
import tempfile
import webbrowser
from collections.abc import Callable
from pathlib import Path

import bpy

from ..core.chip import load_chip
from ..core.colour import linear_rgb
from ..core.errors import RenderError
from . import background, settings

PREVIEW_WIDTH = 320
PREVIEW_BANDS = ("--bands", "12", "--placement", "uniform", "--min-nm", "400", "--max-nm", "700")  # for the eye
AT_ONCE = ("--time", "uniform")
PREVIEW_IMAGE = "PECS preview"


class _Background:
    """Starts a job, whose end background.poll notices."""

    @classmethod
    def poll(cls, context) -> bool:
        if bpy.data.filepath and not bpy.data.is_dirty:
            return not background.state.job
        cls.poll_message_set("Save the file first: it is rendered as saved")
        return False

    def execute(self, context):
        background.start(self.job(context.scene))
        return {"FINISHED"}


class PECS_OT_render(_Background, bpy.types.Operator):
    """Render the EXR stack. A stopped render continues where it was"""

    bl_idname = "pecs.render"
    bl_label = "Render stack"

    @staticmethod
    def job(scene) -> background.Job:
        extra = ["--overwrite"] if scene.pecs.overwrite else []
        return _render(scene, extra, lambda job: f"{job.output}: rendered")


def _render(scene, extra: list[str], done: Callable[[background.Job], str]) -> background.Job:
    output = Path(bpy.path.abspath(scene.pecs.output))
    frames = "all" if scene.pecs.whole_range else str(scene.pecs.frames)
    return background.Job(scene, output, ["--frames", frames, *extra], done)


class PECS_OT_plan(_Background, bpy.types.Operator):
    """Say how many frames, hours and gigabytes the stack will take, from a probe of seconds"""

    bl_idname = "pecs.plan"
    bl_label = "Plan"

    @staticmethod
    def job(scene) -> background.Job:
        return _render(scene, ["--plan"], lambda job: job.last_line.removeprefix("render: "))


class PECS_OT_preview(_Background, bpy.types.Operator):
    """Render the current frame, small, and show its colours through CIE 1931"""

    bl_idname = "pecs.preview"
    bl_label = "Preview"

    @staticmethod
    def job(scene) -> background.Job:
        render = scene.render
        t_s = (scene.frame_current_final - scene.frame_start) * render.fps_base / render.fps
        index = max(0, round(t_s * scene.pecs.fps))
        width = min(PREVIEW_WIDTH, render.resolution_x)
        folder = Path(tempfile.mkdtemp(prefix="pecs_", dir=bpy.app.tempdir)) / background.PREVIEW_STACK
        extra = ["--frames", f"{index}:{index + 1}", "--width", str(width), *PREVIEW_BANDS, *AT_ONCE]
        return background.Job(scene, folder, extra, _show)


def _show(job: background.Job) -> str:
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
    areas = [area for window in bpy.context.window_manager.windows for area in window.screen.areas]
    editors = [area for area in areas if area.type == "IMAGE_EDITOR"]
    for area in editors:
        area.spaces.active.image = image
    shutil.rmtree(job.output.parent, ignore_errors=True)
    return f"{PREVIEW_IMAGE}: in the image editor" + ("" if editors else " (open one)")


class PECS_OT_stop(bpy.types.Operator):
    """Stop the render; finished instants are kept"""

    bl_idname = "pecs.stop"
    bl_label = "Stop"

    def execute(self, context):
        if background.state.job:
            background.state.job.stop()
        return {"FINISHED"}


class PECS_OT_draw_lens(bpy.types.Operator):
    """Draw the lens in section with its rays (SVG, shown by the browser)"""

    bl_idname = "pecs.draw_lens"
    bl_label = "Draw lens"

    @classmethod
    def poll(cls, context) -> bool:
        return context.scene.pecs.lens != "none"

    def execute(self, context):
        import pecs

        s, render = context.scene.pecs, context.scene.render
        path = Path(bpy.app.tempdir, f"{s.lens}.svg")
        try:
            width_mm = s.film_width_mm or load_chip(s.chip).film_width_mm(render.resolution_x)
            drawing = pecs.Lens(s.lens).draw(
                focus_m=settings.focus_m(context.scene),
                fnumber=s.fnumber or None,
                film_width_mm=width_mm,
                film_height_mm=width_mm * render.resolution_y / render.resolution_x,
            )
        except (pecs.PecsError, RenderError) as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        path.write_text(drawing)
        shown = webbrowser.open(path.as_uri())
        self.report({"INFO"}, f"{path}{'' if shown else ': no browser to show it'}")
        return {"FINISHED"}


CLASSES = (PECS_OT_render, PECS_OT_plan, PECS_OT_preview, PECS_OT_stop, PECS_OT_draw_lens)
