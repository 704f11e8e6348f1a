# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: `python -m pecs_blender …` and `blender --command pecs …`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import pecs
from pecs import _arguments
from pecs._arguments import Quantity, account
from pecs._errors import ExitCode, PecsError, PecsOutputError, UsageError, missing_package, one_line
from pecs._platform import discard
from pecs._progress import report

from . import stop
from .job import programs
from .job.brightness import light_words
from .job.options import DEFAULTS, RULES, Options, add_arguments
from .job.resources import Restart
from .job.shards import merge
from .spectral.spectra import OCIO

if TYPE_CHECKING:  # they import bpy
    from .camera.plan import Plan
    from .scene.source import Source

SCENE_KEYS = ("scene_name", "allow_scripts", "place", "camera")  # options that are arguments of open_scene
SCENE_HELP = "FILE.blend, or a scene folder; in Blender, the open file"


class Parser(_arguments.Parser):
    def print_help(self, file: object = None) -> None:
        write_out(self.format_help())


def write_out(text: str) -> None:
    """To standard output. Raises PecsOutputError if it cannot be written."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as e:
        discard(1)  # the rest of the buffer must not fail again at exit
        raise PecsOutputError(f"standard output: cannot be written: {e.strerror}") from None


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="pecs_blender",
        description="PECS: spectral renders through a real lens.\n\n"
        "All other commands are those of the program `pecs`.",
        examples=["pecs_blender render FILE.blend -o out/stack", "pecs_blender run FILE.blend -o events.raw"],
    )
    commands = parser.add_commands()
    for name, (_, add_options, text, description, *examples) in COMMANDS.items():
        prog = "pecs run" if name == "run" else f"pecs_blender {name}"
        add_options(commands.add_parser(name, prog=prog, help=text, description=description, examples=examples))
    return parser


def _render_options(command) -> None:
    add = command.add_argument
    add("scene", type=Path, nargs="?", help=SCENE_HELP)
    add("-o", "--output", type=Path, required=True, help="folder of the stack")
    add("--plan", action="store_true", help="print the number of instants, time and disk space, and write nothing")
    _job_options(command)


def _run_options(command) -> None:
    add = command.add_argument
    add("scene", type=Path, nargs="?", help=SCENE_HELP)
    text = "event file; the extension selects the format"
    add("-o", "--output", type=Path, required=True, metavar="EVENTS", help=text)
    add("--stack", type=Path, help="folder of the stack, which is kept; by default EVENTS with the extension .stack")
    _job_options(command)
    text = "options that follow are passed to `pecs sense`: --seed 2 --set contrast_threshold_on=0.3 --no-noise"
    add("--sense", nargs=argparse.REMAINDER, default=[], metavar="…", help=text)
    command.set_defaults(time="adaptive")
    command.hint = "; options of pecs sense follow --sense"


def _job_options(command) -> None:
    add_arguments(command)
    _scene_options(command)
    exists = command.add_mutually_exclusive_group()
    add = exists.add_argument
    add(
        "--overwrite",
        action="store_true",
        help="replace an existing stack that has other settings or shows another scene",
    )
    add("--new-version", action="store_true", help="if a different stack exists, write STACK_002, STACK_003, …")


def _scene_options(command) -> None:
    add = command.add_argument
    text = "set a parameter of the scene folder; @FILE sets those of an aligned.json or a sequence"
    add("--set", action="append", default=[], metavar="KEY=VALUE", help=text)
    add("--place", type=Path, metavar="FILE", help="JSON file of objects from other files to add to the scene")
    add("--scene-name", help="scene of the .blend; by default the active one")
    add("--camera", metavar="NAME", help="camera of the .blend; by default the active one, and those of markers")
    add("--allow-scripts", action="store_true", help="run the .blend's Python (drivers, registered texts)")


def _survey_options(command) -> None:
    add = command.add_argument
    add("scene", type=Path, help="FILE.blend, or a scene folder")
    add("-o", "--output", type=Path, required=True, metavar="FILE.npz", help="file of the points")
    add("--frames", help=f"{RULES['frames'].help}; by default the period or the range")
    add("--fps", type=Quantity("Hz", above=0, below=1e9), default=10.0, help="instants per second")
    text = "distance of neighbouring points; by default chosen for 200,000 points"
    add("--spacing", dest="spacing_m", type=Quantity("m", above=0, below=1e9), help=text)
    _scene_options(command)


def _light_options(command) -> None:
    command.add_argument("scene", type=Path, nargs="?", help=SCENE_HELP)
    command.add_argument("--json", action="store_true", help="machine-readable output")
    add_arguments(command)
    _scene_options(command)


def _cameras_options(command) -> None:
    command.add_argument("scene", type=Path, help="FILE.blend")
    _scene_options(command)


def _merge_options(command) -> None:
    command.add_argument("shards", type=Path, nargs="+", help="folders of stacks")
    command.add_argument("-o", "--output", type=Path, required=True, help="folder of the joined stack")


def _render(args: dict, check: Callable[[Source, Plan], None] | None = None) -> Path:
    """The stack's folder. check: of what follows the render, before it begins."""
    begin_s = time.perf_counter()
    source, plan = _opened(args)
    from .job.render import render

    exists = "overwrite" if args["overwrite"] else "new" if args["new_version"] else "continue"
    if check:
        check(source, plan)
    folder = render(source, args["output"], plan, exists, begin_s if args["plan"] else None)
    if folder != args["output"]:
        report(f"render: into {folder}", folder=str(folder))
    return folder


