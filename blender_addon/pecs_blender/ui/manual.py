# SPDX-License-Identifier: GPL-3.0-or-later
"""The manual's page, for the button and for Blender's own *Online Manual* in the menu of every field: a file, so that
it is of this very version."""

from pathlib import Path

import bpy

from . import paths

_TRIED = (
    Path(__file__).parents[1] / "manual/panel.html",
    Path(__file__).parents[3] / "docs/start/panel.md",
)  # zip; checkout


def _page() -> Path:
    return next((path for path in _TRIED if path.is_file()), _TRIED[0])


def pages() -> tuple[str, tuple[tuple[str, str], ...]]:
    """As bpy.utils.register_manual_map wants it."""
    ours = ("bpy.ops.pecs.*", "bpy.types.pecs*", "bpy.types.scene.pecs*")
    return _page().as_uri(), tuple((pattern, "") for pattern in ours)


class PECS_OT_manual(bpy.types.Operator):
    """Open the manual's page in the browser"""

    bl_idname = "pecs.manual"
    bl_label = "Manual"

    def execute(self, _context):
        self.report({"INFO"}, paths.open_outside(_page()))
        return {"FINISHED"}


CLASSES = (PECS_OT_manual,)
