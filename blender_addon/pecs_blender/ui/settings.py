# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel asks for: options of `pecs render` (render/options.py), kept in the .blend."""

import dataclasses
import math
from functools import cache
from zlib import crc32

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..render.layers import KINDS
from ..render.options import DEFAULTS, LAYERS, RULES, Options, flag
from ..render.plan import passes
from ..render.resources import BYTES_PER_VALUE
from . import library
from .interface import CONTEXT, say
from .preferences import preferences

# Options in the panel: their label, and what Blender adds. 0 stands for one that is not given.
SHOWN = {
    "focus_m": (
        "Focus",
        {"precision": 3, "subtype": "DISTANCE", "unit": "LENGTH", "description": "What is sharp; 0: infinity"},
    ),
    "fnumber": ("f-number", {"description": "Of the lens; 0: wide open"}),
    "film_width_mm": ("Film width (mm)", {"precision": 4, "description": "Of the lens camera; 0: the chip's"}),
    "film_shift_mm": ("Film shift (mm)", {"size": 2, "precision": 3}),
    "bands": ("Bands", {}),
    "bands_per_pass": ("Bands in a pass", {}),
    "placement": ("Placement", {}),
    "min_nm": ("Shortest wavelength (nm)", {}),
    "max_nm": ("Longest wavelength (nm)", {}),
    "chip": ("Chip", {"search": library.search(lambda: library.names("chip"))}),
    "illuminant": (
        "Lamps' spectrum",
        {
            "search": library.search(library.spectra),
            "description": "Of lamps and skies that have only a colour: a name, FILE.csv, blackbody:T or daylight:T",
        },
    ),
    "light_scale": ("Light scale", {}),
    "samples": ("Samples", {}),
    "noise_target": (
        "Noise target",
        {
            "precision": 3,
            "description": "Chooses the samples: noise of the log of light, in the chip's contrast thresholds; 0: off",
        },
    ),
    "denoise": ("Denoise", {}),
    "light_tree": ("Light tree", {}),
    "seed": ("Seed", {}),
    "device": ("Device", {}),
    "threads": ("Threads", {}),
    "fps": ("Instants per second", {}),
    "time": ("Steps", {"default": "adaptive"}),  # few see the frames
    "step_px": ("Most motion (px)", {}),
    "moving_px": (
        "Moving part (px)",
        {"description": "X0:Y0:X1:Y1 from the top left: only this changes, the rest is rendered once; if empty, all"},
    ),
}
_CHOICES = {
    "gauss": "Quadrature nodes for the chip's response under all lamps together",
    "strata": "Medians of equal shares of the light",
    "uniform": "Evenly",
    "adaptive": "Keyframes, and the motion between them",
}
_OF_LENS = ("focus_m", "fnumber", "film_width_mm", "film_shift_mm")
CHIPS_OWN = "pecs"  # the pixel model whose parameters are the chip's
UNKNOWN = "{name}: no parameter of this chip or pixel"
_KINDS = {f.name: f.type.removesuffix(" | None") for f in dataclasses.fields(Options)}


def _property(name: str):
    label, more = SHOWN[name]
    rule, default, kind = RULES[name], more.get("default", DEFAULTS[name]), _KINDS[name]
    own_text = more.get("description")
    text = own_text or rule.help[0].upper() + rule.help[1:]
    more = {key: value for key, value in more.items() if key not in ("default", "description")}
    if name == "fnumber":
        more["update"] = _not_wider
    if rule.choices:
        items = [
            (str(c), str(c).capitalize() if str(c).islower() else str(c), _CHOICES.get(c, "")) for c in rule.choices
        ]
        return EnumProperty(name=label, items=items, default=str(default), description=text)
    if kind == "bool":
        return BoolProperty(name=label, default=default, description=text, **more)
    if kind == "str" or rule.parse:
        return StringProperty(name=label, default=default or "", description=text, **more)
    low = 0 if default is None else max(rule.low, 1e-6 if rule.above == 0 else rule.above)
    bounds = {"min": low} if low > -math.inf else {}
    bounds |= {"max": rule.high} if rule.high < math.inf else {}
    text += "; 0: not given" if default is None and not own_text else ""
    make = {"int": IntProperty, "float": FloatProperty, "Sequence[float]": FloatVectorProperty}[kind]
    return make(name=label, default=default or 0, description=text, **bounds, **more)


def _not_wider(self, _context) -> None:
    """A stop beyond the lens's own becomes wide open."""
    try:
        widest = library.lens_info(self.lens)["fnumber"] if has_lens(self) else 0
    except RuntimeError:  # checks.py says so
        return
    if 0 < self.fnumber < widest:
        self.fnumber = 0


def lenses(self, context, text: str) -> list:
    """To choose from, by a part of the name or of what it is."""
    try:
        film = film_mm(context.scene)
    except RuntimeError:  # an unknown chip
        film = None
    every = [(library.SCENES_CAMERA, say("The scene's camera")), *library.lenses(film)]
    return library.search(lambda: every)(self, context, text)


def _forget_version(self, _context) -> None:
    self.last_stack = ""


