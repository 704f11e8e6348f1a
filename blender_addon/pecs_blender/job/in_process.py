# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders from a Python program that has bpy (pecs_blender.render)."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import bpy

from ..scene.blend import save_copy
from ..scene.cycles import empty_scene
from .options import Options
from .render import render
from .resolve import opened
from .resources import Restart


def render_here(scene: bpy.types.Scene | Path, output: Path, options: Options, exists: str, **how: Any) -> Path:
    """The stack's folder. The spectral scene does not stay open: the file is opened again, or an empty one."""
    with tempfile.TemporaryDirectory(prefix="pecs_") as folder:
        if isinstance(scene, bpy.types.Scene):
            how["scene_name"] = scene.name
            scene = save_copy(Path(folder))
        try:
            while True:
                try:
                    source, plan = opened(scene, options, **how)
                    return render(source, output, plan, exists)
                except Restart:  # memory has grown; opening the scene again frees it
                    pass
        finally:
            if scene.suffix == ".blend" and scene.is_file():
                scripts = how.get("allow_scripts", False)
                bpy.ops.wm.open_mainfile(filepath=str(scene), load_ui=False, use_scripts=scripts)
            else:
                empty_scene()
