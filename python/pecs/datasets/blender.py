"""Runs `python -m pecs_blender` in another process: this package imports no bpy."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from .._errors import ExitCode, PecsError
from .._platform import die_with_parent, end_of, has_crashed
from .._progress import status_of

CHECKOUT = Path(__file__).resolve().parents[3]
FAULT = 64
READ = f"""import json, sys
from importlib.util import find_spec
from pecs._errors import PecsError
if not find_spec("pecs_blender"):
    sys.exit()
from pecs_blender import cli
from pecs_blender.job.options import DEFAULTS, Options
from pecs_blender.scene.scene_file import load_scene
for words in json.load(sys.stdin):
    try:
        args = vars(cli._parser().parse_args(words))
        Options(**{{name: args[name] for name in DEFAULTS}})
        if args["scene"].suffix != ".blend":
            load_scene(args["scene"], args["set"])
    except PecsError as e:
        print(e)
        sys.exit({FAULT})
"""


def blender(*words: Any, folder: Path, log: str, tell: Callable[[str], None] = lambda progress: None) -> dict[str, Any]:
    """Runs in the folder, so that records contain no absolute path. The output goes to the log, without the progress;
    an error is raised with the renderer's line and exit code. The renderer ends with this process, which frees the
    folder's lock. A renderer that crashes is started once more, and continues. If this Python has no bpy,
    PECS_BLENDER_PYTHON names one that has bpy and pecs_blender. tell: gets the renderer's progress, such as "3/17,
    200 s left". Returns what --plan measures; empty without."""
    python, environment = _python()
    path = folder / log
    path.parent.mkdir(parents=True, exist_ok=True)
    command = die_with_parent([python, "-m", "pecs_blender", *map(str, words)])
    for _ in range(2):
        with path.open("a", encoding="utf-8") as out:
            streams = {"stdout": out, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
            text = {"encoding": "utf-8", "errors": "replace"}
            with subprocess.Popen(command, env=environment, cwd=folder, **text, **streams) as process:
                code, last, cost = _watched(process, out, tell)
        if not has_crashed(code):  # as Blender 4.5 in one of thousands of renders, in its dependency graph
            break
    if code:
        said = last if code > 0 else f"the renderer was ended by {end_of(code)}"
        raise PecsError(f"{said} ({path})", code if 0 < code < 8 else 1)
    return cost


def _python() -> tuple[str, dict[str, str]]:
    """The Python that has bpy and pecs_blender, and its environment in any folder."""
    python = os.environ.get("PECS_BLENDER_PYTHON", sys.executable)
    paths = [Path(p).absolute() for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    if not importlib.util.find_spec("pecs_blender") and (CHECKOUT / "blender_addon").is_dir():
        paths = [CHECKOUT / "blender_addon", CHECKOUT / "python", *paths]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    if "PECS_LIBRARY" in environment:
        environment["PECS_LIBRARY"] = str(Path(environment["PECS_LIBRARY"]).absolute())
    return python, environment | {"PECS_PROGRESS": "json"}


def printed(*words: Any) -> str:
    """The last line that a short command prints. Raises PecsError with the renderer's line and exit code."""
    python, environment = _python()
    command = [python, "-m", "pecs_blender", *map(str, words)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", env=environment)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or [f"the renderer was ended by {end_of(done.returncode)}"])[-1]
        code = done.returncode if 0 < done.returncode < 8 else ExitCode.INTERNAL
        raise PecsError(said.removeprefix("pecs_blender: "), code)
    return done.stdout.strip().splitlines()[-1]


def fault_of(jobs: list[list[str]]) -> str:
    """The error of the options of renders; "" without one, or if there is no pecs_blender to read them."""
    python, environment = _python()
    done = subprocess.run([python, "-c", READ], input=json.dumps(jobs), capture_output=True, text=True, env=environment)
    if done.returncode not in (0, FAULT) and "Traceback" in done.stderr:
        raise PecsError(f"options of renders: {done.stderr.strip().splitlines()[-1]}", 1)
    return done.stdout.strip() if done.returncode == FAULT else ""


def scene_folders() -> list[Path]:
    """Folders of the scenes that come with PECS."""
    found = importlib.util.find_spec("pecs_blender")
    packages = [Path(place).resolve() for place in (found.submodule_search_locations or [])] if found else []
    return [CHECKOUT / "scenes", *(package / "scenes" for package in packages)]


def _watched(
    process: subprocess.Popen[str], log: TextIO, tell: Callable[[str], None]
) -> tuple[int, str, dict[str, Any]]:
    """The exit code, the last line of standard error, and the values of its plan. `tell` gets its progress, the log its
    other lines."""
    last, cost = "no output", {}
    try:
        for line in process.stderr or ():
            if status := status_of(line):
                if status.get("progress") == "render" and {"done", "total", "left_s"} <= status.keys():
                    tell("{done}/{total}, {left_s:.0f} s left".format_map(status))
                cost = status.get("plan", cost)
                continue
            print(line, end="", file=log, flush=True)
            last = line.strip() or last
        return process.wait(), last, cost
    except BaseException:  # stopped; finished frames are kept
        process.terminate()
        raise
