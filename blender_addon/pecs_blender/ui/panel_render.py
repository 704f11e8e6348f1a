# SPDX-License-Identifier: GPL-3.0-or-later
"""Sub-panels of the render: lens, light, time, stack."""

from __future__ import annotations

import bpy

from ..render.resources import BYTES_PER_VALUE, readable
from . import paths, settings
from .panel import Sub
from .words import CONTEXT, say


class PECS_PT_lens(Sub, bpy.types.Panel):
    bl_label = "Lens"
    bl_translation_context = CONTEXT

    def fill(self, layout, scene, s) -> None:
        row = layout.row(align=True)
        row.prop(s, "lens")
        row.operator("pecs.pick_lens", icon="FILEBROWSER", text="")
        if not settings.has_lens(s):
            camera = scene.camera
            if camera and camera.type == "CAMERA":
                layout.label(text=say("The scene's camera, f/{number:.3g}", number=camera.data.dof.aperture_fstop))
            return
        column = layout.column(align=True)
        for name in ("focus_m", "fnumber", "film_width_mm"):
            column.prop(s, name)
        try:
            info = settings.lens_now(scene)
        except RuntimeError:  # checks.py says it above
            return
        column = layout.column(align=True)
        column.label(text=f"{info['efl_mm']:.4g} mm, f/{info['fnumber']:.3g}")
        column.label(text=say("Sees {across:.1f}° x {down:.1f}°", across=info["hfov_deg"], down=info["vfov_deg"]))
        row = layout.row(align=True)
        row.operator("pecs.match_lens", text="Match the camera", icon="CAMERA_DATA")
        row.operator("pecs.draw_lens", icon="VIEW_ORTHO")


class PECS_PT_light(Sub, bpy.types.Panel):
    bl_label = "Light and bands"

    def fill(self, layout, scene, s) -> None:
        for name in ("bands", "placement", "illuminant", "light_scale", "samples", "device"):
            layout.prop(s, name)


class PECS_PT_light_more(Sub, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "PECS_PT_light"
    bl_options = {"DEFAULT_CLOSED"}

    def fill(self, layout, scene, s) -> None:
        for name in ("min_nm", "max_nm", "bands_per_pass", "noise_target", "denoise", "light_tree", "seed", "threads"):
            layout.prop(s, name)
        if settings.has_lens(s):
            layout.prop(s, "film_shift_mm")
        layout.prop(s, "allow_scripts")


class PECS_PT_time(Sub, bpy.types.Panel):
    bl_label = "Time"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s, "time")
        layout.prop(s, "step_px" if s.time == "adaptive" else "moving_px")
        layout.prop(s, "fps")
        layout.prop(s, "whole_range")
        if not s.whole_range:
            layout.prop(s, "frames")
        count, passes = settings.instants(scene), s.pass_count
        text = "{count:,} instants, {ms:.4g} ms, {passes} passes each"
        text = text if passes > 1 else "{count:,} instants, {ms:.4g} ms, 1 pass each"
        layout.label(text=say(text, count=count, ms=count / s.fps * 1e3, passes=passes))


class PECS_PT_stack(Sub, bpy.types.Panel):
    bl_label = "Stack"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s, "output", placeholder=paths.stack(scene).name)
        layout.prop(s, "exists")
        layout.prop(s, "layers")
        width, height = settings.size(scene)
        size_bytes = settings.instants(scene) * s.channels * width * height * BYTES_PER_VALUE
        text = "{width} x {height} pixels, up to {size}"
        layout.label(text=say(text, width=width, height=height, size=readable(size_bytes)))
        row = layout.row(align=True)
        row.operator("pecs.plan", icon="TIME")
        row.operator("pecs.preview", icon="IMAGE_DATA")
        layout.operator("pecs.render", icon="RENDER_STILL")


CLASSES = (PECS_PT_lens, PECS_PT_light, PECS_PT_light_more, PECS_PT_time, PECS_PT_stack)
