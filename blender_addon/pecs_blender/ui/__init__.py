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
    light,
    live,
    manual,
    menus,
    operators,
    panel,
    panel_events,
    panel_render,
    panel_sensor,
    panel_spectra,
    preferences,
    presets,
    scene_checks,
    sensor_settings,
    settings,
)

_MODULES = (
    languages,
    preferences,
    sensor_settings,
    settings,
    background,
    operators,
    event_operators,
    chip_lens,
    manual,
    presets,
    panel,
    camera_setup,
    panel_sensor,
    panel_render,
    light,
    scene_checks,
    panel_events,
    panel_spectra,
    menus,
    live,
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
