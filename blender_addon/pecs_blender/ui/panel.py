# SPDX-License-Identifier: GPL-3.0-or-later
"""Render properties > PECS: what runs, and what is wrong. Its sub-panels have files of their own."""

from __future__ import annotations

import bpy

from . import checks, operators, words
from .background import state
from .presets import PECS_PT_presets


class Sub:
    """A sub-panel."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_parent_id = "PECS_PT_render"

    def draw(self, context) -> None:
        self.layout.use_property_split, self.layout.use_property_decorate = True, False
        self.fill(self.layout, context.scene, context.scene.pecs)


class PECS_PT_render(bpy.types.Panel):
    bl_label = "PECS: event camera"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"

    def draw_header_preset(self, _context) -> None:
        PECS_PT_presets.draw_panel_header(self.layout)

    def draw(self, context) -> None:
        layout = self.layout
        if job := state.job:
            row = layout.row(align=True)
            row.progress(factor=job.progress, text=job.text)
            row.operator("pecs.stop", icon="CANCEL", text="")
        else:
            row = layout.row()
            row.scale_y = 1.4
            row.operator("pecs.run", icon="RENDER_ANIMATION")
            if state.message:
                words.wrapped(layout, state.message, "ERROR" if state.is_error else "INFO", state.is_error)
            if state.is_error and "exists and differs" in state.message:
                layout.prop(context.scene.pecs, "exists")
        if operators.wants_saving():
            words.wrapped(layout, words.say("Save the file: it is rendered as saved"), "INFO")
            layout.operator("wm.save_mainfile", text="Save", icon="FILE_TICK")
        for one in checks.problems(context.scene):
            words.problem(layout, one)


CLASSES = (PECS_PT_render,)
