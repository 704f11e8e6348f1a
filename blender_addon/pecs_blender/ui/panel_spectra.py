# SPDX-License-Identifier: GPL-3.0-or-later
"""Spectra of materials, lamps and worlds: the custom properties of docs/reference/render.md as fields with a search
menu. The .blend stores only the custom properties."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from . import library
from .interface import props

_TEXTS = {
    "pecs_reflectance": ("Reflectance", "Reflectance spectrum of the surface, instead of its colours", library.spectra),
    "pecs_emission": (
        "Emission",
        "Emission spectrum of the material; the luminance of its colour is kept",
        library.spectra,
    ),
    "pecs_glass": ("Glass", "Dispersion: name of a glass, or an Abbe number", library.glasses),
    "pecs_spectrum": ("Spectrum", "Spectrum of the light; the luminance of its colour is kept", library.spectra),
}
_HOLDERS = {
    bpy.types.Material: ("pecs_reflectance", "pecs_emission", "pecs_glass"),
    bpy.types.Light: ("pecs_spectrum",),
    bpy.types.World: ("pecs_spectrum",),
}


def field(key: str) -> str:
    """Name of the RNA property of a custom property; it differs, since Blender 4.5 stores both in one place."""
    return f"{key}_field"


def _property(key: str):
    label, text, names = _TEXTS[key]

    def get(self) -> str:
        value = self.get(key, "")
        return value if isinstance(value, str) else f"{value:g}"

    def set_(self, value: str) -> None:
        """Stores a number as a float, as the renderer requires; an empty text deletes the property."""
        try:
            self[key] = float(value)
        except ValueError:
            if value:
                self[key] = value
            elif key in self:
                del self[key]

    text += ". A number, a name of the library, FILE.csv, blackbody:T or daylight:T" if key != "pecs_glass" else ""
    return StringProperty(
        name=label,
        description=text,
        get=get,
        set=set_,
        search=library.search(names),
        search_options={"SUGGESTION"},
        options=set(),
    )


def _holder(context, tab: str):
    """The material, light or world in a tab of the properties editor."""
    return getattr(context, "light" if tab == "data" else tab, None)


class _Spectra:
    bl_label = "PECS: Spectra"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context) -> bool:
        return bool(_holder(context, cls.bl_context))

    def draw(self, context) -> None:
        self.layout.use_property_split, self.layout.use_property_decorate = True, False
        holder = _holder(context, self.bl_context)
        keys = next(keys for kind, keys in _HOLDERS.items() if isinstance(holder, kind))
        props(self.layout, holder, *map(field, keys))


class PECS_PT_material(_Spectra, bpy.types.Panel):
    bl_context = "material"


class PECS_PT_world(_Spectra, bpy.types.Panel):
    bl_context = "world"


class PECS_PT_lamp(_Spectra, bpy.types.Panel):
    bl_context = "data"


PROPERTIES = {(holder, field(key)): _property(key) for holder, keys in _HOLDERS.items() for key in keys}
