# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and operators. Each module has CLASSES, and register() and unregister() where there is more; those that others
build on come first."""

import bpy

from . import (
    background,
    camera_setup,
    chip_lens,
    event_operators,
    languages,
    light_probe,
    live_panel,
    menus,
    operators,
    panel,
    panel_spectra,
    preferences,
    presets,
    scene_checks,
    settings,
)

_MODULES = (
    languages,
    preferences,
    settings,
    background,
    operators,
    event_operators,
    chip_lens,
    presets,
    camera_setup,
    light_probe,
    scene_checks,
    panel,
    panel_spectra,
    menus,
    live_panel,
)


def register() -> None:
    for module in _MODULES:
        for cls in getattr(module, "CLASSES", ()):
            bpy.utils.register_class(cls)
        if hasattr(module, "register"):
            module.register()


def unregister() -> None:
    for module in reversed(_MODULES):
        if hasattr(module, "unregister"):
            module.unregister()
        for cls in reversed(getattr(module, "CLASSES", ())):
            bpy.utils.unregister_class(cls)
