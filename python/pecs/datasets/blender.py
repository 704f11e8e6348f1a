"""Runs `python -m pecs_blender` in a process of its own: this package imports no bpy."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from .._library import PecsError

PR_SET_PDEATHSIG = 1
CHECKOUT = Path(__file__).resolve().parents[3]


def _die_with_us() -> None:
    """A renderer whose parent was killed would hold the folder against the next run (Linux, prctl(2))."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def blender(*words: Any, folder: Path, log: str) -> None:
    """Runs in the folder, so that what it records does not say where that is. Its words go to the log; an error is
    raised with its own line and code. PECS_BLENDER_PYTHON: a Python with bpy and pecs_blender, where this one has
    none."""
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
        with subprocess.Popen(command, env=environment, cwd=folder, preexec_fn=_die_with_us, **streams) as process:
            try:
                code = process.wait()
            except BaseException:  # stopped: it keeps what is finished, and so do we
                process.terminate()
                raise
    if code:
        lines = path.read_bytes()[begin:].decode(errors="replace").strip().splitlines() or ["no words"]
        raise PecsError(f"{lines[-1]} ({path})", code if 0 < code < 8 else 1)
