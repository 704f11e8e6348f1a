# SPDX-License-Identifier: GPL-3.0-or-later
"""3-D viewport > N panel > PECS: settings and operators of the live view (live_view.py)."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import live_view
from .interface import Action, props, wrapped
from .live_view import state


def _restart(_self, context) -> None:
    if not state.view:
        return
    try:
        state.view.settings(context.scene)
    except Exception as e:  # invalid chip, full disk
        live_view.end(state.view, live_view.STOPPED.format(reason=e))


class PecsLive(bpy.types.PropertyGroup):
    source: EnumProperty(
        name="View From",
        items=[
            ("CAMERA", "Camera", "The scene's camera, without the lens"),
            ("VIEW", "Viewport", "This viewport, cropped to the aspect ratio of the chip"),
        ],
        update=_restart,
    )
    width: IntProperty(name="Width", default=346, min=8, max=2048, update=_restart, description="Pixels of the chip")
    height: IntProperty(name="Height", default=260, min=8, max=2048, update=_restart, description="Pixels of the chip")
    pixel: EnumProperty(
        name="Pixel",
        items=[
            ("QUICK", "Quick", "Contrast thresholds only, without noise and latency"),
            ("CHIP", "Chip", "Chip of the render settings with noise and latency; white is 1 pA. Slower"),
        ],
        update=_restart,
    )
    threshold: FloatProperty(
        name="Threshold",
        default=0.2,
        min=0.01,
        max=2,
        update=_restart,
        description="ON and OFF contrast threshold of the quick pixel, in natural log units",
    )
    subframes: IntProperty(
        name="Subframes",
        default=8,
        min=1,
        max=64,
        description="Maximum number of rendered subframes per animation frame during playback; fewer on a slow "
        "machine. With 1, the light is interpolated between frames",
    )
    decay_ms: FloatProperty(
        name="Decay (ms)", default=40, min=1, max=2000, description="Scene time in which an event fades to 1/e"
    )
    alone: BoolProperty(
        name="Events Only", description="Draw the events on a dark background instead of the viewport's image"
    )
    record: StringProperty(
        name="File",
        subtype="FILE_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        default="//live.raw",
        description="Event file to record to. The extension sets the format: .raw, .hdf5, .aedat4, .npz, .csv …",
    )


class PECS_OT_live(Action, bpy.types.Operator):
    """Draw simulated events over this viewport, as a preview in relative light. Press again to stop"""

    bl_label = "Live Events"
    ERRORS = (Exception,)

    @classmethod
    def poll(cls, context) -> bool:
        return not bpy.app.background and context.area is not None and context.area.type == "VIEW_3D"

    def act(self, context) -> None:
        if state.view:
            live_view.end(state.view)
            return
        state.view, state.message = live_view.LiveView(context), ""


class PECS_OT_live_record(Action, bpy.types.Operator):
    """Record the live events to the file until pressed again or the live view stops"""

    bl_label = "Record"
    ERRORS = (Exception,)

    @classmethod
    def poll(cls, _context) -> bool:
        return state.view is not None

    def act(self, context) -> str | None:
        sensor, name = state.view.sensor, context.scene.pecs_live.record
        if recording := sensor.recording:
            return f"{recording.path}: {sensor.stop_recording():,} events"
        if name.startswith("//") and not bpy.data.filepath:
            raise ValueError(f"{name}: the .blend has no folder yet. Save it, or choose an absolute path")
        return live_view.record(state.view, Path(bpy.path.abspath(name)))


class PECS_PT_live(bpy.types.Panel):
    bl_label = "Live Events"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PECS"

    def draw(self, context) -> None:
        layout, s, view = self.layout, context.scene.pecs_live, state.view
        layout.use_property_split, layout.use_property_decorate = True, False
        row = layout.row(align=True)
        row.operator("pecs.live", text="Stop" if view else "Start", icon="CANCEL" if view else "PLAY")
        recording = view and view.sensor.recording
        row.operator("pecs.live_record", text="Stop Recording" if recording else "Record", icon="REC")
        if state.message:
            wrapped(layout, state.message, "ERROR")
        wrapped(layout, "Preview in relative light, without spectra and lens", "INFO")

        quick = ["threshold"] if s.pixel == "QUICK" else []
        props(layout.column(align=True), s, "source", "width", "height", "pixel", *quick)
        props(layout.column(align=True), s, "subframes", "decay_ms", "alone")
        layout.prop(s, "record")


@bpy.app.handlers.persistent
def on_load(*_) -> None:
    """Runs when another file is opened."""
    live_view.end(state.view)


def _in_view_menu(self, _context) -> None:
    """In a menu, so that F3 finds it."""
    self.layout.separator()
    self.layout.operator("pecs.live")


unregister = on_load
PROPERTIES = {(bpy.types.Scene, "pecs_live"): PointerProperty(type=PecsLive)}
MENUS = {"VIEW3D_MT_view": _in_view_menu}
