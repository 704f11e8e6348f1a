# SPDX-License-Identifier: GPL-3.0-or-later
"""What other programs do: `pecs`, and `python -m pecs.datasets`. This process becomes them, so that signals and exit
codes are theirs."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import NoReturn

from . import stop
from .errors import NOT_FOUND, RenderError

VERBS = ("compare", "convert", "info", "lens", "render-preview", "report", "sense", "view")


def pecs() -> str:
    """Path of the program."""
    try:
        from pecs import program

        return str(program())
    except (ImportError, FileNotFoundError) as e:
        raise RenderError(NOT_FOUND, f"pecs: {e}") from None


def pass_on(argv: list[str]) -> None:
    """Returns where the verb is none of theirs."""
    if argv and argv[0] in VERBS:
        become([pecs(), *argv])
    if argv and argv[0] == "dataset":
        become([_python_with("scipy"), "-m", "pecs.datasets", *argv[1:]])


def _python_with(module: str) -> str:
    """PECS_PYTHON, or this Python, or the system's: one that has pecs and the module."""
    named = os.environ.get("PECS_PYTHON")
    for python in [named] if named else [sys.executable, "python3"]:
        try:
            if subprocess.run([python, "-c", f"import pecs, {module}"], capture_output=True).returncode == 0:
                return python
        except OSError:
            pass
    which = named or f"{sys.executable} and python3"
    raise RenderError(
        NOT_FOUND, f"dataset: got no pecs and {module} in {which}, wanted a Python (PECS_PYTHON) with both"
    )


def become(command: list[str]) -> NoReturn:
    stop.clean_up()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    try:
        os.execvp(command[0], command)
    except OSError as e:
        raise RenderError(NOT_FOUND, f"{command[0]}: {e.strerror}") from None
