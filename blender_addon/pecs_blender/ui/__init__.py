# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel and operators."""

import bpy

from . import background, operators, panel, settings

_CLASSES = (settings.PecsSettings, *operators.CLASSES, panel.PECS_PT_render)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.pecs = bpy.props.PointerProperty(type=settings.PecsSettings)
    bpy.app.handlers.load_pre.append(background.stop_preview)


def unregister() -> None:
    if background.state.job:  # also when Blender quits
        background.state.job.stop()
    bpy.app.handlers.load_pre.remove(background.stop_preview)
    del bpy.types.Scene.pecs
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
