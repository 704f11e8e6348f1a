# SPDX-License-Identifier: GPL-3.0-or-later
"""PECS in Blender: spectral renders through a real lens."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import bpy

    from .job.options import Options

_commands = []


def render(
    scene: str | Path | bpy.types.Scene,
    output: str | Path,
    options: Options | None = None,
    *,
    exists: str = "continue",
    **how: Any,
) -> Path:
    """Render a scene into an EXR stack in this process, as the command `pecs_blender render` does.

    The file that is open is replaced. After the render, the scene's .blend is open as it was before, or an empty file
    after a scene folder; references to data of Blender from before the call are invalid. If `scene` is one of the open
    file, the open file is then a temporary copy, and `bpy.data.filepath` its path: save it under a name of yours.

    Parameters
    ----------
    scene : str, path or bpy.types.Scene
        .blend file, scene folder, or scene of the open file, of which a temporary copy is rendered.
    output : str or path
        Folder of the stack. A stack of the same render is continued.
    options : pecs_blender.Options, optional
        Options by their names in Python, such as `Options(fps=1000, frames="0:100", width=640, height=360,
        time="adaptive")`. Text may have a unit (`fps="1kHz"`).
    exists : {"continue", "overwrite", "new"}
        If the folder contains another stack: an error, replace it, or write to the next free name.
    **how
        `parameters`, a list of "key=value" for a scene folder; `scene_name`, `allow_scripts` and `place` as on the
        command line.

    Returns
    -------
    path
        Folder of the stack, as `pecs.sense` and `pecs.StackReader` read it.

    Raises
    ------
    pecs.PecsError
        If an option, the scene or the folder is wrong.
    """
    from .job.in_process import render_here
    from .job.options import Options

    scene = Path(scene) if isinstance(scene, str) else scene
    return render_here(scene, Path(output), options or Options(), exists, **how)


def __getattr__(name: str) -> Any:
    if name == "Options":
        from .job.options import Options

        return Options
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


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
