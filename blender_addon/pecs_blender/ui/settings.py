# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the panel, stored in the .blend: options of `pecs render` (job/options.py) and of `pecs sense`, `view`
and `compare`."""

import dataclasses
import math
from functools import cache
from pathlib import Path
from zlib import crc32

import bpy
import pecs
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
from pecs._arguments import flag

from ..job.options import CYCLES_ONLY, DEFAULTS, RULES, SAMPLES, Options
from ..job.resolve import film_width_mm_of
from ..job.resources import BYTES_PER_VALUE
from ..spectral.bands import passes
from ..truth import LAYERS, layer_class
from . import disk, library
from .preferences import preferences

# Render options in the panel: label, and arguments of the Blender property. 0 stands for an option that is not set.
SHOWN = {
    "focus_m": (
        "Focus",
        {"precision": 3, "subtype": "DISTANCE", "unit": "LENGTH", "description": "Focus distance; 0: infinity"},
    ),
    "fnumber": ("f-number", {"description": "f-number of the lens; 0: wide open"}),
    "film_width_mm": (
        "Film (mm)",
        {"precision": 4, "description": "Film width of the lens camera; 0: width of the chip"},
    ),
    "film_shift_mm": ("Shift (mm)", {"size": 2, "precision": 3}),
    "bands": (
        "Bands",
        {"description": "Number of bands; a pass renders three. 0: as few as the scene's colours and lamps allow"},
    ),
    "bands_per_pass": ("Bands/Pass", {}),
    "placement": ("Placement", {}),
    "min_nm": ("From (nm)", {}),
    "max_nm": ("To (nm)", {}),
    "chip": ("Chip", {"search": library.search(lambda: library.names("chip"))}),
    "illuminant": ("Lamps", {"search": library.search(library.spectra)}),
    "light_scale": ("Light Scale", {}),
    "samples": (
        "Samples",
        {
            "description": "Paths per sensor pixel and band; 0: "
            f"{SAMPLES['adaptive']} with adaptive steps, {SAMPLES['uniform']} with uniform ones"
        },
    ),
    "noise_events": (
        "Noise Events",
        {
            "precision": 2,
            "description": "Chooses the number of samples so that at most this share of the events comes from the "
            "noise of the renderer; 0: off",
        },
    ),
    "no_denoise": ("Keep Noise", {}),
    "light_tree": ("Light Tree", {}),
    "seed": ("Render Seed", {}),
    "engine": ("Engine", {}),
    "device": ("Device", {}),
    "threads": ("Threads", {}),
    "fps": ("Rate (Hz)", {}),
    "time": ("Steps", {"default": "adaptive"}),  # most users want events, not frames
    "step_px": ("Motion (px)", {}),
    "moving_px": ("Region (px)", {}),
}
_DESCRIPTIONS = {
    "means": "Means over intervals of the spectrum",
    "gauss": "Single wavelengths: quadrature nodes for the chip's response to the sum of all lamps",
    "uniform": "Single wavelengths, equally spaced",
    "adaptive": "Keyframes, and the motion between them",
    "cycles": "Traces paths of light",
    "eevee": "Draws direct light on the graphics card; no lens, no light between surfaces",
}
_LAYERS = {
    "depth": "Distance to the camera's centre and along its axis, in m",
    "normal": "Unit normals of the surfaces in the camera's axes",
    "motion": "Motion of the surfaces to the next rendered frame, in px",
    "objects": "Number of the object at each pixel; objects.json lists names, classes and boxes",
}
_LENS_OPTIONS = ("focus_m", "fnumber", "film_width_mm", "film_shift_mm")
DEFAULT_MODEL = "pecs"
UNKNOWN = "{name}: not a parameter of this chip or pixel model"
_KINDS = {f.name: f.type.removesuffix(" | None") for f in dataclasses.fields(Options)}


def _property(name: str):
    label, more = SHOWN[name]
    rule, default, kind = RULES[name], more.get("default", DEFAULTS[name]), _KINDS[name]
    own_text = more.get("description")
    text = own_text or rule.help[0].upper() + rule.help[1:]
    more = {key: value for key, value in more.items() if key not in ("default", "description")}
    if name in _UPDATES:
        more["update"] = _UPDATES[name]
    if rule.choices:
        items = [
            (str(c), str(c).capitalize() if str(c).islower() else str(c), _DESCRIPTIONS.get(c, ""))
            for c in rule.choices
        ]
        return EnumProperty(name=label, items=items, default=str(default), description=text)
    if kind == "bool":
        return BoolProperty(name=label, default=default, description=text, **more)
    if kind == "str" or rule.parse and kind not in ("int", "float"):
        return StringProperty(name=label, default=default or "", description=text, **more)
    low = 0 if default is None else max(rule.low, 1e-6 if rule.above == 0 else rule.above)
    bounds = {"min": low} if low > -math.inf else {}
    bounds |= {"max": rule.high} if rule.high < math.inf else {}
    text += "; 0: not given" if default is None and not own_text else ""
    make = {"int": IntProperty, "float": FloatProperty, "Sequence[float]": FloatVectorProperty}[kind]
    return make(name=label, default=default or 0, description=text, **bounds, **more)


def _limit_aperture(self, _context) -> None:
    """Sets an f-number below the lens's minimum to wide open."""
    try:
        widest = library.lens_info(self.lens)["fnumber"] if has_lens(self) else 0
    except RuntimeError:  # checks.py reports it
        return
    if 0 < self.fnumber < widest:
        self.fnumber = 0


