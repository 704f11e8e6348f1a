# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel asks for: options of `blender --command pecs render`, kept in the .blend."""

from functools import cache

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ..core.plan import passes


@cache
def _names(room: str, pattern: str) -> list[str]:
    import pecs

    return sorted(path.stem for path in pecs.data_dir(room).glob(pattern))


_lens_items: list[tuple] = []  # Blender wants the very same texts each time


def _lenses(_self, _context) -> list[tuple]:
    if not _lens_items:
        _lens_items.append(("none", "Scene's camera", "Render radiance with the camera as Blender has it"))
        _lens_items.extend((name, name, "A lens of the library") for name in _names("lens_data/lenses", "*.json"))
    return _lens_items


def _searched(room: str, pattern: str, *more: str):
    return lambda _self, _context, text: [n for n in (*more, *_names(room, pattern)) if text.lower() in n]


class PecsSettings(bpy.types.PropertyGroup):
    output: StringProperty(
        name="Stack",
        subtype="DIR_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        default="//stack",
        description="Folder of the EXR stack",
    )
    whole_range: BoolProperty(name="Frame range", default=True, description="Cover the scene's frame range")
    frames: IntProperty(name="Instants", default=100, min=1, description="From the scene's first frame on")
    rate_hz: FloatProperty(name="Instants per second", default=1000, min=1e-3, max=1e9, description="Of scene time")

    lens: EnumProperty(name="Lens", items=_lenses, description="It stands where the scene's camera does")
    focus_m: FloatProperty(name="Focus", default=2.0, min=1e-3, precision=3, subtype="DISTANCE", unit="LENGTH")
    fnumber: FloatProperty(name="f-number", default=4.0, min=0.1, max=1000)
    film_width_mm: FloatProperty(
        name="Film (mm)", default=6.2208, min=0.01, max=1000, precision=4, description="Its width"
    )

    bands: IntProperty(name="Bands", default=6, min=1, max=64, description="Wavelengths; three share a pass")
    placement: EnumProperty(
        name="Placement",
        items=[
            ("gauss", "Gauss", "Quadrature for the chip under the scene's lamps"),
            ("strata", "Strata", "Medians of equal shares of the light"),
            ("uniform", "Uniform", "Equal intervals"),
        ],
    )
    chip: StringProperty(name="Chip", default="imx636", search=_searched("sensor/chips", "*.json"))
    illuminant: StringProperty(
        name="Light",
        default="d65",
        description="Spectrum of RGB lamps and skies: a name, CSV file, blackbody:T or daylight:T",
        search=_searched("lens_data/spectra", "*.csv", "blackbody:2856", "daylight:6500"),
    )
    samples: IntProperty(name="Samples", default=8, min=1, max=65536, description="Paths per pixel and band")

    @property
    def pass_count(self) -> int:
        return len(passes(self.bands))


def instants(scene: bpy.types.Scene) -> int:
    settings = scene.pecs
    if not settings.whole_range:
        return settings.frames
    duration_s = (scene.frame_end - scene.frame_start + 1) * scene.render.fps_base / scene.render.fps
    return max(1, round(duration_s * settings.rate_hz))


def arguments(scene: bpy.types.Scene) -> list[str]:
    """Of `pecs render`, but for output, frames and size."""
    s = scene.pecs
    pairs = {
        "--scene-name": scene.name,
        "--bands": s.bands,
        "--placement": s.placement,
        "--chip": s.chip,
        "--illuminant": s.illuminant,
        "--fps": repr(s.rate_hz),
        "--samples": s.samples,
        "--lens": s.lens,
    }
    if s.lens != "none":
        pairs |= {
            "--focus-m": f"{s.focus_m:.6g}",
            "--fnumber": f"{s.fnumber:.6g}",
            "--film-width-mm": f"{s.film_width_mm:.6g}",
        }
    return [str(word) for pair in pairs.items() for word in pair]
