# SPDX-License-Identifier: GPL-3.0-or-later
"""SIGINT and SIGTERM. An exception from a handler would rise in Cycles' callbacks, where Blender swallows it or hangs
at exit; so a signal only sets a flag that the render checks between passes. After GRACE_S or at a second signal, a
thread ends the process."""

from __future__ import annotations

import os
import shutil
import sys
import threading
from pathlib import Path
from typing import NoReturn

from pecs import _platform

GRACE_S = 2.0  # for the current pass

_signal: int | None = None
_to_remove: list[Path] = []


class Stopped(Exception):
    """Raised between passes after a signal."""


def install() -> None:
    """Call in the main thread, before Blender is loaded."""
    stderr = os.dup(2)  # 2 is redirected at times
    _platform.raise_nothing_when_stopped()
    _platform.watch_stops(lambda number: _stopped(number, stderr))


def _stopped(number: int, stderr: int) -> None:
    global _signal
    if _signal is not None:
        leave(stderr)
    _signal = number
    grace = threading.Timer(GRACE_S, leave, [stderr])
    grace.daemon = True
    grace.start()


def check() -> None:
    if _signal is not None:
        raise Stopped


def remove_at_exit(folder: Path) -> None:
    _to_remove.append(folder)


def clean_up() -> None:
    """Removes temporary folders, also Blender's, whose exit may hang and is skipped."""
    if "bpy" in sys.modules:
        _to_remove.append(Path(sys.modules["bpy"].app.tempdir))
    while _to_remove:
        shutil.rmtree(_to_remove.pop(), ignore_errors=True)


_leaving = threading.Lock()


def leave(stderr: int = 2) -> NoReturn:
    """Ends a stopped process, once, from any thread."""
    with _leaving:
        os.write(stderr, b"pecs_blender: stopped; finished frames are kept, run again to continue\n")
        clean_up()
        os._exit(128 + _signal)
