# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of a render with help and range, from which the command line and the panel are generated."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pecs._arguments import Quantity, flag
from pecs._errors import UsageError

from ..truth import LAYERS

SAMPLES = {"uniform": 8, "adaptive": 32}  # per pixel and band, by default
TIMES = tuple(SAMPLES)
PLACEMENTS = ("means", "gauss", "uniform")
MOST_BANDS = 256
MOST_PX = 8192  # of a stack, each way
ENGINES = ("cycles", "eevee")
CYCLES_ONLY = ("no_denoise", "light_tree", "noise_events", "device", "seed", "moving_px")
LENS_ONLY = ("stop_diameter_mm", "focus_m", "focus_bands_nm", "film_shift_mm", "film_tilt_deg")
DEVICES = ("CPU", "CUDA", "OPTIX", "HIP", "ONEAPI", "METAL")


def _range(text: str) -> slice:
    begin, colon, end = text.partition(":")
    if not (colon and begin.isdecimal() and end.isdecimal() and int(begin) < int(end)):
        raise argparse.ArgumentTypeError(f"got {text}, wanted A:B with A < B")
    return slice(int(begin), int(end))


def _bands(text: str) -> int | None:
    if text == "auto":
        return None
    if not (text.isdecimal() and 1 <= int(text) <= MOST_BANDS):
        raise argparse.ArgumentTypeError(f"got {text}, wanted auto or 1 to {MOST_BANDS}")
    return int(text)


def _share(text: str) -> float:
    try:
        return float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text}, wanted a share such as 10%") from None


