# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the panel in Blender's preset menu; presets/pecs has those of PECS."""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel
from bpy.props import StringProperty

from . import settings
from .interface import Action

_SUBDIR = "pecs"
_RENDER_KEYS = ["resolution_x", "resolution_y", "resolution_percentage"]
_OTHER_KEYS = ["lens", "layers", "frames", "whole_range"]
_STAGE_KEYS = ["diff_on", "diff_off", "afk", "afk_low_hz", "afk_high_hz", "trail", "trail_ms", "erc_mhz", "mask"]
_SENSOR_KEYS = ["model", "preset", "readout", "noise", "chip_frames", "overrides", "format", *_STAGE_KEYS]


class PECS_PT_presets(PresetPanel, bpy.types.Panel):
    bl_label = "PECS Presets"
    preset_subdir = _SUBDIR
    preset_operator = "pecs.preset"
    preset_add_operator = "pecs.preset_add"


class PECS_OT_preset(Action, bpy.types.Operator):
    """Apply a PECS preset"""

    bl_label = "Apply PECS Preset"
    bl_options = {"UNDO", "INTERNAL"}  # script.execute_preset cannot be undone

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})

    def act(self, _context) -> None:
        bpy.ops.script.execute_preset(filepath=self.filepath, menu_idname=PECS_PT_presets.__name__)
        if bpy.ops.pecs.match_lens.poll():
            bpy.ops.pecs.match_lens()  # the viewport shows what will be rendered


class PECS_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Add or remove a PECS preset"""

    bl_idname = "pecs.preset_add"
    bl_label = "PECS Preset"
    preset_menu = "PECS_PT_presets"
    preset_subdir = _SUBDIR
    preset_defines = ["render = bpy.context.scene.render", "pecs = bpy.context.scene.pecs"]
    preset_values = [
        *(f"render.{name}" for name in _RENDER_KEYS),
        *(f"pecs.{name}" for name in (*_OTHER_KEYS, *settings.SHOWN)),
        *(f"pecs.sensor.{name}" for name in _SENSOR_KEYS),
    ]


_HERE = str(Path(__file__).parent)


def register() -> None:
    bpy.utils.register_preset_path(_HERE)


def unregister() -> None:
    bpy.utils.unregister_preset_path(_HERE)
