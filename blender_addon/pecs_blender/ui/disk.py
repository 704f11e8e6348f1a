# SPDX-License-Identifier: GPL-3.0-or-later
"""Questions to the file system that panels ask at each redraw. Their answers are kept for a second, since a network
drive takes milliseconds for each. In background mode nothing is kept: nothing is redrawn, and scripts see their files
at once."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

import bpy
from pecs._files import existing_folder

KEPT_S = 1.0
MOST = 256  # answers
_answers: dict[tuple, tuple[float, Any]] = {}


def kept(ask: Callable) -> Callable:
    """Decorator of a function with hashable arguments."""

    @wraps(ask)
    def answer(*arguments):
        if bpy.app.background:
            return ask(*arguments)
        key, now = (ask, arguments), time.monotonic()
        if key not in _answers or now - _answers[key][0] > KEPT_S:
            if len(_answers) >= MOST:
                forget()
            _answers[key] = now, ask(*arguments)
        return _answers[key][1]

    return answer


def forget() -> None:
    """After a job, which writes files."""
    _answers.clear()


class Place(NamedTuple):
    """The nearest folder that exists; free: bytes on its disk, None where there is none."""

    path: Path
    is_folder: bool
    is_writable: bool
    free: int | None


@kept
def place(folder: Path) -> Place:
    path = existing_folder(folder)
    usage = shutil.disk_usage(path)
    return Place(path, path.is_dir(), os.access(path, os.W_OK | os.X_OK), usage.free if usage.total else None)


@kept
def is_file(path: Path) -> bool:
    return path.is_file()


@kept
def is_folder(path: Path) -> bool:
    return path.is_dir()


@kept
def modified_ns(path: str) -> int:
    """0 if it does not exist."""
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return 0
