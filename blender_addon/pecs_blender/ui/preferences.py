# SPDX-License-Identifier: GPL-3.0-or-later
"""Preferences of the extension, and what they are where it is not installed as one (bpy as a module)."""

from pathlib import Path
from types import SimpleNamespace

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

ROOT = __package__.rpartition(".")[0]
_DEFAULTS = {"threads": 0, "output_folder": "//", "lens_folder": "", "chip_folder": "", "save_first": False}


class PecsPreferences(bpy.types.AddonPreferences):
    bl_idname = ROOT

    threads: IntProperty(
        name="Threads",
        default=_DEFAULTS["threads"],
        min=0,
        max=1024,
        description="Of renders and simulations where the scene does not say; 0: all cores. The result is the same",
    )
    output_folder: StringProperty(
        name="Output folder",
        default=_DEFAULTS["output_folder"],
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Where stacks and events go whose place is not given; // is the .blend's own folder",
    )
    lens_folder: StringProperty(
        name="Own lenses", subtype="DIR_PATH", description="A folder of lens prescriptions (.json) to choose from"
    )
    chip_folder: StringProperty(
        name="Own chips", subtype="DIR_PATH", description="A folder of chip profiles (.json) to choose from"
    )
    save_first: BoolProperty(
        name="Save before a render",
        description="Renders are of the file as saved: save it first. Otherwise their buttons wait until it is",
    )

    def draw(self, _context) -> None:
        self.layout.use_property_split = True
        for name in _DEFAULTS:
            self.layout.prop(self, name)


def preferences() -> PecsPreferences | SimpleNamespace:
    addon = bpy.context.preferences.addons.get(ROOT)
    return addon.preferences if addon and addon.preferences else SimpleNamespace(**_DEFAULTS)


def own_folder(kind: str) -> Path | None:
    """kind: "lens" or "chip"."""
    text = getattr(preferences(), f"{kind}_folder")
    return Path(bpy.path.abspath(text)) if text else None


CLASSES = (PecsPreferences,)
