"""The command line of `pecs fit`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._arguments import SEED, Parser, Quantity, Whole
from .._command import answer
from .._errors import UsageError, existing
from .._files import check_outputs, read_text, write_json
from .._progress import Line
from .._text import counted
from ..chip import Chip
from .profile import pixel_map_path

if TYPE_CHECKING:
    from .estimate import Fitted

ABOUT = (
    "Fits a chip profile to recordings of a camera. --stimulus is a recording of a screen (pecs stimulus); --steps is "
    "one of a light that switches through known levels again and again, relative to level 1; --disk is one of a "
    "turning disk of black and white sectors; --still is one of constant light, or with the cap on (level 0). For them "
    "the camera does not move. --davis is any recording of a DAVIS with frames, in motion and, for noise, still. "
    "What the recordings do not constrain is kept as in the starting profile."
)
EXAMPLES = (
    "pecs fit --stimulus screen.raw --still cap.raw=0 -o my_camera.json",
    "pecs fit --steps lamp.raw=1,0.1 --still cap.raw=0 -o my_camera.json --report fit.html",
    "pecs fit --steps lamp.raw=1,0.1,1,0.02 --still lit.raw=1 --still cap.raw=0 -o my_camera.json --chip gen3_vga",
    "pecs fit --disk disk.raw=12 -o my_camera.json",
    "pecs fit --davis recording.aedat4 -o my_davis.json --report fit.html",
    "pecs fit --steps led.raw=0.398,0.006 --irradiance 1 --wavelength 680nm -o my_camera.json    # levels in W/m2",
)
MAX_BYTES = 1 << 26
LARGE_MISFIT = 5.0
CHIP = "imx636"
OTHERS = (  # options that --davis does not take
    "steps", "still", "stimulus", "disk", "flash", "edges", "region", "photocurrent", "irradiance", "wavelength",
    "pixel_map",
)  # fmt: skip


def _levels(text: str) -> tuple[Path, tuple[float, ...]]:
    file, equals, levels = text.rpartition("=")
    try:
        numbers = tuple(float(v) for v in levels.split(","))
    except ValueError:
        numbers = ()
    if not (file and equals and numbers):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted FILE=LEVEL or FILE=LEVEL,LEVEL,…")
    return Path(file), numbers


def _disk(text: str) -> tuple[Any, ...]:
    file, equals, contrast = text.rpartition("=")
    try:
        return (Path(file), float(contrast)) if equals else (Path(text),)
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted FILE or FILE=CONTRAST") from None


def _region(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if len(parts) != 4 or not all(p.isascii() and p.isdecimal() and len(p) < 7 for p in parts):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted X,Y,W,H")
    return tuple(map(int, parts))


def _parser() -> Parser:
    parser = Parser(prog="pecs fit", description=ABOUT, examples=EXAMPLES)
    parser.add_argument("-o", "--output", type=Path, required=True, help="the chip profile (.json)")
    about = "a light that switches through these levels again and again; may be repeated"
    parser.add_argument("--steps", type=_levels, action="append", default=[], metavar="FILE=LEVELS", help=about)
    about = "constant light, 0 with the cap on; may be repeated"
    parser.add_argument("--still", type=_levels, action="append", default=[], metavar="FILE=LEVEL", help=about)
    about = "a screen that plays the page of `pecs stimulus`; may be repeated"
    parser.add_argument("--stimulus", type=Path, action="append", default=[], metavar="FILE", help=about)
    about = "a turning disk of black and white sectors, and white / black (default: 12); may be repeated"
    parser.add_argument("--disk", type=_disk, action="append", default=[], metavar="FILE[=CONTRAST]", help=about)
    about = "AEDAT4, ROS bag or folder (events.*, images.txt or exposures.csv) with frames; alone"
    parser.add_argument("--davis", type=Path, metavar="RECORDING", help=about)
    about = "a bright lamp that switches before the whole sensor: the readout"
    parser.add_argument("--flash", type=Path, metavar="FILE", help=about)
    about = "starting profile, a name or a file (default: imx636; with --davis: davis346, or davis240c for its size)"
    parser.add_argument("--chip", help=about)
    about = "text file of the times of the switches in us, a line each, from one to the first level on (one --steps)"
    parser.add_argument("--edges", type=Path, metavar="FILE", help=about)
    parser.add_argument("--region", type=_region, metavar="X,Y,W,H", help="pixels used (default: 64x64 in the centre)")
    light = parser.add_mutually_exclusive_group()
    about = "photocurrent of a pixel at level 1, if known; then corner_hz_per_a is fitted"
    light.add_argument("--photocurrent", type=Quantity("A", above=0), metavar="CURRENT", help=about)
    about = "irradiance of the chip at level 1 in W/m2, if known, of light of one --wavelength"
    light.add_argument("--irradiance", type=float, metavar="W_PER_M2", help=about)
    parser.add_argument("--wavelength", type=Quantity("nm", above=0), metavar="LENGTH", help="of --irradiance")
    about = "a value that stays as in the starting profile; may be repeated"
    parser.add_argument("--keep", action="append", default=[], metavar="KEY", help=about)
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="a page with the recordings and the model")
    parser.add_argument("--numbers", type=Path, metavar="FILE.json", help="all numbers of the fit")
    about = "also thresholds and hot pixels pixel by pixel, in NAME_pixels.json, in the folder of the profile"
    parser.add_argument("--pixel-map", action="store_true", help=about)
    about = "simulated pixels, a multiple of 128; more narrow the intervals and take longer"
    parser.add_argument("--pixels", type=Whole(128, 1 << 20), default=1024, metavar="N", help=about)
    parser.add_argument("--seed", type=SEED, default=1, help="of the simulation")
    return parser


def main(argv: list[str]) -> int:
    return answer(_parser(), _fit, argv)


def _photocurrent_a(args: argparse.Namespace) -> float | None:
    if (args.irradiance is None) != (args.wavelength is None):
        raise UsageError("fit: got one of --irradiance and --wavelength, wanted both")
    if args.irradiance is None:
        return args.photocurrent  # type: ignore[no-any-return]
    if not 0 < args.irradiance < 1e6:
        raise UsageError(f"fit: --irradiance: got {args.irradiance:g}, wanted W/m2 above 0")
    if not 1 <= args.wavelength <= 1e5:
        raise UsageError(f"fit: --wavelength: got {args.wavelength:g} nm, wanted 1 to 1e5 nm")
    band = [{"lambda_nm": args.wavelength, "weight_nm": 1.0}]
    return Chip(args.chip or CHIP).amperes_per_unit(band)[0] * args.irradiance  # type: ignore[no-any-return]


def _edges_us(path: Path) -> np.ndarray:
    words = read_text(path, MAX_BYTES).split()
    try:
        edges = np.array([float(w) for w in words])
    except ValueError:
        edges = np.array([])
    if len(edges) < 2 or not np.isfinite(edges).all() or (np.diff(edges) <= 0).any():
        raise UsageError(f"{path}: got no rising numbers, wanted the time of a switch in us in each line")
    return edges


def _fit(args: argparse.Namespace) -> None:
    line = Line(5, task="fit", quiet=args.quiet, verbose=args.verbose)
    found = (_fit_davis if args.davis else _fit_recordings)(args, lambda n: line(f"fit: {n} simulations", n))
    line.end()
    _report(found, args, line)


def _fit_davis(args: argparse.Namespace, progress: Callable[[int], object]) -> Fitted:
    from .davis_fit import fit_davis
    from .davis_recording import Davis

    for name in OTHERS:
        if getattr(args, name):
            raise UsageError(f"fit: got --davis and --{name.replace('_', '-')}, wanted --davis alone")
    check_outputs([args.davis, *([Path(args.chip)] if args.chip else [])], [args.output, args.report, args.numbers])
    of = Davis(existing(args.davis, "a recording"))
    return fit_davis(of, args.chip, keep=args.keep, pixels=args.pixels, seed=args.seed, progress=progress)


def _fit_recordings(args: argparse.Namespace, progress: Callable[[int], object]) -> Fitted:
    from .estimate import fit
    from .recordings import Disk, Flash, Steps, Still, Stimulus

    if not args.steps and not args.still and not args.stimulus and not args.disk:
        raise UsageError("fit: no recordings, wanted --stimulus, --steps, --disk, --still or --davis")
    if args.edges and len(args.steps) != 1:
        raise UsageError(f"fit: --edges: got {len(args.steps)} recordings of --steps, wanted one")
    for file, levels in args.still:
        if len(levels) != 1:
            raise UsageError(f"fit: --still {file}: got {len(levels)} levels, wanted one")
    inputs = [*(file for file, *_ in (*args.steps, *args.still, *args.disk)), *args.stimulus, args.flash, args.edges]
    pixel_map = pixel_map_path(args.output) if args.pixel_map else None
    chip = args.chip or CHIP
    check_outputs([*inputs, Path(chip)], [args.output, pixel_map, args.report, args.numbers])
    edges = _edges_us(args.edges) if args.edges else None
    recordings: list[Steps | Still | Stimulus | Disk | Flash] = [
        Stimulus(existing(f, "a recording")) for f in args.stimulus
    ]
    recordings += [Steps(existing(f, "a recording"), levels, edges) for f, levels in args.steps]
    recordings += [Still(existing(f, "a recording"), levels[0]) for f, levels in args.still]
    recordings += [Disk(existing(f, "a recording"), *contrast) for f, *contrast in args.disk]
    if args.flash:
        recordings.append(Flash(existing(args.flash, "a recording")))
    return fit(
        recordings,
        chip,
        photocurrent_a=_photocurrent_a(args),
        keep=args.keep,
        region=args.region,
        pixels=args.pixels,
        seed=args.seed,
        pixel_map=args.pixel_map,
        progress=progress,
    )


def _report(found: Fitted, args: argparse.Namespace, line: Line) -> None:
    from . import report
    from .davis import FULL_CORRELATION

    for file, moving in found.moving.items():
        if moving.correlation < FULL_CORRELATION:
            why = f"got a correlation of {moving.correlation:.3f} of frames and events, wanted {FULL_CORRELATION:g}"
            why += " or more: the thresholds are uncertain (5 s of motion, sharp frames?)"
            line.note(f"pecs: warning: {file}: {why}")
        if moving.unseen:
            why = f"got no events between the exposures ({100 * moving.unseen:.0f} % of the time)"
            why += ": the thresholds are too large by up to this share (events cut off?)"
            line.note(f"pecs: warning: {file}: {why}")
    if found.misfit is not None and found.misfit > LARGE_MISFIT:
        why = f"the recordings and the model differ by {found.misfit:.1f} times the noise; the values are not reliable"
        line.note(f"pecs: warning: {why} (levels, edges, region?)")
    found.write(args.output)
    if args.report:
        report.write(found, args.report)
    if args.numbers:
        write_json(args.numbers, found.summary())
    for file, screen in found.screens.items():
        print(f"{file}: screen: {screen}")
    for file, disk in found.disks.items():
        print(f"{file}: disk: {disk}")
    for key, value in found.values.items():
        if value.fitted:
            print(f"{key}: {value.value:.4g} (95 %: {value.interval[0]:.4g} to {value.interval[1]:.4g})")
    for key, value in found.values.items():
        if not value.fitted:
            print(f"{key}: kept at {value.value:.4g}: {value.why}")
    if map_ := found.pixel_map:
        x, y, w, h = map_.region
        on, off = (100 * of for of in map_.deviation)
        hot = "" if map_.hot_pixels is None else f", {len(map_.hot_pixels)} hot pixels"
        print(
            f"pixel map: thresholds of {w}x{h} pixels from {x},{y}, within {on:.1f} % (ON) and {off:.1f} % (OFF){hot}"
        )
    for file, moving in found.moving.items():
        by = f"correlation of their changes and the events' {moving.correlation:.3f}"
        print(f"{file}: {moving.pairs} pairs of frames, {by}")
    misfit = "no still light" if found.misfit is None else f"misfit {found.misfit:.2f} (1: as the noise)"
    print(f"{args.output}: {found.chip} fitted to {counted(len(found.files), 'recording')}, {misfit}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
