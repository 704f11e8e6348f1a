# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel asks for: options of `pecs render` (core/options.py), kept in the .blend."""

import dataclasses
import math
from functools import cache
from zlib import crc32

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ..core.options import DEFAULTS, LAYERS, RULES, Options, flag
from ..core.plan import passes


@cache
def _names(room: str, pattern: str) -> list[str]:
    import pecs

    return sorted(path.stem for path in pecs.data_dir(room).glob(pattern))


_lens_items: list[tuple] = []  # Blender wants the very same texts each time


def _lenses(_self, _context) -> list[tuple]:
    """A lens is saved as its number: one that does not change when others are added."""
    if not _lens_items:
        _lens_items.append(("none", "Scene's camera", "Render radiance with the camera as Blender has it", 0))
        for name in _names("lens_data/lenses", "*.json"):
            _lens_items.append((name, name, "A lens of the library", crc32(name.encode()) >> 1))
    return _lens_items


def _searched(room: str, pattern: str, *more: str):
    return lambda _self, _context, text: [n for n in (*more, *_names(room, pattern)) if text.lower() in n]


# Options in the panel: their label, and what Blender adds. 0 stands for one that is not given.
_SHOWN = {
    "focus_m": ("Focus", {"precision": 3, "subtype": "DISTANCE", "unit": "LENGTH"}),
    "fnumber": ("f-number", {}),
    "film_width_mm": ("Film width (mm)", {"precision": 4}),
    "bands": ("Bands", {}),
    "placement": ("Placement", {}),
    "chip": ("Chip", {"search": _searched("sensor/chips", "*.json")}),
    "illuminant": (
        "Lamps' spectrum",
        {"search": _searched("lens_data/spectra", "*.csv", "blackbody:2856", "daylight:6500")},
    ),
    "light_scale": ("Light scale", {}),
    "samples": ("Samples", {}),
    "device": ("Device", {}),
    "fps": ("Instants per second", {}),
    "time": ("Steps", {}),
    "step_px": ("Most motion (px)", {}),
}
_KINDS = {f.name: f.type.removesuffix(" | None") for f in dataclasses.fields(Options)}


def _property(name: str):
    label, more = _SHOWN[name]
    rule, default, kind = RULES[name], DEFAULTS[name], _KINDS[name]
    text = rule.help[0].upper() + rule.help[1:]
    if rule.choices:
        return EnumProperty(name=label, items=[(c, c, "") for c in rule.choices], default=default, description=text)
    if kind == "str":
        return StringProperty(name=label, default=default, description=text, **more)
    low = 0 if default is None else max(rule.low, 1e-6 if rule.above == 0 else rule.above)
    bounds = {"min": low} if low > -math.inf else {}
    bounds |= {"max": rule.high} if rule.high < math.inf else {}
    text += "; 0: not given" if default is None else ""
    make = IntProperty if kind == "int" else FloatProperty
    return make(name=label, default=default or 0, description=text, **bounds, **more)


class PecsSettings(bpy.types.PropertyGroup):
    output: StringProperty(
        name="Stack",
        subtype="DIR_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        default="//stack",
        description="Folder of the EXR stack",
    )
    overwrite: BoolProperty(name="Overwrite", description="Remove a stack that is there, instead of continuing it")
    whole_range: BoolProperty(name="Frame range", description="Cover the scene's frame range")
    frames: IntProperty(
        name="Instants", default=int(DEFAULTS["frames"]), min=1, description="From the scene's first frame on"
    )
    lens: EnumProperty(name="Lens", items=_lenses, description="It stands where the scene's camera does")
    layers: EnumProperty(
        name="Layers",
        items=[(name, name.capitalize(), "") for name in LAYERS],
        options={"ENUM_FLAG"},
        description="What to render beside the light",
    )

    @property
    def pass_count(self) -> int:
        return len(passes(self.bands))

    @property
    def channels(self) -> int:
        """Of all layers, about: for the room on the disk."""
        return self.bands + 2 * len(self.layers)


# Not in the class's body: from Python 3.14 on (Blender 5.2) it has no annotations yet.
PecsSettings.__annotations__.update({name: _property(name) for name in _SHOWN})


def instants(scene: bpy.types.Scene) -> int:
    settings = scene.pecs
    if not settings.whole_range:
        return settings.frames
    duration_s = (scene.frame_end - scene.frame_start + 1) * scene.render.fps_base / scene.render.fps
    return max(1, round(duration_s * settings.fps))


def focus_m(scene: bpy.types.Scene) -> float | None:
    """Blender keeps lengths in units of the scene."""
    return scene.pecs.focus_m * scene.unit_settings.scale_length or None


def arguments(scene: bpy.types.Scene) -> list[str]:
    """Of `pecs render`, but for output, frames and size."""
    s, given = scene.pecs, {"lens": scene.pecs.lens}
    for name in _SHOWN:
        value = focus_m(scene) if name == "focus_m" else getattr(s, name)
        of_lens = name in ("focus_m", "fnumber", "film_width_mm")
        if value and not (of_lens and s.lens == "none"):
            given[name] = f"{value:.6g}" if isinstance(value, float) else value
    if s.layers:
        given["layers"] = ",".join(sorted(s.layers))
    words = [word for name, value in given.items() for word in (flag(name), str(value))]
    return ["--scene-name", scene.name, *words]
