# SPDX-License-Identifier: GPL-3.0-or-later
"""Render properties > PECS."""

from __future__ import annotations

import bpy

from ..core.resources import BYTES_PER_VALUE
from .background import state
from .settings import instants


class PECS_PT_render(bpy.types.Panel):
    bl_label = "PECS: event camera"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_order = -1  # above Cycles' own

    def draw(self, context) -> None:
        layout, scene, s = self.layout, context.scene, context.scene.pecs
        layout.use_property_split, layout.use_property_decorate = True, False

        column = layout.column(align=True)
        column.prop(s, "lens")
        if s.lens != "none":
            for name in ("focus_m", "fnumber", "film_width_mm"):
                column.prop(s, name)
            if not bpy.app.build_options.cycles_osl:
                layout.label(text="No lens: this Blender has no OSL", icon="ERROR")

        column = layout.column(align=True)
        for name in ("bands", "placement", "chip", "illuminant", "light_scale", "samples", "device", "layers"):
            column.prop(s, name)

        column = layout.column(align=True)
        column.prop(s, "output")
        column.prop(s, "overwrite")
        column.prop(s, "time")
        if s.time == "adaptive":
            column.prop(s, "step_px")
        column.prop(s, "fps")
        column.prop(s, "whole_range")
        if not s.whole_range:
            column.prop(s, "frames")
        width, height = (n * scene.render.resolution_percentage // 100 for n in _size(scene))
        megabytes = instants(scene) * s.channels * width * height * BYTES_PER_VALUE / 1e6
        layout.label(text=f"{instants(scene)} instants x {s.pass_count} passes")
        layout.label(text=f"{width} x {height} pixels, up to {megabytes:,.0f} MB")

        if job := state.job:
            row = layout.row()
            row.progress(factor=job.progress, text=f"{job.progress:.0%}")
            row.operator("pecs.stop", icon="CANCEL", text="")
        else:
            row = layout.row(align=True)
            row.operator("pecs.draw_lens", icon="CAMERA_DATA")
            row.operator("pecs.preview", icon="IMAGE_DATA")
            row = layout.row(align=True)
            row.operator("pecs.plan", icon="TIME")
            row.operator("pecs.render", icon="RENDER_ANIMATION")
            if state.message:
                layout.label(text=state.message, icon="ERROR" if state.is_error else "INFO")


def _size(scene) -> tuple[int, int]:
    return scene.render.resolution_x, scene.render.resolution_y
