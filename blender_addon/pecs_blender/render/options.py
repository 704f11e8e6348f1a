# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of a render, each with its help and range: the command line and the panel are made from them."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from .arguments import Quantity
from .errors import USAGE, RenderError

TIMES = ("uniform", "adaptive")
PLACEMENTS = ("gauss", "strata", "uniform")
DEVICES = ("CPU", "CUDA", "OPTIX", "HIP", "ONEAPI", "METAL")
LAYERS = ("depth", "normal", "motion", "objects")  # beside the light


def _range(text: str) -> slice:
    begin, colon, end = text.partition(":")
    if not (colon and begin.isdecimal() and end.isdecimal() and int(begin) < int(end)):
        raise argparse.ArgumentTypeError(f"got {text}, wanted A:B with A < B")
    return slice(int(begin), int(end))


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
    """help and range of an option. parse: from text, where its type does not say. recorded: whether it decides the
    picture and so stands in stack.json."""

    help: str
    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf  # as low, but excluded
    choices: tuple = ()
    parse: Callable[[str], Any] | None = None
    metavar: str | tuple[str, ...] | None = None
    recorded: bool = True
    unit: str = ""  # of plain numbers; others may carry theirs

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
    bands: int = option(6, "number of wavelengths; three share an RGB pass", low=1, high=256, recorded=False)
    placement: str = option("gauss", "where the bands lie", choices=PLACEMENTS)
    bands_per_pass: int = option(3, "1: dispersion in glass objects is exact", choices=(1, 2, 3))
    chip: str = option("imx636", "the chip whose response places the bands")
    min_nm: float | None = option(
        None,
        "shortest wavelength; where chip and lamps begin if not given",
        low=100,
        high=20000,
        unit="nm",
    )
    max_nm: float | None = option(
        None,
        "longest wavelength; where chip and lamps end if not given",
        low=100,
        high=20000,
        unit="nm",
    )
    illuminant: str = option("d65", "spectrum of RGB lamps and skies: a name, CSV, blackbody:T or daylight:T")
    light_scale: float = option(1.0, "multiplies all light", above=0)
    lux: float | None = option(
        None,
        "of a .blend: sets the light scale, so that the median surface in view is lit so at the first instant",
        above=0,
        high=1e9,
        recorded=False,  # the light scale is
        unit="lx",
    )
    fps: float = option(10000.0, "instants per second of the scene", above=0, high=1e9, unit="Hz")
    frames: str = option(
        "100", "N, A:B, 'period' for one period in equal steps, 'all' for a .blend's range", recorded=False
    )
    time: str = option("uniform", "every instant, or keyframes and the motion between them", choices=TIMES)
    step_px: float = option(24.0, "adaptive: how far anything may move between keyframes", above=0, high=256, unit="px")
    time_tolerance: float = option(
        0.5, "adaptive: error of ln(photocurrent) that is left between keyframes, in contrast thresholds", above=0
    )
    subpixels: int | None = option(
        None, "light per pixel in x and y; if not given, 1, and 2 where motion carries it", choices=(1, 2, 4)
    )
    share: int = option(2, "adaptive: keyframes on each side whose samples are shared", low=0, high=16)
    only: slice | None = option(
        None, "render these frames of the plan (a shard)", parse=_range, metavar="A:B", recorded=False
    )
    moving_px: tuple[int, int, int, int] | None = option(
        None,
        "only this part of the picture changes: render the rest once",
        parse=_box,
        metavar="X0:Y0:X1:Y1",
    )
    layers: tuple[str, ...] = option(
        (), f"what to render beside the light: a list of {', '.join(LAYERS)}", parse=_layers, recorded=False
    )
    no_light: bool = option(False, "only the --layers, no light", recorded=False)
    camera_path: str | None = option(
        None,
        "moves the camera: a text file of rows t_s tx ty tz qx qy qz qw (TUM), in metres, from camera axes x right, "
        "y down, z forward to the scene's",
        metavar="FILE",
        recorded=False,
    )
    width: int | None = option(None, "pixels; the scene's if not given", low=1, high=8192, recorded=False)
    height: int | None = option(None, "pixels; in the scene's shape if not given", low=1, high=8192, recorded=False)
    film_width_mm: float | None = option(
        None, "of a lens camera; the chip's if not given", low=0.01, high=1000, unit="mm"
    )
    film_shift_mm: Sequence[float] = option(
        (0.0, 0.0),
        "the film's centre off the lens' axis",
        low=-1000,
        high=1000,
        metavar=("X", "Y"),
        unit="mm",
    )
    film_tilt_deg: Sequence[float] = option(
        (0.0, 0.0),
        "about its x, then y axis",
        low=-80,
        high=80,
        metavar=("X", "Y"),
        unit="deg",
    )
    samples: int = option(8, "paths per pixel and band, those of its subpixels together", low=1, high=65536)
    noise_target: float | None = option(
        None, "choose --samples: noise of ln(light), in contrast thresholds of the chip", above=0
    )
    denoise: bool = option(False, "OpenImageDenoise with albedo and normals")
    light_tree: bool = option(
        False, "less noise with several lamps; where a lamp moves, noise changes in the whole picture"
    )
    device: str = option("CPU", "what Cycles computes on; a lens needs CPU or OPTIX", choices=DEVICES)
    seed: int = option(1, "of the sampling", low=0, high=2**31 - 1)
    lens: str | None = option(
        None, "name, file, or 'none': a pinhole or the .blend's camera (radiance); the scene's if not given"
    )
    stop_diameter_mm: float | None = option(
        None, "of the lens; the scene's if not given", above=0, high=1000, unit="mm"
    )
    fnumber: float | None = option(None, "of the lens, instead of a stop diameter", above=0, high=1000)
    focus_m: float | None = option(None, "of the lens; the scene's if not given", above=0, high=1e9, unit="m")
    focal_mm: float = option(15.02, "of a scene folder's pinhole", above=0, high=1e4, unit="mm")
    colour_tolerance_px: float = option(
        0.1,
        "bands of a pass that lie closer on the film share their rays (at their mean wavelength); else every ray "
        "carries one band, which is noisier",
        low=0,
        unit="px",
    )
    threads: int = option(0, "0: all cores; does not change the result", low=0, high=1024, recorded=False)
    restart_growth_mb: float = option(
        1000.0, "memory growth at which the process starts afresh", recorded=False, unit="MB"
    )

    quiet: bool = False  # these two: as of every command, from the parser
    verbose: bool = False

    def __post_init__(self):
        for name, rule in RULES.items():
            value = getattr(self, name)
            numbers = value if isinstance(value, (tuple, list)) else [value]
            for number in numbers:
                if isinstance(number, (int, float)) and not isinstance(number, bool) and not rule.allows(number):
                    raise RenderError(USAGE, f"{flag(name)}: got {number}, wanted {rule.wanted()}")

    @property
    def is_adaptive(self) -> bool:
        return self.time == "adaptive"

    def recorded(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name, rule in RULES.items() if rule.recorded}


