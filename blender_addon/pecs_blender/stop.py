# SPDX-License-Identifier: GPL-3.0-or-later
"""SIGINT and SIGTERM. An exception from a handler would rise in Cycles' callbacks, where Blender swallows it or hangs
at exit; so a signal only sets a flag that the render checks between passes. After GRACE_S or at a second signal, a
thread ends the process."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
from pathlib import Path
from typing import NoReturn

GRACE_S = 2.0  # for the current pass

_signal: int | None = None
_to_remove: list[Path] = []


class Stopped(Exception):
    """Raised between passes after a signal."""


def install() -> None:
    """Call in the main thread, before Blender is loaded."""
    stderr = os.dup(2)  # 2 is redirected at times
    signals, waker = os.pipe()
    os.set_blocking(waker, False)
    signal.set_wakeup_fd(waker, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    threading.Thread(target=_watch, args=(signals, stderr), daemon=True).start()


def _watch(signals: int, stderr: int) -> None:
    global _signal
    _signal = _next(signals)
    second = threading.Thread(target=_next, args=(signals,), daemon=True)
    second.start()
    second.join(GRACE_S)
    leave(stderr)


def _next(signals: int) -> int:
    while (number := os.read(signals, 1)[0]) not in (signal.SIGINT, signal.SIGTERM):
        pass
    return number


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
