# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk space and memory of a long job."""

from __future__ import annotations

import shutil
from pathlib import Path

from .errors import BAD_OUTPUT, RenderError

BYTES_PER_VALUE = 4  # what a frame file takes at most, before compression


class Restart(Exception):
    """The process has grown: start it afresh; finished frames are kept."""


def check_disk(folder: Path, values: int) -> None:
    """Before a job starts: room for all its frames."""
    place = folder.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        return  # the writer says what is wrong with it
    disk, wanted = shutil.disk_usage(place), values * BYTES_PER_VALUE
    if disk.total and disk.free < wanted:  # /proc has none: the writer says what is wrong with it, too
        raise RenderError(
            BAD_OUTPUT, f"{folder}: disk: got {readable(disk.free)} free, wanted {readable(wanted)} for all frames"
        )


def readable(size_bytes: float) -> str:
    """In the unit that one reads best."""
    unit, factor = next(((u, f) for u, f in (("TB", 1e12), ("GB", 1e9)) if size_bytes >= f), ("MB", 1e6))
    return f"{size_bytes / factor:.3g} {unit}"


def resident_mb() -> float:
    """This process's resident memory; 0 where /proc is not."""
    return _memory_mb("VmRSS")


def peak_mb() -> float:
    """The most that it has been."""
    return _memory_mb("VmHWM")


def _memory_mb(name: str) -> float:
    try:
        text = Path("/proc/self/status").read_text()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1024 for line in text.splitlines() if line.startswith(name)), 0.0)