def _run(args: dict) -> None:
    events, stack, sense = args["output"], args["stack"], args["sense"]
    if args["no_light"] or args["only"]:
        name = "--no-light" if args["no_light"] else "--only"
        message = f"{name} cannot be combined with run, which needs the whole stack; use render, then sense"
        raise UsageError(message)
    program, stack = [programs.pecs(), "sense"], stack or events.with_suffix(".stack")
    words = ["--chip", args["chip"], "--threads", str(args["threads"]), *sense]
    if not {"--quiet", "--verbose"} & set(sense):
        words += [f"--{name}" for name in ("quiet", "verbose") if args[name]]

    def check(source: Source, plan: Plan) -> None:
        from .job.rehearsal import rehearse

        rehearse(program, events, stack, words, source, plan)

    folder = _render({**args, **_chip_size(args), "output": stack, "plan": False}, check)
    programs.become([*program, str(folder), "-o", str(events), *words])


def _chip_size(args: dict) -> dict[str, int]:
    """The size of a chip that has one, unless a size is given."""
    chip = pecs.Chip(args["chip"])
    given = args["width"] or args["height"] or not (chip.width and chip.height)
    return {} if given else {"width": chip.width, "height": chip.height}


def _opened(args: dict) -> tuple[Source, Plan]:
    """The scene of _scene_options, and the plan of add_arguments."""
    options, how = Options(**{name: args[name] for name in DEFAULTS}), _how(args)
    from .job.resolve import opened

    return opened(how.pop("path"), options, **how)


def _how(args: dict) -> dict[str, Any]:
    """Arguments of open_scene."""
    try:
        import bpy
    except ImportError as e:
        raise UsageError(f"bpy: {e}; pip install bpy, or run inside Blender") from None
    path = args["scene"] or Path(bpy.data.filepath)
    if path == Path():
        raise UsageError("render requires a scene: FILE.blend or a scene folder")
    return {"path": path, "parameters": args["set"], **{k: args[k] for k in SCENE_KEYS}}


def _survey(args: dict) -> None:
    output = args["output"]
    if output.suffix != ".npz":
        raise UsageError(f"-o {output}: the extension must be .npz")
    how = _how(args)
    from .scene.open import open_scene
    from .truth.survey import survey

    survey(open_scene(illuminant=DEFAULTS["illuminant"], **how), output, args["frames"], args["fps"], args["spacing_m"])


def _light(args: dict) -> None:
    source, plan = _opened({**args, **_chip_size(args)})
    from .camera.probe import probe

    measured = probe(source, plan)
    write_out(json.dumps(measured) + "\n" if args["json"] else light_words(measured))


def _cameras(args: dict) -> None:
    how = _how(args)
    from .scene.cameras import describe
    from .scene.open import open_scene
    from .ui.stored import stored

    if args["scene"].suffix != ".blend":
        raise UsageError(f"{args['scene']}: cameras requires a .blend")
    source = open_scene(illuminant=DEFAULTS["illuminant"], **how)
    write_out(json.dumps(describe(source) | {"panel": stored(source.scene)}) + "\n")