RULES: dict[str, Rule] = {f.name: f.metadata["rule"] for f in dataclasses.fields(Options) if f.metadata}
DEFAULTS: dict[str, Any] = {f.name: f.default for f in dataclasses.fields(Options)}
_TYPES: dict[str, str] = {f.name: f.type for f in dataclasses.fields(Options)}


_FLAGS = {"min_nm": "--min-wavelength", "max_nm": "--max-wavelength"}


def _long(name: str) -> str:
    return "--" + name.replace("_", "-")


def flag(name: str) -> str:
    """Without the unit that the option's name here has: its values carry theirs."""
    unit = RULES[name].unit.lower()
    return _FLAGS.get(name) or _long(name.removesuffix(f"_{unit}") if unit else name)


def add_argument(parser: argparse._ActionsContainer, name: str, *short: str) -> None:
    """An option; under the name that it had with a unit in it, too."""
    rule, kind = RULES[name], _TYPES[name].removesuffix(" | None")
    flags = [*short, *dict.fromkeys((flag(name), _long(name)))]
    if kind == "bool":
        parser.add_argument(*flags, dest=name, action="store_true", help=rule.help)
        return
    kinds = {"int": int, "float": float, "str": str, "Sequence[float]": float}
    parser.add_argument(
        *flags,
        dest=name,
        type=Quantity(rule.unit) if rule.unit else rule.parse or kinds[kind],
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
