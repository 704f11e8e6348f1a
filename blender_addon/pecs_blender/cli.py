# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: `python -m pecs_blender …` and `blender --command pecs …`."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
from pathlib import Path

from .core.errors import BAD_OUTPUT, INTERRUPTED, NOT_FOUND, USAGE, RenderError
from .core.resources import Restart
from .core.scene_file import load_scene
from .core.spectra import spectrum

PLACEMENTS = ("gauss", "strata", "uniform")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"got {text}, wanted an integer above 0")
    return value


def _range(text: str) -> slice:
    begin, colon, end = text.partition(":")
    if not (colon and begin.isdigit() and end.isdigit() and int(begin) < int(end)):
        raise argparse.ArgumentTypeError(f"got {text}, wanted A:B with A < B")
    return slice(int(begin), int(end))


def _box(text: str) -> tuple[int, ...]:
    numbers = text.split(":")
    if len(numbers) != 4 or not all(n.isdigit() for n in numbers):
        raise argparse.ArgumentTypeError(f"got {text}, wanted X0:Y0:X1:Y1 in pixels from the top left")
    return tuple(map(int, numbers))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="pecs_blender", description="PECS: spectral renders through a real lens")
    commands = parser.add_subparsers(dest="command", required=True)
    _add_render(commands)
    bands = commands.add_parser(
        "bands",
        help="wavelengths to render for a chip, and their weights",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = bands.add_argument
    add("--chip", default="imx636", help="name or .json file")
    add("-n", "--bands", type=_positive, default=6, help="number of wavelengths")
    add("--placement", choices=PLACEMENTS, default="gauss", help="where the bands lie")
    add("--illuminant", default="d65", help="the lamp: a name, CSV, blackbody:T or daylight:T")
    add("--min-nm", type=float, help="shortest wavelength; where chip and lamp begin if not given")
    add("--max-nm", type=float, help="longest wavelength; where chip and lamp end if not given")
    add("--json", action="store_true", help="machine-readable output")
    merge = commands.add_parser(
        "merge",
        help="join shards of a stack",
        description="Joins stacks that differ in their instants alone into the stack that one run would have written.",
    )
    merge.add_argument("shards", type=Path, nargs="+", help="folders of stacks")
    merge.add_argument("-o", "--output", type=Path, required=True, help="folder of the joined stack")
    return parser


def _add_render(commands) -> None:
    command = commands.add_parser(
        "render",
        help="render a scene into an EXR stack",
        description="Renders a .blend file or a scene folder into an EXR stack (docs/exr_stack.md). Run again, a "
        "stopped job continues. The .blend is never written.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = command.add_argument
    add(
        "scene",
        type=Path,
        nargs="?",
        help="FILE.blend, or a scene folder; in Blender, the open file",
    )
    add("-o", "--output", type=Path, required=True, help="folder of the stack")
    add("--bands", type=_positive, default=6, help="number of wavelengths; three share an RGB pass")
    add("--placement", choices=PLACEMENTS, default="gauss", help="where the bands lie")
    add("--bands-per-pass", type=int, choices=(1, 2, 3), default=3, help="1: dispersion in glass objects is exact")
    add("--chip", default="imx636", help="the chip whose response places the bands")
    add("--min-nm", type=float, help="shortest wavelength; where chip and lamps begin if not given")
    add("--max-nm", type=float, help="longest wavelength; where chip and lamps end if not given")
    add("--illuminant", default="d65", help="spectrum of RGB lamps and skies: a name, CSV, blackbody:T or daylight:T")
    add("--light-scale", type=float, default=1.0, help="multiplies all light")
    add("--fps", type=float, default=10000.0, help="instants per second of the scene")
    add("--frames", default="100", help="N, A:B, 'period' for one period in equal steps, 'all' for a .blend's range")
    add("--only", type=_range, metavar="A:B", help="render these frames of the plan (a shard)")
    add(
        "--moving-px",
        type=_box,
        metavar="X0:Y0:X1:Y1",
        help="only this part of the picture changes: render the rest once",
    )
    add("--width", type=_positive, help="pixels; the scene's if not given")
    add("--height", type=_positive, help="pixels; in the scene's shape if not given")
    add("--film-width-mm", type=float, default=6.2208, help="of a lens camera")
    for name, unit, what in (
        ("shift", "mm", "the film's centre off the lens' axis"),
        ("tilt", "deg", "about its x, then y axis"),
    ):
        add(f"--film-{name}-{unit}", type=float, nargs=2, default=[0.0, 0.0], metavar=("X", "Y"), help=what)
    add("--samples", type=_positive, default=8, help="paths per pixel and band")
    add("--noise-target", type=float, help="choose --samples: noise of ln(light), in contrast thresholds of the chip")
    add("--denoise", action="store_true", help="OpenImageDenoise with albedo and normals")
    add(
        "--device", choices=("CPU", "CUDA", "OPTIX", "HIP", "ONEAPI", "METAL"), default="CPU", help="lens: CPU or OPTIX"
    )
    add("--seed", type=int, default=1)
    add("--lens", help="name, file, or 'none': a pinhole or the .blend's camera (radiance); the scene's if not given")
    stop = command.add_mutually_exclusive_group()
    stop.add_argument("--stop-diameter-mm", type=float, help="the scene's if not given")
    stop.add_argument("--fnumber", type=float, help="instead of a diameter")
    add("--focus-m", type=float, help="the scene's if not given")
    add("--focal-mm", type=float, default=15.02, help="of a scene folder's pinhole")
    add(
        "--colour-tolerance-px",
        type=float,
        default=0.1,
        help="bands of a pass that lie closer on the film share their rays (at their mean wavelength); else every ray "
        "carries one band, which is noisier",
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a parameter of the scene folder; @FILE: those of an aligned.json",
    )
    add("--scene-name", help="which scene of the .blend")
    add("--allow-scripts", action="store_true", help="run the .blend's Python (drivers, registered texts)")
    add("--threads", type=int, default=0, help="0: all cores; does not change the result")
    add("--restart-growth-mb", type=float, default=1000.0, help="memory growth at which the process starts afresh")


@contextlib.contextmanager
def _library_errors():
    """Errors of libpecs as ours. In a `with` after bpy is imported: both carry libtbb."""
    try:
        import pecs
    except ImportError as e:
        raise RenderError(NOT_FOUND, f"pecs: {e}") from None
    try:
        yield
    except pecs.PecsError as e:
        raise RenderError(e.code, str(e)) from None


def _render(args: dict) -> None:
    path, output, overrides = args.pop("scene"), args.pop("output"), args.pop("set")
    scene_name, allow_scripts = args.pop("scene_name"), args.pop("allow_scripts")
    try:
        import bpy  # before pecs
    except ImportError as e:
        raise RenderError(USAGE, f"bpy: {e}; pip install bpy, or run inside Blender") from None
    from .scene import job
    from .scene.blend import BlendScene
    from .scene.folder import FolderScene

    path = path or Path(bpy.data.filepath)
    if path == Path():
        raise RenderError(USAGE, "render: got no scene, wanted FILE.blend or a scene folder")
    try:
        with _library_errors():
            options = job.Options(**args)
            if path.suffix == ".blend":
                if overrides:
                    raise RenderError(USAGE, f"--set {overrides[0]}: got a .blend, wanted a scene folder")
                illuminant = spectrum(options.illuminant, path.absolute().parent)
                source = BlendScene(path, scene_name, illuminant, allow_scripts)
            else:
                source = FolderScene(load_scene(path, overrides))
            job.render(source, output, options)
    except OSError as e:
        raise RenderError(BAD_OUTPUT, f"{e.filename or output}: cannot be written: {e.strerror}") from None


def _bands(args: dict) -> None:
    with _library_errors():
        import pecs

        lamp = spectrum(args["illuminant"], Path.cwd())
        pairs = None if lamp.is_constant else list(zip(lamp.lambda_nm, lamp.value, strict=True))
        bands = pecs.bands(args["chip"], args["bands"], args["placement"], pairs, args["min_nm"], args["max_nm"])
    if args["json"]:
        print(json.dumps({"bands": bands}))
        return
    print("wavelength_nm  weight_nm")
    for band in bands:
        print(f"{band['lambda_nm']:13.3f}  {band['weight_nm']:9.3f}")


def _merge(args: dict) -> None:
    from .core.shards import merge

    try:
        with _library_errors():
            merge(args["shards"], args["output"])
    except OSError as e:
        raise RenderError(BAD_OUTPUT, f"{e.filename}: cannot be written: {e.strerror}") from None


def main(argv: list[str]) -> int:
    try:
        args = vars(_parser().parse_args(argv))
    except SystemExit as e:  # --help, or wrong usage
        return e.code or 0
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(INTERRUPTED))
    try:
        {"render": _render, "bands": _bands, "merge": _merge}[args.pop("command")](args)
    except RenderError as e:
        print(f"pecs_blender: {e}", file=sys.stderr)
        return e.code
    except Restart:
        import bpy

        sys.stderr.flush()
        if bpy.app.binary_path:
            os.execv(bpy.app.binary_path, sys.argv)
        os.execv(sys.executable, [sys.executable, "-m", "pecs_blender", *argv])
    except KeyboardInterrupt:
        print("pecs_blender: stopped; finished frames are kept, run again to continue", file=sys.stderr)
        return INTERRUPTED
    return 0