@cache  # Blender wants the very same texts each time
def _model_items() -> list[tuple]:
    import pecs

    return [_item(m["name"], m["name"], m["source"]) for m in pecs.models()]


@cache
def _format_items() -> list[tuple]:
    import pecs

    known = [_item(f["name"], f["name"], f["description"]) for f in pecs.event_formats() if f["writes"]]
    return [("auto", "By the file's name", "The ending says it", 0), *known]


def _item(identifier: str, name: str, text: str) -> tuple:
    """An enum is saved as its number: one that does not change when others are added. The default's is 0."""
    return identifier, name, text, 0 if identifier == CHIPS_OWN else crc32(identifier.encode()) >> 1


class PecsOverride(bpy.types.PropertyGroup):
    """A value in place of the profile's. Text: floats of Blender show 3e-06 as 0.000."""

    name: StringProperty(name="Parameter")
    value: StringProperty(name="Value", description="A number in the parameter's unit and range")


class PecsSensor(bpy.types.PropertyGroup):
    model: EnumProperty(name="Pixel", items=lambda _s, _c: _model_items(), description="How pixels make events")
    seed: IntProperty(name="Seed", default=1, min=0, description="Of all random numbers of the sensor")
    no_noise: BoolProperty(
        name="Without noise", description="No photon noise, leak, background events and mismatch of pixels"
    )
    readout: EnumProperty(
        name="Readout",
        items=[
            ("chip", "Chip", "Row arbiter, rate limit and time base of the chip"),
            ("ideal", "Ideal", "Every event at once"),
        ],
        description="How events leave the chip",
    )
    overrides: CollectionProperty(type=PecsOverride)
    output: StringProperty(
        name="Events",
        subtype="FILE_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Event file; if empty, the .blend's name. Its ending says the format, unless that is chosen",
    )
    format: EnumProperty(name="Format", items=lambda _s, _c: _format_items(), description="Of the event file")
    window_ms: FloatProperty(
        name="Picture (ms)", min=0, max=1e6, description="Time of the events in one picture; 0: what is readable"
    )
    slow_motion: FloatProperty(
        name="Slow motion", min=0, max=1e7, description="How many times slower a video is; 0: about 10 s of video"
    )
    cutoff_hz: FloatProperty(
        name="Filter (Hz)",
        default=1.0,
        min=0.01,
        max=1e6,
        description="Video of the light: how fast the sum of a pixel's events is forgotten",
    )
    recording: StringProperty(
        name="Recording",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Events of a real camera, in any format, to compare with",
    )
    compare_ms: FloatProperty(
        name="Compare (ms)", min=0, max=1e7, description="Only so much from each first event; 0: all"
    )


class PecsSettings(bpy.types.PropertyGroup):
    output: StringProperty(
        name="Stack",
        subtype="DIR_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        update=_forget_version,
        description="Folder of the rendered pictures (EXR stack); if empty, the .blend's name with the ending .stack",
    )
    last_stack: StringProperty(options={"HIDDEN"})  # a new version's folder
    exists: EnumProperty(
        name="If it exists",
        items=[
            ("continue", "Continue", "Render what is missing; refused where settings differ"),
            ("overwrite", "Overwrite", "Remove it first"),
            ("new", "New version", "Where settings differ, write another beside it: _002, _003, …"),
        ],
        description="What to do with a stack that is there",
    )
    whole_range: BoolProperty(name="Scene's frame range", description="From the scene's first frame to its last")
    frames: IntProperty(
        name="Instants", default=int(DEFAULTS["frames"]), min=1, description="From the scene's first frame on"
    )
    lens: StringProperty(
        name="Lens",
        translation_context=CONTEXT,
        default=library.SCENES_CAMERA,
        search=lenses,
        search_options={"SORT", "SUGGESTION"},
        update=_not_wider,
        description="A lens by its name, a prescription's file (.json), or none: the scene's camera as Blender has it. "
        "A lens stands where the scene's camera does",
    )
    layers: EnumProperty(
        name="Layers",
        items=[(name, name.capitalize(), "") for name in LAYERS],
        options={"ENUM_FLAG"},
        description="What to render beside the light",
    )
    allow_scripts: BoolProperty(name="Allow scripts", description="Run the .blend's Python (drivers, registered texts)")
    sensor: PointerProperty(type=PecsSensor)

    @property
    def pass_count(self) -> int:
        return len(passes(self.bands, int(self.bands_per_pass)))

    @property
    def channels(self) -> int:
        """Channels per frame, of the light and all layers."""
        return self.bands + sum(len(KINDS[name].channels) for name in self.layers)


# Not in the class's body: from Python 3.14 on (Blender 5.2) it has no annotations yet.
PecsSettings.__annotations__.update({name: _property(name) for name in SHOWN})


def has_lens(settings: PecsSettings) -> bool:
    return settings.lens not in ("", library.SCENES_CAMERA)