def _fit_to_chip(self, _context) -> None:
    """A picture that is larger than the chip gets the chip's size, as does the live view."""
    scene = self.id_data
    try:
        chip = library.chip(self.chip)
    except RuntimeError:  # checks.py reports it
        return
    if not (chip.width and chip.height):
        return
    width, height = size(scene)
    if width > chip.width or height > chip.height:
        set_size(scene.render, chip.width, chip.height)
    scene.pecs_live.width, scene.pecs_live.height = chip.width, chip.height


_UPDATES = {"fnumber": _limit_aperture, "chip": _fit_to_chip}


def lenses(self, context, text: str) -> list:
    """Search callback over names and descriptions of the lenses."""
    try:
        film = film_mm(context.scene)
    except RuntimeError:  # invalid chip
        film = None
    every = [(library.SCENES_CAMERA, "The scene's camera"), *library.lenses(film)]
    return library.search(lambda: every)(self, context, text)


def _forget_version(self, _context) -> None:
    self.last_stack = ""


_models = cache(pecs.models)


@cache
def published() -> dict[str, dict]:
    """Settings of other simulators (`pecs presets`), by name."""
    return {preset["name"]: preset for preset in pecs.presets()}


def _take_model(self, _context) -> None:
    if self.preset in published() and self.model != published()[self.preset]["model"]:
        self.model = published()[self.preset]["model"]


def _forget_preset(self, _context) -> None:
    if self.preset in published() and self.model != published()[self.preset]["model"]:
        self.preset = ""


@cache  # Blender requires the same string objects at each call
def _model_items() -> list[tuple]:
    return [_item(m["name"], m["name"], m["source"]) for m in _models()]


@cache
def _format_items() -> list[tuple]:
    known = [_item(f["name"], f["name"], f["description"]) for f in pecs.event_formats() if f["writes"]]
    return [("auto", "From File Name", "The file extension sets the format", 0), *known]


def _item(identifier: str, name: str, text: str) -> tuple:
    """Blender stores an enum as its number, so the number is a hash of the name; the default has 0."""
    return identifier, name, text, 0 if identifier == DEFAULT_MODEL else crc32(identifier.encode()) >> 1


class PecsOverride(bpy.types.PropertyGroup):
    """A value that overrides the profile's. A text, since Blender shows the float 3e-06 as 0.000."""

    name: StringProperty(name="Parameter")
    value: StringProperty(name="Value", description="Number in the parameter's unit and range")


