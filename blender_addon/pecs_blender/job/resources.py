# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk space and memory of a long job."""

from __future__ import annotations

import shutil
from pathlib import Path

from pecs._errors import PecsOutputError
from pecs._files import existing_folder
from pecs._platform import resident_mb

BYTES_PER_VALUE = 4  # upper bound of a frame file, before compression
RESTART_GROWTH_MB = 1000.0  # growth of memory at which the process restarts


class Restart(Exception):
    """The process has grown and must be restarted; finished frames are kept."""


class MemoryGuard:
    """Throws Restart when memory has grown by RESTART_GROWTH_MB since the caches were full, `warm_up` frames after the
    first."""

    def __init__(self, warm_up: int):
        self._warm_up, self._first_mb = warm_up, 0.0

    def check(self) -> None:
        """Call after each frame but the last."""
        if self._warm_up > 0:
            self._warm_up -= 1
            return
        self._first_mb = self._first_mb or resident_mb()
        if resident_mb() > self._first_mb + RESTART_GROWTH_MB:
            raise Restart


def check_disk(folder: Path, needed_bytes: int) -> None:
    place = existing_folder(folder)
    if not place.is_dir():
        return  # the writer reports the error
    disk = shutil.disk_usage(place)
    if disk.total and disk.free < needed_bytes:  # total 0: no disk; the writer reports the error
        raise PecsOutputError(
            f"{folder}: disk: got {readable(disk.free)} free, wanted {readable(needed_bytes)} for the frames to render"
        )


def readable(size_bytes: float) -> str:
    unit, factor = next(((u, f) for u, f in (("TB", 1e12), ("GB", 1e9)) if size_bytes >= f), ("MB", 1e6))
    return f"{size_bytes / factor:.3g} {unit}"
