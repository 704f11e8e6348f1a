# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel asks for after the render: options of `pecs sense`, `view` and `compare`, kept in the .blend."""

from functools import cache
from zlib import crc32

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from . import library
from .words import say

CHIPS_OWN = "pecs"  # the pixel model whose parameters are the chip's
UNKNOWN = "{name}: no parameter of this chip or pixel"


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


def arguments(scene: bpy.types.Scene) -> list[str]:
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


CLASSES = (PecsOverride, PecsSensor)
