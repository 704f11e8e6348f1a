# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the panel: Blender's own menu; those that ship lie in presets/pecs."""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from . import settings

_SUBDIR = "pecs"
_OF_RENDER = ["resolution_x", "resolution_y", "resolution_percentage"]
_MORE = ["lens", "layers", "frames", "whole_range"]
_OF_SENSOR = ["model", "readout", "no_noise", "overrides", "format"]


class PECS_PT_presets(PresetPanel, bpy.types.Panel):
    bl_label = "PECS presets"
    preset_subdir = _SUBDIR
    preset_operator = "script.execute_preset"
    preset_add_operator = "pecs.preset_add"


class PECS_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the event camera"""

    bl_idname = "pecs.preset_add"
    bl_label = "PECS preset"
    preset_menu = "PECS_PT_presets"
    preset_subdir = _SUBDIR
    preset_defines = ["render = bpy.context.scene.render", "pecs = bpy.context.scene.pecs"]
    preset_values = [
        *(f"render.{name}" for name in _OF_RENDER),
        *(f"pecs.{name}" for name in (*_MORE, *settings.SHOWN)),
        *(f"pecs.sensor.{name}" for name in _OF_SENSOR),
    ]


CLASSES = (PECS_PT_presets, PECS_OT_preset_add)
_HERE = str(Path(__file__).parent)


def register() -> None:
    bpy.utils.register_preset_path(_HERE)


def unregister() -> None:
    bpy.utils.unregister_preset_path(_HERE)