def _wavelengths(text: str) -> tuple[float, ...]:
    try:
        return tuple(map(float, text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text}, wanted wavelengths such as 450,550 [nm]") from None


def _box(text: str) -> tuple[int, ...]:
    numbers = text.split(":")
    if len(numbers) != 4 or not all(n.isdecimal() for n in numbers):
        raise argparse.ArgumentTypeError(f"got {text}, wanted X0:Y0:X1:Y1 in pixels from the top left")
    return tuple(map(int, numbers))


def _layers(text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(text.split(",")))
    for name in names:
        if name not in LAYERS:
            raise argparse.ArgumentTypeError(f"got {name!r}, wanted a list of {', '.join(LAYERS)}")
    return names


@dataclass(frozen=True)
class Rule:
    """Help and range of an option. parse: from text, if the type does not suffice. recorded: whether stack.json lists
    the option, because it decides the picture."""

    help: str
    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf  # exclusive
    choices: tuple = ()
    parse: Callable[[str], Any] | None = None
    metavar: str | tuple[str, ...] | None = None
    recorded: bool = True
    unit: str = ""  # of numbers without a unit

    def wanted(self) -> str:
        parts = [f"above {self.above:g}"] if self.above > -math.inf else []
        parts += [f"at least {self.low:g}"] if self.low > -math.inf else []
        parts += [f"at most {self.high:g}"] if self.high < math.inf else []
        return " ".join(["a finite number", " and ".join(parts)]).strip()

    def allows(self, value: float) -> bool:
        return math.isfinite(value) and self.low <= value <= self.high and value > self.above


def option(default: Any, help: str, **rule: Any) -> Any:
    return field(default=default, metadata={"rule": Rule(help, **rule)})


@dataclass(frozen=True)
class Options:
    bands: int | None = option(
        None,
        "number of bands; a pass renders three; auto: as few as the scene's colours and lamps allow",
        parse=_bands,
        low=1,
        high=MOST_BANDS,
        metavar="N|auto",
        recorded=False,
    )
    placement: str = option(
        "means",
        "means: colours are means over intervals of the spectrum; gauss, uniform: values at single wavelengths",
        choices=PLACEMENTS,
    )
    bands_per_pass: int = option(
        3, "wavelengths per RGB pass; 1 makes dispersion in glass objects exact", choices=(1, 2, 3)
    )
    chip: str = option("imx636", "chip of the events; its response also places the bands")
    min_nm: float | None = option(
        None,
        "shortest wavelength; by default, where the response of chip and lamps begins",
        low=100,
        high=20000,
        unit="nm",
    )
    max_nm: float | None = option(
        None,
        "longest wavelength; by default, where the response of chip and lamps ends",
        low=100,
        high=20000,
        unit="nm",
    )
    illuminant: str = option("d65", "spectrum of RGB lamps and skies: a name, a CSV file, blackbody:T or daylight:T")
    light_scale: float = option(1.0, "factor for all light", above=0)
    lux: float | None = option(
        None,
        ".blend only: illuminance of the median surface in view at the first instant; sets the light scale",
        above=0,
        high=1e9,
        recorded=False,  # the light scale is recorded
        unit="lx",
    )
    fps: float = option(10000.0, "instants per second of scene time", above=0, high=1e9, unit="Hz")
    frames: str = option(
        "100",
        "N, A:B, ranges such as 0:5,9:12, 'period' for one period in equal steps, or 'all' for a .blend's frame range",
        recorded=False,
    )
    time: str = option(
        "uniform",
        "uniform renders every instant; adaptive renders keyframes and the motion between them",
        choices=TIMES,
    )
    step_px: float = option(24.0, "adaptive: maximum motion between keyframes", above=0, high=256, unit="px")
    subpixels: int | None = option(
        None, "rendered pixels per sensor pixel, in x and y; by default 1, with adaptive steps 2", choices=(1, 2, 4)
    )
    only: slice | None = option(
        None, "render only these frames of the stack (a shard)", parse=_range, metavar="A:B", recorded=False
    )
    moving_px: tuple[int, int, int, int] | None = option(
        None,
        "the only part of the picture that changes; the rest is rendered once; by default, all changes",
        parse=_box,
        metavar="X0:Y0:X1:Y1",
    )
    layers: tuple[str, ...] = option(
        (), f"layers to render besides the light: a list of {', '.join(LAYERS)}", parse=_layers, recorded=False
    )
    no_light: bool = option(False, "render only the --layers, no light", recorded=False)
    camera_path: str | None = option(
        None,
        "camera trajectory: a TUM text file, rows t_s tx ty tz qx qy qz qw of world_from_camera in metres; camera axes "
        "x right, y down, z forward",
        metavar="FILE",
        recorded=False,
    )
    width: int | None = option(
        None, "width in pixels; by default the scene's, with `pecs run` the chip's", low=1, high=MOST_PX, recorded=False
    )
    height: int | None = option(
        None, "height in pixels; with a width alone, from the scene's aspect ratio", low=1, high=MOST_PX, recorded=False
    )
    film_width_mm: float | None = option(
        None, "width of a lens camera's film; by default the chip's", low=0.01, high=1000, unit="mm"
    )
    film_shift_mm: Sequence[float] = option(
        (0.0, 0.0),
        "offset of the film's centre from the lens's axis",
        low=-1000,
        high=1000,
        metavar=("X", "Y"),
        unit="mm",
    )
    film_tilt_deg: Sequence[float] = option(
        (0.0, 0.0),
        "tilt of the film about its x, then y axis",
        low=-80,
        high=80,
        metavar=("X", "Y"),
        unit="deg",
    )
    samples: int | None = option(
        None,
        "paths per sensor pixel and band, rounded up to as many in each subpixel (adaptive: and in two halves); by "
        f"default {SAMPLES['uniform']}, with adaptive steps {SAMPLES['adaptive']}",
        low=1,
        high=65536,
    )
    noise_events: float | None = option(
        None,
        "adaptive: chooses --samples so that at most this share of the events comes from the noise of the renderer",
        above=0,
        high=1,
        parse=_share,
        metavar="SHARE",
    )
    no_denoise: bool = option(
        False, "adaptive: keep the noise of few samples; by default Open Image Denoise removes it"
    )
    light_tree: bool = option(
        False, "reduces noise in scenes with several lamps; if a lamp moves, noise changes in the whole picture"
    )
    engine: str = option(
        "cycles",
        "cycles traces paths; eevee draws direct light on a graphics card, without a lens and light between surfaces",
        choices=ENGINES,
    )
    device: str = option("CPU", "device of Cycles; a lens requires CPU or OPTIX", choices=DEVICES)
    seed: int = option(1, "random seed", low=0, high=2**31 - 1)
    lens: str | None = option(
        None, "name or file; 'none' for a pinhole or the .blend's camera (radiance); by default the scene's"
    )
    stop_diameter_mm: float | None = option(
        None, "diameter of the lens's stop; by default the scene's", above=0, high=1000, unit="mm"
    )
    fnumber: float | None = option(None, "f-number of the lens, instead of a stop diameter", above=0, high=1000)
    focus_m: float | None = option(
        None, "focus distance of the lens; by default the scene's", above=0, high=1e9, unit="m"
    )
    focus_bands_nm: tuple[float, ...] = option(
        (),
        "wavelengths at which the lens is focused; by default all bands",
        low=100,
        high=20000,
        parse=_wavelengths,
        metavar="NM,NM,...",
    )
    focal_mm: float = option(15.02, "focal length of a scene folder's pinhole", above=0, high=1e4, unit="mm")
    threads: int = option(
        0, "number of threads, 0 for all cores; does not change the result", low=0, high=1024, recorded=False
    )

    quiet: bool = False  # from the parser, like verbose
    verbose: bool = False

    def __post_init__(self):
        for name, rule in RULES.items():
            value = getattr(self, name)
            if isinstance(value, str) and name not in _TEXT:
                try:
                    value = _converter(name)(value)
                except (argparse.ArgumentTypeError, ValueError) as e:
                    raise UsageError(f"{flag(name)}: {e}") from None
            elif _TYPES[name] == "float" and value is not None:
                value = float(value)  # as stack.json records it from the command line
            object.__setattr__(self, name, value)
            if rule.choices and value not in (None, *rule.choices):
                raise UsageError(f"{flag(name)}: got {value}, wanted one of {', '.join(map(str, rule.choices))}")
            for number in value if isinstance(value, (tuple, list)) else [value]:
                if isinstance(number, (int, float)) and not isinstance(number, bool) and not rule.allows(number):
                    raise UsageError(f"{flag(name)}: got {number}, wanted {rule.wanted()}")

    @property
    def is_adaptive(self) -> bool:
        return self.time == "adaptive"

    @property
    def samples_per_pixel(self) -> int:
        return self.samples or SAMPLES[self.time]

    def recorded(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name, rule in RULES.items() if rule.recorded}


RULES: dict[str, Rule] = {f.name: f.metadata["rule"] for f in dataclasses.fields(Options) if f.metadata}
DEFAULTS: dict[str, Any] = {f.name: f.default for f in dataclasses.fields(Options)}
_TYPES: dict[str, str] = {f.name: f.type.removesuffix(" | None") for f in dataclasses.fields(Options)}
_TEXT = {name for name, kind in _TYPES.items() if kind == "str"}


def _converter(name: str) -> Callable[[str], Any]:
    rule, kinds = RULES[name], {"int": int, "float": float, "str": str, "Sequence[float]": float}
    return Quantity(rule.unit) if rule.unit else rule.parse or kinds[_TYPES[name]]


def add_argument(parser: argparse._ActionsContainer, name: str, *short: str) -> None:
    rule, kind, flags = RULES[name], _TYPES[name], [*short, flag(name)]
    if kind == "bool":
        parser.add_argument(*flags, dest=name, action="store_true", help=rule.help)
        return
    parser.add_argument(
        *flags,
        dest=name,
        type=_converter(name),
        default=DEFAULTS[name],
        choices=rule.choices or None,
        metavar=rule.metavar,
        help=rule.help,
        **({"nargs": 2} if kind == "Sequence[float]" else {}),
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """All options; --stop-diameter and --fnumber exclude each other."""
    stop = parser.add_mutually_exclusive_group()
    for name in RULES:
        add_argument(stop if name in ("stop_diameter_mm", "fnumber") else parser, name)
