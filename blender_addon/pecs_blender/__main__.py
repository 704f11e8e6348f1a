# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m pecs_blender render SCENE -o STACK …, and the same after `--` for `blender --background --python`."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

if __package__ in (None, ""):  # blender --background --python …/__main__.py -- render …
    here = Path(__file__).resolve().parent
    sys.path[:0] = [str(here.parent), str(here.parents[1] / "python")]

from pecs_blender.core.errors import BAD_OUTPUT, INTERRUPTED, USAGE, RenderError
from pecs_blender.core.scene_file import load_scene


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"got {text}, wanted an integer above 0")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="pecs_blender", description="PECS: spectral renders through a real lens")
    command = parser.add_subparsers(dest="command", required=True).add_parser(
        "render",
        help="render a scene into an EXR stack",
        description="Renders a scene folder into an EXR stack (docs/exr_stack.md). Run again, a stopped job continues.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    command.add_argument("scene", type=Path, help="folder with scene.json and scene.py")
    command.add_argument("-o", "--output", type=Path, required=True, help="folder of the stack")
    command.add_argument("--bands", type=_positive, default=6, help="number of wavelengths; three share an RGB pass")
    command.add_argument("--placement", choices=("gauss", "uniform"), default="gauss", help="where the bands lie")
    command.add_argument("--chip", default="imx636", help="the chip whose response places the bands")
    command.add_argument("--fps", type=float, default=10000.0, help="instants per second of the scene")
    command.add_argument("--frames", default="100", help="N, A:B, or 'period' for one period in equal steps")
    command.add_argument("--width", type=_positive, default=1280, help="pixels; the film stays 6.2208 mm wide")
    command.add_argument("--height", type=_positive, help="pixels; 9/16 of the width if not given")
    command.add_argument("--samples", type=_positive, default=8, help="paths per pixel and band")
    command.add_argument("--seed", type=int, default=1)
    command.add_argument("--lens", help="name, file, or 'none' for a pinhole (radiance); the scene's if not given")
    command.add_argument("--stop-diameter-mm", type=float, help="the scene's if not given")
    command.add_argument("--focus-m", type=float, help="the scene's if not given")
    command.add_argument("--focal-mm", type=float, default=15.02, help="of the pinhole")
    command.add_argument(
        "--colour-tolerance-px",
        type=float,
        default=0.1,
        help="bands of a pass that lie closer on the film share their rays (at their mean wavelength); else every ray "
        "carries one band, which is noisier",
    )
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a parameter of the scene")
    command.add_argument("--threads", type=int, default=0, help="0: all cores; does not change the result")
    return parser


def main(argv: list[str]) -> int:
    args = vars(_parser().parse_args(argv))
    scene, output, overrides = args.pop("scene"), args.pop("output"), args.pop("set")
    args.pop("command")
    args["height"] = args["height"] or round(args["width"] * 9 / 16)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(INTERRUPTED))
    try:
        scene_file = load_scene(scene, overrides)
        try:
            import bpy  # noqa: F401  before pecs
        except ImportError as e:
            raise RenderError(USAGE, f"bpy: {e}; pip install bpy, or run inside Blender") from None
        import pecs

        from pecs_blender.scene import job

        try:
            job.render(scene_file, output, job.Options(**args))
        except pecs.PecsError as e:
            raise RenderError(e.code, str(e)) from None
        except OSError as e:
            raise RenderError(BAD_OUTPUT, f"{e.filename or output}: cannot be written: {e.strerror}") from None
    except RenderError as e:
        print(f"pecs_blender: {e}", file=sys.stderr)
        return e.code
    except KeyboardInterrupt:
        print("pecs_blender: stopped; finished frames are kept, run again to continue", file=sys.stderr)
        return INTERRUPTED
    return 0


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    sys.exit(main(arguments))