class PecsSensor(bpy.types.PropertyGroup):
    model: EnumProperty(
        name="Pixel",
        items=lambda _s, _c: _model_items(),
        update=_forget_preset,
        description="Pixel model that generates the events",
    )
    preset: StringProperty(
        name="Published Setting",
        update=_take_model,
        description="Setting of another simulator, as a paper or its repository gives it: pixel model, its parameters "
        "and the values of the chip that it uses, with an ideal readout. Empty: the chip's values",
    )
    seed: IntProperty(name="Seed", default=1, min=0, description="Seed of the sensor's random numbers")
    noise: BoolProperty(
        name="Noise", default=True, description="Photon noise, leak, background activity and pixel mismatch"
    )
    readout: EnumProperty(
        name="Readout",
        items=[
            ("chip", "Chip", "Row arbiter, rate limit and timestamp resolution of the chip"),
            ("ideal", "Ideal", "Events leave the chip without delay or loss"),
        ],
        description="Readout of the events from the pixel array",
    )
    chip_frames: BoolProperty(
        name="Frames of the Chip",
        description="The frames that the pixels of a DAVIS also take, and the events that these cause: in an AEDAT4 "
        "event file, otherwise in a new folder next to the events. Exposure and rate are values of the chip",
    )
    overrides: CollectionProperty(type=PecsOverride)
    diff_on: IntProperty(
        name="Bias diff_on", min=-85, max=140, description="Offset of bias_diff_on to its factory setting"
    )
    diff_off: IntProperty(
        name="Bias diff_off", min=-35, max=190, description="Offset of bias_diff_off to its factory setting"
    )
    afk: EnumProperty(
        name="Anti-Flicker",
        items=[
            ("none", "Off", "No event is dropped"),
            ("stop", "Band Stop", "Events that flicker in the band are dropped"),
            ("pass", "Band Pass", "Only events that flicker in the band are kept"),
        ],
        description="AFK: detects flicker in blocks of 4 x 4 pixels",
    )
    afk_low_hz: FloatProperty(name="From (Hz)", default=50, min=50, max=520, description="Low end of the band")
    afk_high_hz: FloatProperty(name="To (Hz)", default=520, min=50, max=520, description="High end of the band")
    trail: EnumProperty(
        name="Trail Filter",
        items=[
            ("none", "Off", "No event is dropped"),
            ("trail", "Trail", "The first event of a burst is kept"),
            ("stc", "STC, Cut Trail", "The second event of a burst is kept"),
            ("stc-keep", "STC, Keep Trail", "The first event of a burst is dropped"),
        ],
        description="Filters bursts: events of one pixel and polarity that follow each other within the threshold",
    )
    trail_ms: FloatProperty(
        name="Within (ms)", default=10, min=1, max=100, description="Longest time between two events of a burst"
    )
    erc_mhz: FloatProperty(name="Limit (MHz)", min=0, max=3200, description="ERC: most events per second; 0: no limit")
    mask: StringProperty(
        name="Event Mask",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Text file of pixels, rows and columns whose events are dropped",
    )
    output: StringProperty(
        name="Events",
        subtype="FILE_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Event file; if empty, named after the .blend. The extension sets the format unless Format is set",
    )
    format: EnumProperty(name="Format", items=lambda _s, _c: _format_items(), description="Format of the event file")
    window_ms: FloatProperty(
        name="Frame (ms)",
        min=0,
        max=1e6,
        description="Time span of the events in one image; 0: chosen for legibility",
    )
    slow_motion: FloatProperty(
        name="Slow Motion",
        min=0,
        max=1e7,
        description="Slow-motion factor of videos; 0: chosen for about 10 s of video",
    )
    cutoff_hz: FloatProperty(
        name="Cutoff (Hz)",
        default=1.0,
        min=0.01,
        max=1e6,
        description="Cutoff frequency of the filter that reconstructs the video",
    )
    recording: StringProperty(
        name="Recording",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Event file of a real camera for the comparison, in any supported format",
    )
    compare_ms: FloatProperty(
        name="Time (ms)",
        min=0,
        max=1e7,
        description="Compared duration from the first event of each file on; 0: all",
    )


