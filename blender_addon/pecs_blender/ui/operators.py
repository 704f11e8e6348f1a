# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons. Renders run in a Blender of their own, on the file as saved; this one stays usable."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import threading
import webbrowser
from pathlib import Path

import bpy

from ..core.colour import linear_rgb
from . import settings

PREVIEW_WIDTH = 320
PREVIEW_BANDS = ("--bands", "12", "--placement", "uniform", "--min-nm", "400", "--max-nm", "700")  # for the eye
PREVIEW_IMAGE = "PECS preview"


class _Job:
    """`blender --command pecs render` in the background; its last line and how far it is (0 ... 1)."""

    def __init__(self, scene, output: Path, extra: list[str]):
        command = [bpy.app.binary_path, "--background", bpy.data.filepath, "--command", "pecs", "render"]
        command += ["-o", str(output), *settings.arguments(scene), *extra]
        self.output, self.last_line, self.progress = output, "", 0.0
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stderr:
            self.last_line = line.strip() or self.last_line
            if found := re.match(r"render: (\d+)(?:/| of )(\d+)", line):
                self.progress = int(found[1]) / int(found[2])

    def returncode(self) -> int | None:
        """None while it runs."""
        code = self._process.poll()
        if code is not None:
            self._reader.join()
        return code

    def stop(self) -> None:
        self._process.terminate()


_jobs: list[_Job] = []  # the one that runs


def running() -> _Job | None:
    return _jobs[0] if _jobs else None


class _Background:
    """A modal operator that waits for a job."""

    @classmethod
    def poll(cls, context) -> bool:
        if bpy.data.filepath and not bpy.data.is_dirty:
            return not _jobs
        cls.poll_message_set("Save the file first: it is rendered as saved")
        return False

    def execute(self, context):
        self._job = self.job(context.scene)
        _jobs.append(self._job)
        self._timer = context.window_manager.event_timer_add(0.2, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        job = self._job
        for area in context.screen.areas:
            if area.type == "PROPERTIES":
                area.tag_redraw()
        code = job.returncode()
        if code is None:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        _jobs.remove(job)
        if code == 0:
            self.report({"INFO"}, self.done(job))
        else:
            self.report({"ERROR"}, job.last_line or f"Blender ended with code {code}")
        self.clean_up(job)
        return {"FINISHED" if code == 0 else "CANCELLED"}

    def clean_up(self, job) -> None:
        pass


class PECS_OT_render(_Background, bpy.types.Operator):
    """Render the EXR stack. A stopped render continues where it was"""

    bl_idname = "pecs.render"
    bl_label = "Render stack"

    def job(self, scene) -> _Job:
        output = Path(bpy.path.abspath(scene.pecs.output))
        return _Job(scene, output, ["--frames", "all" if scene.pecs.whole_range else str(scene.pecs.frames)])

    def done(self, job) -> str:
        return f"{job.output}: rendered"


class PECS_OT_preview(_Background, bpy.types.Operator):
    """Render the current frame, small, and show its colours through CIE 1931"""

    bl_idname = "pecs.preview"
    bl_label = "Preview"

    def job(self, scene) -> _Job:
        render = scene.render
        t_s = (scene.frame_current_final - scene.frame_start) * render.fps_base / render.fps
        index = max(0, round(t_s * scene.pecs.rate_hz))
        width = min(PREVIEW_WIDTH, render.resolution_x)
        folder = Path(tempfile.mkdtemp(prefix="pecs_", dir=bpy.app.tempdir))
        return _Job(
            scene, folder / "stack", ["--frames", f"{index}:{index + 1}", "--width", str(width), *PREVIEW_BANDS]
        )

    def done(self, job) -> str:
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
        editors = [a for a in bpy.context.screen.areas if a.type == "IMAGE_EDITOR"]
        for area in editors:
            area.spaces.active.image = image
        return f"{PREVIEW_IMAGE}: in the image editor" + ("" if editors else " (open one)")

    def clean_up(self, job) -> None:
        shutil.rmtree(job.output.parent, ignore_errors=True)


class PECS_OT_stop(bpy.types.Operator):
    """Stop the render; finished instants are kept"""

    bl_idname = "pecs.stop"
    bl_label = "Stop"

    def execute(self, context):
        if job := running():
            job.stop()
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
            drawing = pecs.Lens(s.lens).draw(
                focus_m=s.focus_m,
                fnumber=s.fnumber,
                film_width_mm=s.film_width_mm,
                film_height_mm=s.film_width_mm * render.resolution_y / render.resolution_x,
            )
        except pecs.PecsError as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        path.write_text(drawing)
        shown = webbrowser.open(path.as_uri())
        self.report({"INFO"}, f"{path}{'' if shown else ': no browser to show it'}")
        return {"FINISHED"}


CLASSES = (PECS_OT_render, PECS_OT_preview, PECS_OT_stop, PECS_OT_draw_lens)
