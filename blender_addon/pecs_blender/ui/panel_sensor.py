# SPDX-License-Identifier: GPL-3.0-or-later
"""Sub-panels of the sensor: chip, its parameters."""

from __future__ import annotations

import bpy

from . import library, sensor_settings, settings
from .panel import Sub
from .words import say


class PECS_PT_sensor(Sub, bpy.types.Panel):
    bl_label = "Sensor"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s, "chip")
        try:
            chip = library.chip(s.chip).profile
        except RuntimeError:  # checks.py says it above
            return
        text = "{width} x {height} pixels of {pitch:.4g} µm" if chip.width else "Any number of pixels of {pitch:.4g} µm"
        layout.label(text=say(text, width=chip.width, height=chip.height, pitch=chip.pixel_pitch_m * 1e6))
        width, height = settings.size(scene)
        if width <= chip.width and height <= chip.height and (width, height) != (chip.width, chip.height):
            layout.operator("pecs.chip_resolution", icon="FULLSCREEN_ENTER")
        sensor = s.sensor
        for name in ("model", "readout", "seed", "no_noise"):
            layout.prop(sensor, name)


class PECS_PT_parameters(Sub, bpy.types.Panel):
    bl_label = "Parameters"
    bl_parent_id = "PECS_PT_sensor"
    bl_options = {"DEFAULT_CLOSED"}

    def fill(self, layout, scene, s) -> None:
        try:
            known = sensor_settings.parameters(s)
        except RuntimeError:
            return
        for index, one in enumerate(s.sensor.overrides):
            entry = known.get(one.name, {"unit": "?", "range": (0, 0)})
            column = layout.column(align=True)
            row = column.row(align=True)
            row.alert = bool(sensor_settings.wrong(one, known))
            row.prop(one, "value", text=one.name)
            row.operator("pecs.override_remove", icon="X", text="").index = index
            low, high = entry["range"]
            unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
            row = column.row()
            row.alignment = "RIGHT"
            row.label(text=say("{low:g} to {high:g}{unit}", low=low, high=high, unit=unit))
        layout.operator("pecs.override_add", icon="ADD")


CLASSES = (PECS_PT_sensor, PECS_PT_parameters)
