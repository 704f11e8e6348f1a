# SPDX-License-Identifier: GPL-3.0-or-later
"""PECS in Blender: spectral renders through a real lens."""

_commands = []


def register() -> None:
    """As an extension: `blender --command pecs ...`, and the panel in the render properties."""
    import bpy

    from . import ui
    from .cli import main

    _commands.append(bpy.utils.register_cli_command("pecs", lambda argv: main(list(argv))))
    ui.register()


def unregister() -> None:
    import bpy

    from . import ui

    ui.unregister()
    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
