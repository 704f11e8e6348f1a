# SPDX-License-Identifier: GPL-3.0-or-later
"""Sub-panels of the events: simulate, look at them, compare them."""

from __future__ import annotations

import bpy

from . import event_operators, paths
from .background import state
from .checks import sensor_problems
from .panel import Sub
from .words import CONTEXT, problem, say


class PECS_PT_events(Sub, bpy.types.Panel):
    bl_label = "Events"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s.sensor, "output", placeholder=paths.events(scene).name)
        layout.prop(s.sensor, "format")
        for one in sensor_problems(scene):
            problem(layout, one)
        layout.label(text=say("From {name}", name=paths.rendered(scene).name))
        layout.operator("pecs.sense", icon="PARTICLES")


class PECS_PT_view(Sub, bpy.types.Panel):
    bl_label = "Look"
    bl_translation_context = CONTEXT
    bl_parent_id = "PECS_PT_events"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s.sensor, "window_ms")
        layout.prop(s.sensor, "slow_motion")
        row = layout.row(align=True)
        for kind, icon in (("png", "IMAGE_DATA"), ("mp4", "FILE_MOVIE"), ("html", "WORLD")):
            row.operator("pecs.view", text=event_operators.KINDS[kind][0], icon=icon).kind = kind
        if event_operators.sequencer_scene(bpy.context):
            strip = layout.operator("pecs.view", text="Video into the sequencer", icon="SEQUENCE")
            strip.kind, strip.to_sequencer = "mp4", True
        layout.prop(s.sensor, "cutoff_hz")
        row = layout.row(align=True)
        row.operator("pecs.reconstruct", icon="RENDER_ANIMATION")
        if event_operators.sequencer_scene(bpy.context):
            row.operator("pecs.reconstruct", text="", icon="SEQUENCE").to_sequencer = True
        row = layout.row(align=True)
        row.operator("pecs.report", icon="TEXT")
        row.operator("pecs.open_folder", icon="FILE_FOLDER", text="Folder")


class PECS_PT_compare(Sub, bpy.types.Panel):
    bl_label = "Compare"
    bl_parent_id = "PECS_PT_events"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s.sensor, "recording")
        layout.prop(s.sensor, "compare_ms")
        layout.operator("pecs.compare", icon="MOD_DATA_TRANSFER")
        title, rows = state.scores
        if rows:
            box = layout.box()
            row = box.row()
            row.label(text=title)
            row.operator("pecs.close_scores", icon="X", text="", emboss=False)
            for label, value in rows:
                split = box.split(factor=0.4)
                split.scale_y = 0.6
                split.label(text=say(label))
                split.label(text=value)


CLASSES = (PECS_PT_events, PECS_PT_view, PECS_PT_compare)
