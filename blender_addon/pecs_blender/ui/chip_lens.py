# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators on the chip and the lens: resolution, aperture, angle of view, parameters."""

import math
from pathlib import Path

import bpy
import pecs
from bpy.props import IntProperty, StringProperty
from pecs._errors import PecsError

from . import checks, library, paths, settings
from .interface import say


class PECS_OT_chip_resolution(bpy.types.Operator):
    """Set the scene's resolution to that of the chip"""

    bl_idname = "pecs.chip_resolution"
    bl_label = "Use Chip Resolution"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context) -> bool:
        try:
            chip = library.chip(context.scene.pecs.chip)
        except RuntimeError as e:
            cls.poll_message_set(str(e))
            return False
        if not (chip.width and chip.height):
            cls.poll_message_set(say("This chip has no fixed resolution"))
        return bool(chip.width and chip.height)

    def execute(self, context):
        chip, render = library.chip(context.scene.pecs.chip), context.scene.render
        render.resolution_x, render.resolution_y, render.resolution_percentage = chip.width, chip.height, 100
        render.pixel_aspect_x = render.pixel_aspect_y = 1
        return {"FINISHED"}


class PECS_OT_use_gpu(bpy.types.Operator):
    """Render on the device from Cycles' preferences"""

    bl_idname = "pecs.use_gpu"
    bl_label = "Use GPU"
    bl_options = {"UNDO", "INTERNAL"}

    @classmethod
    def poll(cls, context) -> bool:
        return bool(checks.spare_gpu(context.scene))

    def execute(self, context):
        context.scene.pecs.device = checks.spare_gpu(context.scene)
        return {"FINISHED"}


class _OnLens:
    @classmethod
    def poll(cls, context) -> bool:
        if not settings.has_lens(context.scene.pecs):
            cls.poll_message_set(say("Choose a lens first"))
        return settings.has_lens(context.scene.pecs)


class PECS_OT_wide_open(_OnLens, bpy.types.Operator):
    """Open the lens to its maximum aperture"""

    bl_idname = "pecs.wide_open"
    bl_label = "Use Wide-Open Aperture"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        context.scene.pecs.fnumber = 0
        return {"FINISHED"}


class PECS_OT_match_lens(_OnLens, bpy.types.Operator):
    """Set the scene's camera to the lens's angle of view, so that the viewport shows the lens's image"""

    bl_idname = "pecs.match_lens"
    bl_label = "Match Camera to Lens"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context) -> bool:
        camera = context.scene.camera
        if not camera or camera.type != "CAMERA":
            cls.poll_message_set(say("The scene has no camera"))
            return False
        return super().poll(context)

    def execute(self, context):
        scene, camera = context.scene, context.scene.camera.data
        try:
            width_mm, height_mm = settings.film_mm(scene)
            info = settings.lens_now(scene)
        except RuntimeError as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        camera.type, camera.sensor_fit = "PERSP", "HORIZONTAL"
        camera.sensor_width, camera.sensor_height = width_mm, height_mm
        camera.lens = width_mm / 2 / math.tan(math.radians(info["hfov_deg"]) / 2)
        camera.shift_x = camera.shift_y = 0
        return {"FINISHED"}


class PECS_OT_draw_lens(_OnLens, bpy.types.Operator):
    """Draw a cross-section of the lens with its rays (SVG) and open it in the browser"""

    bl_idname = "pecs.draw_lens"
    bl_label = "Draw Lens"

    def execute(self, context):
        s = context.scene.pecs
        path = Path(bpy.app.tempdir, f"{Path(s.lens).stem}.svg")
        try:
            width_mm, height_mm = settings.film_mm(context.scene)
            with pecs.Lens(library.find("lens", s.lens)) as lens:
                drawing = lens.draw(
                    focus_m=settings.focus_m(context.scene),
                    fnumber=settings.plain(s.fnumber) or None,
                    film_width_mm=width_mm,
                    film_height_mm=height_mm,
                )
            path.write_text(drawing)
        except (PecsError, OSError) as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        self.report({"INFO"}, paths.open_outside(path))
        return {"FINISHED"}


class PECS_OT_pick_lens(bpy.types.Operator):
    """Choose a lens prescription file"""

    bl_idname = "pecs.pick_lens"
    bl_label = "Load Lens File"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def invoke(self, context, _event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        context.scene.pecs.lens = self.filepath
        return {"FINISHED"}


def _keys(_self, context, text: str) -> list[tuple[str, str]]:
    try:
        known = settings.parameters(context.scene.pecs)
    except RuntimeError:
        return []
    return [(key, f"{p['value']:g} {p['unit']}") for key, p in known.items() if text.lower() in key]


class PECS_OT_override_add(bpy.types.Operator):
    """Override a parameter of the chip or pixel model"""

    bl_idname = "pecs.override_add"
    bl_label = "Override Parameter"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "name"

    name: StringProperty(name="Parameter", search=_keys, options={"SKIP_SAVE"})

    def invoke(self, context, _event):
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context):
        settings_, sensor = context.scene.pecs, context.scene.pecs.sensor
        try:
            known = settings.parameters(settings_)
        except RuntimeError as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        if self.name not in known:
            self.report({"ERROR"}, say(settings.UNKNOWN, name=self.name or "?"))
            return {"CANCELLED"}
        if self.name not in sensor.overrides:
            one = sensor.overrides.add()
            one.name, one.value = self.name, f"{known[self.name]['value']:.6g}"
        return {"FINISHED"}


class PECS_OT_override_remove(bpy.types.Operator):
    """Remove the override and use the value of the profile"""

    bl_idname = "pecs.override_remove"
    bl_label = "Remove Override"
    bl_options = {"UNDO", "INTERNAL"}

    index: IntProperty()

    def execute(self, context):
        context.scene.pecs.sensor.overrides.remove(self.index)
        return {"FINISHED"}


CLASSES = (
    PECS_OT_chip_resolution,
    PECS_OT_use_gpu,
    PECS_OT_wide_open,
    PECS_OT_match_lens,
    PECS_OT_draw_lens,
    PECS_OT_pick_lens,
    PECS_OT_override_add,
    PECS_OT_override_remove,
)
