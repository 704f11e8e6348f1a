# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and operators. A module has CLASSES, and register() and unregister() if it registers more than classes. Only
field and live_sensor can be imported without Blender."""

from importlib import import_module

MODULES = (  # a class is registered before those that refer to it
    "languages",
    "preferences",
    "settings",
    "background",
    "operators",
    "event_operators",
    "chip_lens",
    "presets",
    "camera_setup",
    "light_probe",
    "scene_checks",
    "panel",
    "panel_spectra",
    "menus",
    "live_panel",
)


def modules() -> list:
    return [import_module(f".{name}", __name__) for name in MODULES]


def register() -> None:
    import bpy

    for module in modules():
        for cls in getattr(module, "CLASSES", ()):
            bpy.utils.register_class(cls)
        if hasattr(module, "register"):
            module.register()


def unregister() -> None:
    import bpy

    for module in reversed(modules()):
        if hasattr(module, "unregister"):
            module.unregister()
        for cls in reversed(getattr(module, "CLASSES", ())):
            bpy.utils.unregister_class(cls)
