# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel and operators."""

import bpy

from . import operators, panel, settings

_CLASSES = (settings.PecsSettings, *operators.CLASSES, panel.PECS_PT_render)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.pecs = bpy.props.PointerProperty(type=settings.PecsSettings)


def unregister() -> None:
    if job := operators.running():  # also when Blender quits
        job.stop()
    del bpy.types.Scene.pecs
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
