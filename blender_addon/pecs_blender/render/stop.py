# SPDX-License-Identifier: GPL-3.0-or-later
"""SIGINT and SIGTERM. A handler that raised would raise inside Cycles' callbacks, where Blender swallows it or hangs in
its own exit; so a signal only sets a flag, which the render looks at between passes. What takes longer than GRACE_S, or
a second signal, ends the process from a thread of its own."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
from pathlib import Path
from typing import NoReturn

GRACE_S = 2.0  # for the pass in hand

_signal: int | None = None
_to_remove: list[Path] = []


class Stopped(Exception):
    """Between passes: a signal has come."""


def install() -> None:
    """In the main thread, before Blender is loaded."""
    stderr = os.dup(2)  # Blender's own is sent away at times
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
    """What this process keeps outside its output; Blender's own exit may hang, or print of memory it kept."""
    if "bpy" in sys.modules:
        _to_remove.append(Path(sys.modules["bpy"].app.tempdir))
    while _to_remove:
        shutil.rmtree(_to_remove.pop(), ignore_errors=True)


_leaving = threading.Lock()


def leave(stderr: int = 2) -> NoReturn:
    """Ends a stopped process, from whichever thread comes first."""
    with _leaving:
        os.write(stderr, b"pecs_blender: stopped; finished frames are kept, run again to continue\n")
        clean_up()
        os._exit(128 + _signal)