class PecsSettings(bpy.types.PropertyGroup):
    output: StringProperty(
        name="Stack",
        subtype="DIR_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        update=_forget_version,
        description="Folder of the rendered EXR stack; if empty, named after the .blend with the extension .stack",
    )
    last_stack: StringProperty(options={"HIDDEN"})  # folder of the last new version
    exists: EnumProperty(
        name="Old Stack",
        items=[
            ("overwrite", "Overwrite", "Replace the stack"),
            ("new", "New Version", "Write another stack with the suffix _002, _003, …"),
            ("continue", "Keep", "Report an error"),
        ],
        description="Action if a stack with other settings, or of the scene before an edit, exists. "
        "A stack that does not differ is continued",
    )
    whole_range: BoolProperty(
        name="Scene Range", default=True, description="Render from the scene's start frame to its end frame"
    )
    frames: IntProperty(
        name="Frames",
        default=int(DEFAULTS["frames"]),
        min=1,
        description="Number of frames, from the scene's start frame on",
    )
    lens: StringProperty(
        name="Lens",
        default=library.SCENES_CAMERA,
        search=lenses,
        search_options={"SORT", "SUGGESTION"},
        update=_limit_aperture,
        description="Lens by name, a prescription file (.json, .zmx, .dat), or none for the scene's own camera. A lens "
        "takes the position of the scene's camera",
    )
    layers: EnumProperty(
        name="Layers",
        items=[(name, name.capitalize(), _LAYERS[name]) for name in LAYERS],
        options={"ENUM_FLAG"},
        description="Ground truth to render with the light, as EXR files in the stack",
    )
    allow_scripts: BoolProperty(
        name="Allow Scripts", description="Run the Python scripts of the .blend (drivers, registered texts)"
    )
    sensor: PointerProperty(type=PecsSensor)

    @property
    def pass_count(self) -> int:
        """At least; the render chooses the number of bands if it is 0."""
        return len(passes(self.bands or 3, int(self.bands_per_pass)))

    @property
    def channels(self) -> int:
        """Channels per frame, of the light and all layers."""
        return (self.bands or 3) + sum(len(layer_class(name).channels) for name in self.layers)


# After the class body, which has no annotations yet from Python 3.14 (Blender 5.2) on.
PecsSettings.__annotations__.update({name: _property(name) for name in SHOWN})


def has_lens(settings: PecsSettings) -> bool:
    return settings.lens not in ("", library.SCENES_CAMERA)


