# SPDX-License-Identifier: GPL-3.0-or-later
"""3-D viewport > N panel > PECS: events while the animation plays or things are dragged (live_view.py)."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import live_view
from .interface import say, wrapped
from .live_view import state


def _restart(_self, context) -> None:
    if not state.view:
        return
    try:
        state.view.settings(context.scene)
    except Exception as e:  # a chip that is not one, a disk that is full
        live_view.end(state.view, say(live_view.STOPPED, reason=e))


class PecsLive(bpy.types.PropertyGroup):
    source: EnumProperty(
        name="Seen from",
        items=[
            ("CAMERA", "Camera", "The scene's camera, as Blender has it (without the lens)"),
            ("VIEW", "Viewport", "What this viewport shows, its middle in the chip's shape"),
        ],
        update=_restart,
    )
    width: IntProperty(name="Width", default=346, min=8, max=2048, update=_restart, description="Pixels of the chip")
    height: IntProperty(name="Height", default=260, min=8, max=2048, update=_restart, description="Pixels of the chip")
    pixel: EnumProperty(
        name="Pixel",
        items=[
            ("QUICK", "Quick", "Contrast thresholds alone: no noise, no delay"),
            ("CHIP", "Chip", "The chip of the render settings, with noise and delay; white is 1 pA. Slower"),
        ],
        update=_restart,
    )
    threshold: FloatProperty(
        name="Threshold",
        default=0.2,
        min=0.01,
        max=2,
        update=_restart,
        description="Contrast threshold of the quick pixel, ON and OFF, in natural log",
    )
    instants: IntProperty(
        name="Instants",
        default=8,
        min=1,
        max=64,
        description="While the animation plays: at most as many pictures per frame, fewer where time lacks. "
        "With 1 the light fades from one frame to the next",
    )
    decay_ms: FloatProperty(
        name="Decay (ms)", default=40, min=1, max=2000, description="In which an event fades, by 1/e, in scene time"
    )
    alone: BoolProperty(name="Events alone", description="On a dark ground, instead of over the viewport")
    record: StringProperty(
        name="File",
        subtype="FILE_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        default="//live.raw",
        description="Of recorded events; the format by its end: .raw, .hdf5, .aedat4, .npz, .csv …",
    )


class PECS_OT_live(bpy.types.Operator):
    """Show what an event camera sees, over this viewport: a preview in relative light. Press again to stop"""

    bl_idname = "pecs.live"
    bl_label = "Live events"

    @classmethod
    def poll(cls, context) -> bool:
        return not bpy.app.background and context.area is not None and context.area.type == "VIEW_3D"

    def execute(self, context):
        if state.view:
            live_view.end(state.view)
            return {"FINISHED"}
        try:
            state.view = live_view.LiveView(context)
        except Exception as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        state.message = ""
        return {"FINISHED"}


class PECS_OT_live_record(bpy.types.Operator):
    """Write the live events to the file, until pressed again or the live view stops"""

    bl_idname = "pecs.live_record"
    bl_label = "Record"

    @classmethod
    def poll(cls, _context) -> bool:
        return state.view is not None

    def execute(self, context):
        sensor, name = state.view.sensor, context.scene.pecs_live.record
        try:
            if recording := sensor.recording:
                count = sensor.stop_recording()
                self.report({"INFO"}, say("{path}: {count:,} events", path=recording.path, count=count))
            elif name.startswith("//") and not bpy.data.filepath:
                text = "{name}: the file is not saved yet: choose a full path, or save it first"
                raise ValueError(say(text, name=name))
            else:
                live_view.record(state.view, Path(bpy.path.abspath(name)))
        except Exception as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        return {"FINISHED"}


class PECS_PT_live(bpy.types.Panel):
    bl_label = "Live events"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PECS"

    def draw(self, context) -> None:
        layout, s, view = self.layout, context.scene.pecs_live, state.view
        layout.use_property_split, layout.use_property_decorate = True, False
        row = layout.row(align=True)
        row.operator("pecs.live", text="Stop" if view else "Start", icon="PAUSE" if view else "PLAY")
        recording = view and view.sensor.recording
        row.operator("pecs.live_record", text="Stop recording" if recording else "Record", icon="REC")
        if state.message:
            wrapped(layout, state.message, "ERROR")
        wrapped(layout, say("A preview: relative light, without spectrum and lens"), "INFO")

        column = layout.column(align=True)
        column.prop(s, "source")
        column.prop(s, "width")
        column.prop(s, "height")
        column.prop(s, "pixel")
        if s.pixel == "QUICK":
            column.prop(s, "threshold")
        column = layout.column(align=True)
        column.prop(s, "instants")
        column.prop(s, "decay_ms")
        column.prop(s, "alone")
        layout.prop(s, "record")


CLASSES = (PecsLive, PECS_OT_live, PECS_OT_live_record, PECS_PT_live)


@bpy.app.handlers.persistent
def _stop(*_) -> None:
    """Another file is opened: what the view looks at goes."""
    live_view.end(state.view)


def _in_view_menu(self, _context) -> None:
    """And so F3."""
    self.layout.separator()
    self.layout.operator("pecs.live")


def register() -> None:
    bpy.types.VIEW3D_MT_view.append(_in_view_menu)
    bpy.types.Scene.pecs_live = PointerProperty(type=PecsLive)
    bpy.app.handlers.load_pre.append(_stop)


def unregister() -> None:
    _stop()
    bpy.app.handlers.load_pre.remove(_stop)
    bpy.types.VIEW3D_MT_view.remove(_in_view_menu)
    del bpy.types.Scene.pecs_live
