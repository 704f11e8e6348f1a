# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands of other programs: `pecs`, and `python -m pecs.datasets`. They replace this process, so that signals and
exit codes need no forwarding."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import NoReturn

from pecs import _platform, program
from pecs._errors import PecsNotFoundError

from .. import stop


def pecs() -> str:
    """Path of the program."""
    try:
        return str(program())
    except FileNotFoundError as e:
        raise PecsNotFoundError(f"pecs: {e}") from None


def pass_on(argv: list[str]) -> int:
    """Runs a command that is not one of the extension's; the exit code of one that runs in this Python."""
    if argv[0] == "reconstruct":
        from pecs.learning.cli import main

        return main(argv)
    if argv[0] == "dataset":
        become([_python_with("scipy"), "-m", "pecs.datasets", *argv[1:]])
    become([pecs(), *argv])


def _python_with(module: str) -> str:
    """PECS_PYTHON, or the first of this Python and the system's that has pecs and the module."""
    named = os.environ.get("PECS_PYTHON")
    for python in [named] if named else [sys.executable, "python3"]:
        try:
            if subprocess.run([python, "-c", f"import pecs, {module}"], capture_output=True).returncode == 0:
                return python
        except OSError:
            pass
    which = named or f"{sys.executable} and python3"
    raise PecsNotFoundError(
        f"dataset requires a Python with pecs and {module}; {which} lacks them (PECS_PYTHON selects another)"
    )


def become(command: list[str]) -> NoReturn:
    stop.clean_up()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    try:
        _platform.become(command)
    except OSError as e:
        raise PecsNotFoundError(f"{command[0]}: {e.strerror}") from None