def size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Pixels."""
    render = scene.render
    width, height = (n * render.resolution_percentage // 100 for n in (render.resolution_x, render.resolution_y))
    return width, height


def set_size(render: bpy.types.RenderSettings, width: int, height: int) -> None:
    """Square pixels."""
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1


def set_pinhole(camera: bpy.types.Camera, width_mm: float, height_mm: float, focal_mm: float) -> None:
    """A perspective camera with this film, centred."""
    camera.type, camera.sensor_fit, camera.lens = "PERSP", "HORIZONTAL", focal_mm
    camera.sensor_width, camera.sensor_height = width_mm, height_mm
    camera.shift_x = camera.shift_y = 0


def frame_count(scene: bpy.types.Scene) -> int:
    settings = scene.pecs
    if not settings.whole_range:
        return settings.frames
    duration_s = (scene.frame_end - scene.frame_start + 1) * scene.render.fps_base / scene.render.fps
    return max(1, round(duration_s * settings.fps))


def stack_bytes(scene: bpy.types.Scene) -> int:
    """Upper limit: uncompressed, and every frame rendered."""
    width, height = size(scene)
    return frame_count(scene) * scene.pecs.channels * width * height * BYTES_PER_VALUE


def focus_m(scene: bpy.types.Scene) -> float | None:
    """Focus distance; None if not set. Blender stores lengths in units of the scene."""
    return scene.pecs.focus_m * scene.unit_settings.scale_length or None


def film_mm(scene: bpy.types.Scene) -> tuple[float, float]:
    """Width and height of the film. Raises pecs.PecsError for an invalid chip."""
    width, height = size(scene)
    width_mm = scene.pecs.film_width_mm or film_width_mm_of(library.chip(scene.pecs.chip), width)
    return width_mm, width_mm * height / width


def lens_options(scene: bpy.types.Scene) -> dict[str, float | None]:
    """Options of pecs.Lens.info and pecs.Lens.draw. Raises pecs.PecsError for an invalid chip."""
    width_mm, height_mm = film_mm(scene)
    fnumber = plain(scene.pecs.fnumber) or None
    return {"focus_m": focus_m(scene), "fnumber": fnumber, "film_width_mm": width_mm, "film_height_mm": height_mm}


def lens_now(scene: bpy.types.Scene) -> dict:
    """pecs.Lens.info at the current settings. Raises pecs.PecsError."""
    return library.lens_info(scene.pecs.lens, **lens_options(scene))


def plain(value: float) -> float:
    """Undoes Blender's rounding to single precision: 4.150000095 is 4.15."""
    return float(f"{value:.6g}")


def words(scene: bpy.types.Scene, name: str) -> list[str]:
    """Arguments of one option of SHOWN; none if it is not set."""
    s = scene.pecs
    value = focus_m(scene) if name == "focus_m" else getattr(s, name)
    if name == "threads":
        value = value or preferences().threads
    if not value or name in _LENS_OPTIONS and not has_lens(s) or name == "moving_px" and s.time != "uniform":
        return []
    if s.engine != "cycles" and name in CYCLES_ONLY:
        return []
    kind = _KINDS[name]
    if kind == "bool":
        return [flag(name)]
    if kind == "Sequence[float]":
        return [flag(name), *(f"{v:.6g}" for v in value)] if any(value) else []
    if name == "chip":
        value = library.find("chip", value)
    if name == "illuminant" and value.endswith(".csv"):  # relative to the .blend, of which a copy is rendered
        value = Path(bpy.data.filepath).parent / value
    return [flag(name), f"{value:.6g}" if isinstance(value, float) else str(value)]


def render_arguments(scene: bpy.types.Scene) -> list[str]:
    """Arguments of `pecs render`, without output and image size."""
    s = scene.pecs
    lens = library.find("lens", s.lens) if has_lens(s) else library.SCENES_CAMERA
    found = ["--scene-name", scene.name, "--lens", lens]
    for name in SHOWN:
        found += words(scene, name)
    found += ["--layers", ",".join(sorted(s.layers))] if s.layers else []
    return found + (["--allow-scripts"] if s.allow_scripts else [])


def exists_words(scene: bpy.types.Scene) -> list[str]:
    return {"continue": [], "overwrite": ["--overwrite"], "new": ["--new-version"]}[scene.pecs.exists]


def parameters(settings) -> dict[str, dict]:
    """Parameters of the chip and of the pixel model: {key: {"unit", "value", "range": (min, max)}}. Raises
    pecs.PecsError for an invalid chip."""
    values = library.chip(settings.chip).info["values"]
    known = {key: {**entry, "of": "chip"} for key, entry in values.items()}
    model = next((m for m in _models() if m["name"] == settings.sensor.model), {"parameters": []})
    for p in model["parameters"]:
        known[p["key"]] = {"unit": p["unit"], "value": p["value"], "range": [p["min"], p["max"]], "of": "model"}
    return known


