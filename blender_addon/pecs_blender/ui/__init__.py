# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel and operators."""

import bpy

from . import background, live, operators, panel, settings

_CLASSES = (settings.PecsSettings, *operators.CLASSES, panel.PECS_PT_render)
_PARTS = (live,)  # with classes and properties of their own


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.pecs = bpy.props.PointerProperty(type=settings.PecsSettings)
    bpy.app.handlers.load_pre.append(background.stop_preview)
    for part in _PARTS:
        part.register()


def unregister() -> None:
    for part in reversed(_PARTS):
        part.unregister()
    if background.state.job:  # also when Blender quits
        background.state.job.stop()
    bpy.app.handlers.load_pre.remove(background.stop_preview)
    del bpy.types.Scene.pecs
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
