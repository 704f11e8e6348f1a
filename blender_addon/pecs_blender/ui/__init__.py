# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and operators. Only field and live_sensor can be imported without Blender. Imports spectral, scene, camera,
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


def add(module) -> None:
    """Registers what a module has of these: classes, in the order of their definition, PROPERTIES {(type, name):
    property}, MENUS {menu: function that draws its entry} and on_load; then calls its register(), if it has one."""
    import bpy

    for cls in classes(module):
        bpy.utils.register_class(cls)
    for (owner, name), value in getattr(module, "PROPERTIES", {}).items():
        setattr(owner, name, value)
    for menu, draw in getattr(module, "MENUS", {}).items():
        getattr(bpy.types, menu).append(draw)
    if hasattr(module, "on_load"):
        bpy.app.handlers.load_pre.append(module.on_load)
    if hasattr(module, "register"):
        module.register()


def remove(module) -> None:
    """Undoes `add`, after the module's unregister()."""
    import bpy

    if hasattr(module, "unregister"):
        module.unregister()
    if hasattr(module, "on_load"):
        bpy.app.handlers.load_pre.remove(module.on_load)
    for menu, draw in getattr(module, "MENUS", {}).items():
        getattr(bpy.types, menu).remove(draw)
    for owner, name in getattr(module, "PROPERTIES", {}):
        delattr(owner, name)
    for cls in reversed(classes(module)):
        bpy.utils.unregister_class(cls)


def register() -> None:
    for module in modules():
        add(module)


def unregister() -> None:
    for module in reversed(modules()):
        remove(module)