def override_error(override, known: dict[str, dict]) -> str:
    """The error in an override; empty if it is valid."""
    if override.name not in known:
        return UNKNOWN.format(name=override.name)
    low, high = known[override.name]["range"]
    try:
        valid = low <= float(override.value) <= high
    except ValueError:
        valid = False
    return "" if valid else f"{override.name}: got {override.value!r}, wanted a number in [{low:g}, {high:g}]"


def sensor_error(scene: bpy.types.Scene) -> str:
    """The error of a sensor with these settings; empty if it can be made. The overrides are valid."""
    sensor, known = scene.pecs.sensor, parameters(scene.pecs)
    values = {
        part: {o.name: float(o.value) for o in sensor.overrides if known[o.name]["of"] == part} for part in _PARTS
    }
    options = {name: values[part] for part, name in _PARTS.items()} | {"chip_frames": takes_frames(scene)}
    options |= {"preset": sensor.preset} if sensor.preset else {"model": sensor.model, "readout": sensor.readout}
    options["biases"] = {name: getattr(sensor, name) for name in ("diff_on", "diff_off") if getattr(sensor, name)}
    band = [plain(sensor.afk_low_hz), plain(sensor.afk_high_hz)]
    options |= {"afk_hz" if sensor.afk == "stop" else "afk_pass_hz": band} if sensor.afk != "none" else {}
    mask = bpy.path.abspath(sensor.mask)
    options |= {"mask": mask} if mask else {}
    picture = size(scene) if mask else (8, 8)  # as small as possible: only a mask depends on it
    return library.sensor_error(scene.pecs.chip, picture, options, disk.modified_ns(mask) if mask else 0)


_PARTS = {"chip": "overrides", "model": "parameters"}


def sensor_arguments(scene: bpy.types.Scene) -> list[str]:
    """Arguments of `pecs sense`, without stack, output, chip and threads."""
    sensor = scene.pecs.sensor
    words = ["--seed", str(sensor.seed)]
    words += ["--preset", sensor.preset] if sensor.preset else ["--model", sensor.model, "--readout", sensor.readout]
    words += ["--format", sensor.format] if sensor.format != "auto" else []
    words += [] if sensor.noise else ["--no-noise"]
    known = parameters(scene.pecs) if sensor.overrides else {}
    biases = [f"{name}={getattr(sensor, name)}" for name in ("diff_on", "diff_off") if getattr(sensor, name)]
    words += ["--bias", ",".join(biases)] if biases else []
    words += _stage_arguments(sensor)
    for one in sensor.overrides:
        option = "--param" if known.get(one.name, {}).get("of") == "model" else "--set"
        words += [option, f"{one.name}={one.value}"]
    return words


def has_frames(settings) -> bool:
    return "frame_period_s" in parameters(settings)


def takes_frames(scene: bpy.types.Scene) -> bool:
    return scene.pecs.sensor.chip_frames and has_frames(scene.pecs)


def frames_path(scene: bpy.types.Scene, events: Path) -> Path | None:
    """File or folder of the frames of the chip; none if it takes none."""
    if not takes_frames(scene):
        return None
    return events if events.suffix == ".aedat4" else events.with_name(f"{events.stem}_frames")


def frames_arguments(scene: bpy.types.Scene, events: Path) -> list[str]:
    path = frames_path(scene, events)
    return ["--frames", str(path)] if path else []


def _stage_arguments(sensor) -> list[str]:
    words = []
    if sensor.afk != "none":
        option = "--afk" if sensor.afk == "stop" else "--afk-pass"
        words += [option, f"{sensor.afk_low_hz:.6g}:{sensor.afk_high_hz:.6g}"]
    words += [f"--{sensor.trail}", f"{sensor.trail_ms:.6g}ms"] if sensor.trail != "none" else []
    words += ["--erc", f"{sensor.erc_mhz:.6g}MHz"] if sensor.erc_mhz else []
    return words + (["--mask", bpy.path.abspath(sensor.mask)] if sensor.mask else [])


PROPERTIES = {(bpy.types.Scene, "pecs"): PointerProperty(type=PecsSettings)}