COMMANDS: dict[str, tuple] = {  # action, options, help, description, examples
    "render": (
        _render,
        _render_options,
        "render a scene into an EXR stack",
        "Renders a .blend file or a scene folder into an EXR stack (docs/reference/exr_stack.md). To continue a "
        "stopped job, run it again. The .blend is never written.",
        "pecs_blender render FILE.blend -o out/stack --frames all --fps 1kHz --lens pecs_lab_15mm --focus 0.5m",
        "pecs_blender render scenes/rotating_disk -o out/stack --frames period --width 320 --plan",
        "pecs_blender render FILE.blend -o out/stack --time adaptive --layers depth,objects",
    ),
    "run": (
        _run,
        _run_options,
        "render a scene and simulate its events",
        "Renders a .blend file or a scene folder like `render`, and passes the stack to `pecs sense`. Without --width "
        "and --height, the picture has the size of the chip, if it has one. To continue a stopped job, run it again.",
        "pecs run FILE.blend -o events.raw --frames all --width 346 --chip davis346",
        "pecs run FILE.blend -o events.raw --lux 500lx --sense --seed 2 --no-noise",
    ),
    "survey": (
        _survey,
        _survey_options,
        "sample points on the surfaces of a scene",
        "Writes points on all surfaces of a scene, at several instants, into an .npz file (docs/reference/render.md), "
        "for planning a camera trajectory outside Blender.",
        "pecs_blender survey FILE.blend -o points.npz --fps 10 --spacing 5cm",
    ),
    "light": (
        _light,
        _light_options,
        "measure the light of a scene and its effect on a chip",
        "Renders a small picture of the first instant with the scene's own camera, and prints the illuminance of the "
        "surfaces in view, the photocurrent and the photoreceptor's corner frequency: 5 %, median and 95 % over the "
        "pixels. Options are those of `render`.",
        "pecs_blender light FILE.blend",
        "pecs_blender light FILE.blend --chip davis346 --json",
    ),
    "cameras": (
        _cameras,
        _cameras_options,
        "print the cameras of a .blend",
        "Prints the cameras of a .blend as JSON: optics, and poses over the range of frames, with the panel's settings "
        "if the file has them. A data set takes its rig from this.",
        "pecs_blender cameras FILE.blend",
    ),
    "merge": (
        lambda args: merge(args["shards"], args["output"]),
        _merge_options,
        "join shards of a stack",
        "Joins stacks that differ only in their instants into the stack that one run would have written.",
        "pecs_blender merge out/part_0 out/part_1 -o out/stack",
    ),
}


def main(argv: list[str]) -> int:
    begin = time.monotonic()
    try:
        if argv and argv[0] not in COMMANDS and not argv[0].startswith("-"):
            return programs.pass_on(argv)
        if "bpy" not in sys.modules:
            for name in OCIO:
                os.environ.pop(name, None)
        args = vars(_parser().parse_args(argv))
        used, command = dict(args), args.pop("command")
        if command in ("render", "run"):
            stop.install()
        COMMANDS[command][0](args)
        if used["verbose"]:
            sys.stderr.write(account(command, used, time.monotonic() - begin))
    except SystemExit as e:  # --help
        return e.code or 0
    except Restart:
        _restart(argv)
    except stop.Stopped:
        stop.leave()
    except PecsError as e:
        return _report(argv, str(e), e.code)
    except ImportError as e:
        error = missing_package(e)
        return _report(argv, str(error), error.code)
    except OSError as e:
        return _report(argv, f"{e.filename or 'output'}: cannot be written: {e.strerror}", ExitCode.BAD_OUTPUT)
    return 0


def _report(argv: list[str], message: str, code: int) -> int:
    message = one_line(message)
    prefix = f"pecs: run: {message.removeprefix('run: ')}" if argv[:1] == ["run"] else f"pecs_blender: {message}"
    print(prefix, file=sys.stderr)
    return int(code)


def _restart(argv: list[str]) -> NoReturn:
    import bpy

    command = [sys.executable, "-m", "pecs_blender", *argv]
    if bpy.app.binary_path:
        command = [bpy.app.binary_path, *sys.argv[1:]]
    programs.become(command)
