"""Runs `python -m pecs_blender` in another process: this package imports no bpy."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .._child import mortal
from .._errors import PecsError

CHECKOUT = Path(__file__).resolve().parents[3]
STEP = re.compile(r"^render: (\d+/\d+, \d+ s left)$", re.MULTILINE)


def blender(*words: Any, folder: Path, log: str, tell: Callable[[str], None] = lambda progress: None) -> None:
    """Runs in the folder, so that records contain no absolute path. The output goes to the log; an error is raised with
    the renderer's line and exit code. The renderer ends with this process, which frees the folder's lock. If this
    Python has no bpy, PECS_BLENDER_PYTHON names one that has bpy and pecs_blender. tell: gets the renderer's progress,
    such as "3/17, 200 s left"."""
    python = os.environ.get("PECS_BLENDER_PYTHON", sys.executable)
    paths = [Path(p).absolute() for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    if not importlib.util.find_spec("pecs_blender") and (CHECKOUT / "blender_addon").is_dir():
        paths = [CHECKOUT / "blender_addon", CHECKOUT / "python", *paths]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    if "PECS_LIBRARY" in environment:
        environment["PECS_LIBRARY"] = str(Path(environment["PECS_LIBRARY"]).absolute())
    path = folder / log
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as out:
        begin = out.tell()
        command = [python, "-m", "pecs_blender", *map(str, words)]
        streams = {"stdout": out, "stderr": out, "stdin": subprocess.DEVNULL}
        with subprocess.Popen(mortal(command), env=environment, cwd=folder, **streams) as process:
            try:
                code = None
                while code is None:
                    code = _ended(process)
                    if steps := STEP.findall(_output(path, begin)):
                        tell(steps[-1])
            except BaseException:  # stopped; finished frames are kept
                process.terminate()
                raise
    if code:
        lines = _output(path, begin).strip().splitlines() or ["no output"]
        raise PecsError(f"{lines[-1]} ({path})", code if 0 < code < 8 else 1)


def _ended(process: subprocess.Popen[bytes]) -> int | None:
    """The exit code, waited for a second."""
    try:
        return process.wait(1)
    except subprocess.TimeoutExpired:
        return None


def _output(log: Path, begin: int) -> str:
    """What a log contains from a byte on."""
    return log.read_bytes()[begin:].decode(errors="replace")
