# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and operators. A module's Blender classes are registered in the order of their definition, then its register()
is called, if it has one. Only field and live_sensor can be imported without Blender. Imports spectral, scene, camera,
truth and job."""

from importlib import import_module

MODULES = (  # a class is registered before those that refer to it
    "preferences",
    "settings",
    "paths",
    "background",
    "operators",
    "event_view",
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


def classes(module) -> list[type]:
    """Blender classes that a module defines, in their order."""
    import bpy

    values = (value for value in vars(module).values() if isinstance(value, type))
    return [c for c in values if issubclass(c, bpy.types.bpy_struct) and c.__module__ == module.__name__]


def register() -> None:
    import bpy

    for module in modules():
        for cls in classes(module):
            bpy.utils.register_class(cls)
        if hasattr(module, "register"):
            module.register()


def unregister() -> None:
    import bpy

    for module in reversed(modules()):
        if hasattr(module, "unregister"):
            module.unregister()
        for cls in reversed(classes(module)):
            bpy.utils.unregister_class(cls)
