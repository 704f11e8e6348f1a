# SPDX-License-Identifier: GPL-3.0-or-later
"""Preferences of the extension; their defaults if it is not installed as one (bpy as a module)."""

from pathlib import Path
from types import SimpleNamespace

import bpy
from bpy.props import IntProperty, StringProperty

from .interface import props

ROOT = __package__.rpartition(".")[0]
_DEFAULTS = {"threads": 0, "output_folder": "//", "lens_folder": "", "chip_folder": ""}


class PecsPreferences(bpy.types.AddonPreferences):
    bl_idname = ROOT

    threads: IntProperty(
        name="Threads",
        default=_DEFAULTS["threads"],
        min=0,
        max=1024,
        description="Threads of renders and simulations if the scene sets none; 0: all cores. The result does not "
        "depend on it",
    )
    output_folder: StringProperty(
        name="Output Folder",
        default=_DEFAULTS["output_folder"],
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Default folder of stacks and events; // is the folder of the .blend",
    )
    lens_folder: StringProperty(
        name="Own Lenses",
        subtype="DIR_PATH",
        description="Folder with lens prescriptions (.json, .zmx, .dat) for the lens menu",
    )
    chip_folder: StringProperty(
        name="Own Chips",
        subtype="DIR_PATH",
        description="Folder with chip profiles (.json) for the chip menu",
    )

    def draw(self, _context) -> None:
        self.layout.use_property_split = True
        props(self.layout, self, *_DEFAULTS)


def preferences() -> PecsPreferences | SimpleNamespace:
    addon = bpy.context.preferences.addons.get(ROOT)
    return addon.preferences if addon and addon.preferences else SimpleNamespace(**_DEFAULTS)


def own_folder(kind: str) -> Path | None:
    """kind: "lens" or "chip"."""
    text = getattr(preferences(), f"{kind}_folder")
    return Path(bpy.path.abspath(text)) if text else None