def size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Pixels."""
    render = scene.render
    width, height = (n * render.resolution_percentage // 100 for n in (render.resolution_x, render.resolution_y))
    return width, height


def instants(scene: bpy.types.Scene) -> int:
    settings = scene.pecs
    if not settings.whole_range:
        return settings.frames
    duration_s = (scene.frame_end - scene.frame_start + 1) * scene.render.fps_base / scene.render.fps
    return max(1, round(duration_s * settings.fps))


def stack_bytes(scene: bpy.types.Scene) -> int:
    """Upper limit: uncompressed, and every frame rendered."""
    width, height = size(scene)
    return instants(scene) * scene.pecs.channels * width * height * BYTES_PER_VALUE


def focus_m(scene: bpy.types.Scene) -> float | None:
    """Blender keeps lengths in units of the scene."""
    return scene.pecs.focus_m * scene.unit_settings.scale_length or None


def film_mm(scene: bpy.types.Scene) -> tuple[float, float]:
    """Raises pecs.PecsError of a chip that cannot be read."""
    width, height = size(scene)
    width_mm = scene.pecs.film_width_mm or library.chip(scene.pecs.chip).film_width_mm(width)
    return width_mm, width_mm * height / width


def lens_now(scene: bpy.types.Scene) -> dict:
    """What is known of the lens, as it is set; raises pecs.PecsError."""
    width_mm, height_mm = film_mm(scene)
    return library.lens_info(
        scene.pecs.lens,
        focus_m=focus_m(scene),
        fnumber=plain(scene.pecs.fnumber) or None,
        film_width_mm=width_mm,
        film_height_mm=height_mm,
    )


def plain(value: float) -> float:
    """Blender's floats are short: 4.15 is not 4.150000095."""
    return float(f"{value:.6g}")


def _words(scene: bpy.types.Scene, name: str) -> list[str]:
    s = scene.pecs
    value = focus_m(scene) if name == "focus_m" else getattr(s, name)
    if name == "threads":
        value = value or preferences().threads
    if not value or name in _OF_LENS and not has_lens(s) or name == "moving_px" and s.time != "uniform":
        return []
    kind = _KINDS[name]
    if kind == "bool":
        return [flag(name)]
    if kind == "Sequence[float]":
        return [flag(name), *(f"{v:.6g}" for v in value)] if any(value) else []
    if name == "chip":
        value = library.find("chip", value)
    return [flag(name), f"{value:.6g}" if isinstance(value, float) else str(value)]


def render_arguments(scene: bpy.types.Scene) -> list[str]:
    """Of `pecs render`, but for output and size of the picture."""
    s = scene.pecs
    lens = library.find("lens", s.lens) if has_lens(s) else library.SCENES_CAMERA
    words = ["--scene-name", scene.name, "--lens", lens]
    for name in SHOWN:
        words += _words(scene, name)
    words += ["--layers", ",".join(sorted(s.layers))] if s.layers else []
    return words + (["--allow-scripts"] if s.allow_scripts else [])


def exists_words(scene: bpy.types.Scene) -> list[str]:
    return {"continue": [], "overwrite": ["--overwrite"], "new": ["--new-version"]}[scene.pecs.exists]


def parameters(settings) -> dict[str, dict]:
    """Of the chip, and of the pixel model where it has some: {key: {"unit", "value", "range": (min, max)}}. Raises
    pecs.PecsError of a chip that cannot be read."""
    import pecs

    values = library.chip(settings.chip).profile.info["values"]
    known = {key: {**entry, "of": "chip"} for key, entry in values.items()}
    model = next((m for m in pecs.models() if m["name"] == settings.sensor.model), {"parameters": []})
    for p in model["parameters"]:
        known[p["key"]] = {"unit": p["unit"], "value": p["value"], "range": [p["min"], p["max"]], "of": "model"}
    return known


def wrong(override, known: dict[str, dict]) -> str:
    """What is wrong with an override; nothing if it is well."""
    if override.name not in known:
        return say(UNKNOWN, name=override.name)
    low, high = known[override.name]["range"]
    try:
        well = low <= float(override.value) <= high
    except ValueError:
        well = False
    text = "{name}: got {value!r}, wanted a number in [{low:g}, {high:g}]"
    return "" if well else say(text, name=override.name, value=override.value, low=low, high=high)


def sensor_arguments(scene: bpy.types.Scene) -> list[str]:
    """Of `pecs sense`, but for stack, output, chip and threads."""
    sensor = scene.pecs.sensor
    words = ["--seed", str(sensor.seed), "--model", sensor.model, "--readout", sensor.readout]
    words += ["--format", sensor.format] if sensor.format != "auto" else []
    words += ["--no-noise"] if sensor.no_noise else []
    known = parameters(scene.pecs) if sensor.overrides else {}
    for one in sensor.overrides:
        option = "--param" if known.get(one.name, {}).get("of") == "model" else "--set"
        words += [option, f"{one.name}={one.value}"]
    return words


CLASSES = (PecsOverride, PecsSensor, PecsSettings)


def register() -> None:
    bpy.types.Scene.pecs = PointerProperty(type=PecsSettings)


def unregister() -> None:
    del bpy.types.Scene.pecs
