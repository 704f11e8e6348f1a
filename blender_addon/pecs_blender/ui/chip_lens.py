# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators on the chip and the lens: resolution, device, aperture, angle of view, parameters."""

import math
from pathlib import Path

import bpy
import pecs
from bpy.props import IntProperty, StringProperty

from . import checks, library, paths, settings
from .interface import AUTO, Action, Edit


class PECS_OT_chip_resolution(Edit, bpy.types.Operator):
    """Set the scene's resolution to that of the chip"""

    bl_label = "Use Chip Resolution"

    @classmethod
    def why_not(cls, context) -> str:
        try:
            chip = library.chip(context.scene.pecs.chip)
        except RuntimeError as e:
            return str(e)
        return "" if chip.width and chip.height else "This chip has no fixed resolution"

    def act(self, context) -> None:
        chip = library.chip(context.scene.pecs.chip)
        settings.set_size(context.scene.render, chip.width, chip.height)


class PECS_OT_whole_range(Edit, bpy.types.Operator):
    """Render from the scene's start frame to its end frame"""

    bl_label = "Use Scene Frame Range"
    setting = "whole_range", True


class PECS_OT_use_gpu(Action, bpy.types.Operator):
    """Render on the device from Cycles' preferences"""

    bl_label = "Use GPU"
    bl_options = {"UNDO", "INTERNAL"}

    @classmethod
    def poll(cls, context) -> bool:
        return bool(checks.spare_gpu(context.scene))

    def act(self, context) -> None:
        context.scene.pecs.device = checks.spare_gpu(context.scene)


class PECS_OT_keep_noise(Edit, bpy.types.Operator):
    """Render without denoising. More samples reduce the noise"""

    bl_label = "Keep Render Noise"
    bl_options = {"UNDO", "INTERNAL"}
    setting = "no_denoise", True


class _OnLens:
    @classmethod
    def why_not(cls, context) -> str:
        return "" if settings.has_lens(context.scene.pecs) else "Choose a lens first"


class PECS_OT_wide_open(_OnLens, Edit, bpy.types.Operator):
    """Open the lens to its maximum aperture"""

    bl_label = "Use Wide-Open Aperture"
    setting = "fnumber", 0


class PECS_OT_match_lens(_OnLens, Edit, bpy.types.Operator):
    """Set the scene's camera to the lens's angle of view, so that the viewport shows the lens's image"""

    bl_label = "Match Camera to Lens"

    @classmethod
    def why_not(cls, context) -> str:
        camera = context.scene.camera
        if not camera or camera.type != "CAMERA":
            return "The scene has no camera"
        return super().why_not(context)

    def act(self, context) -> None:
        width_mm, height_mm = settings.film_mm(context.scene)
        half = math.radians(settings.lens_now(context.scene)["hfov_deg"]) / 2
        settings.set_pinhole(context.scene.camera.data, width_mm, height_mm, width_mm / 2 / math.tan(half))


class PECS_OT_draw_lens(_OnLens, Action, bpy.types.Operator):
    """Draw a cross-section of the lens with its rays (SVG) and open it in the browser"""

    bl_label = "Draw Lens"

    def act(self, context) -> str:
        lens = context.scene.pecs.lens
        path = Path(bpy.app.tempdir, f"{Path(lens).stem}.svg")
        with pecs.Lens(library.find("lens", lens)) as prescription:
            path.write_text(prescription.draw(**settings.lens_options(context.scene)), encoding="utf-8")
        return paths.open_outside(path)


class _Pick(Edit):
    """Chooses a file for the setting `kind`."""

    def invoke(self, context, _event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context) -> None:
        setattr(context.scene.pecs, self.kind, self.filepath)


def _file(pattern: str) -> dict:
    return {
        "filepath": StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"}),
        "filter_glob": StringProperty(default=pattern, options={"HIDDEN"}),
    }


class PECS_OT_pick_lens(_Pick, bpy.types.Operator):
    """Choose a lens prescription: JSON, Zemax (.zmx) or pbrt (.dat)"""

    bl_label = "Load Lens File"
    kind = "lens"


class PECS_OT_pick_chip(_Pick, bpy.types.Operator):
    """Choose a chip profile file"""

    bl_label = "Load Chip File"
    kind = "chip"


PECS_OT_pick_lens.__annotations__ = _file("*.json;*.zmx;*.dat")
PECS_OT_pick_chip.__annotations__ = _file("*.json")


class PECS_OT_use_preset(Edit, bpy.types.Operator):
    """Use the values of the chip"""

    bl_label = "Use Published Setting"

    name: StringProperty(name="Name", options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _context, properties) -> str:
        preset = settings.published().get(properties.name)
        return f"{preset['description']}. {preset['source']}" if preset else cls.__doc__

    def act(self, context) -> None:
        context.scene.pecs.sensor.preset = self.name


class PECS_OT_auto(Action, bpy.types.Operator):
    """Choose a number, or leave the choice to PECS"""

    bl_label = "Automatic"
    bl_options = {"UNDO", "INTERNAL"}

    owner: StringProperty(options={"SKIP_SAVE"})  # path from the scene
    name: StringProperty(options={"SKIP_SAVE"})  # a name of interface.AUTO

    @classmethod
    def description(cls, context, properties) -> str:
        return context.scene.path_resolve(properties.owner).bl_rna.properties[properties.name].description

    def act(self, context) -> None:
        owner = context.scene.path_resolve(self.owner)
        setattr(owner, self.name, 0 if getattr(owner, self.name) else AUTO[self.name][1])


def _keys(_self, context, text: str) -> list[tuple[str, str]]:
    try:
        known = settings.parameters(context.scene.pecs)
    except RuntimeError:
        return []
    return [(key, f"{p['value']:g} {p['unit']}") for key, p in known.items() if text.lower() in key]


class PECS_OT_override_add(Edit, bpy.types.Operator):
    """Override a parameter of the chip or pixel model"""

    bl_label = "Override Parameter"
    bl_property = "name"

    name: StringProperty(name="Parameter", search=_keys, options={"SKIP_SAVE"})

    def invoke(self, context, _event):
        return self.execute(context) if self.name else context.window_manager.invoke_props_dialog(self)

    def act(self, context) -> None:
        known, sensor = settings.parameters(context.scene.pecs), context.scene.pecs.sensor
        if self.name not in known:
            raise RuntimeError(settings.UNKNOWN.format(name=self.name or "?"))
        if self.name not in sensor.overrides:
            one = sensor.overrides.add()
            one.name, one.value = self.name, f"{known[self.name]['value']:.6g}"


class PECS_OT_override_remove(Action, bpy.types.Operator):
    """Remove the override and use the value of the profile"""

    bl_label = "Remove Override"
    bl_options = {"UNDO", "INTERNAL"}

    index: IntProperty()

    def act(self, context) -> None:
        context.scene.pecs.sensor.overrides.remove(self.index)
