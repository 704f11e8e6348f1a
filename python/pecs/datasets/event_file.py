"""Parts of an event file in DSEC's layout, found by its index `ms_to_idx`: a window costs what it holds."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._errors import bad_input, optional_module
from ..events import EVENT_DTYPE, Events

if TYPE_CHECKING:
    from typing_extensions import Self


class EventFile:
    """Parts of an event file in DSEC's layout (.h5), by time or index. The file is opened at the first access, and
    again in another process.

        with EventFile("events.h5") as file:
            events = file.between(10_000, 20_000)      # 10 ms <= t < 20 ms
            events = file.read(0, 5000)                # by index
    """

    def __init__(self, path: Path):
        self.path = path
        self._opened: tuple[int, Any] | None = None  # process, file

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path, "_opened": None}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        if self._opened and self._opened[0] == os.getpid():
            self._opened[1].close()
        self._opened = None

    @property
    def _file(self) -> Any:
        if self._opened is None or self._opened[0] != os.getpid():
            self._opened = os.getpid(), self._open()
        return self._opened[1]

    def _open(self) -> Any:
        h5py = optional_module("h5py", "h5py", "reading parts of an event file")
        try:
            file = h5py.File(self.path, "r")
        except OSError as e:
            raise bad_input(self.path, "file", str(e), "an HDF5 file") from None
        for name in ("events/t", "events/x", "events/y", "events/p", "ms_to_idx", "t_offset"):
            if name not in file:
                file.close()
                raise bad_input(self.path, name, None, "a data set of DSEC's layout")
        return file

    @cached_property
    def t_offset_us(self) -> int:
        """Offset that is added to the stored times [us]."""
        return int(self._file["t_offset"][()])

    @cached_property
    def size(self) -> tuple[int, int]:
        """Width and height of the sensor [pixels]."""
        attributes = self._file["events"].attrs
        return int(attributes.get("width", 0)), int(attributes.get("height", 0))

    def __len__(self) -> int:
        return int(self._file["events/t"].shape[0])

    def read(self, first: int, last: int) -> Events:
        """Read events by index: t [us], x, y [pixels], p of `first` to before `last`."""
        first, last = max(0, first), min(last, len(self))
        out = np.zeros(max(0, last - first), EVENT_DTYPE)
        if len(out):
            for name in "txyp":
                out[name] = self._file[f"events/{name}"][first:last]
            out["t"] += self.t_offset_us
        return Events(out, *self.size)

    def blocks(self, size: int = 1 << 20) -> Any:
        """Iterate over all events, in blocks of `size`."""
        for first in range(0, len(self), size):
            yield self.read(first, first + size)

    def index(self, t_us: float) -> int:
        """Index of the first event at a time or later."""
        t_us = int(np.ceil(t_us)) - self.t_offset_us
        ms_to_idx = self._file["ms_to_idx"]
        ms = t_us // 1000
        if ms < 0:
            return 0
        if ms >= len(ms_to_idx):
            return len(self)
        first = int(ms_to_idx[ms])
        last = int(ms_to_idx[ms + 1]) if ms + 1 < len(ms_to_idx) else len(self)
        return first + int(np.searchsorted(self._file["events/t"][first:last], t_us, "left"))

    def ms_to_idx(self, duration_us: int) -> NDArray[np.uint64]:
        """Index of the first event with t >= 1000 i us, for each millisecond i of `duration_us`; longer events lengthen
        the table."""
        stored, late_ms = self._file["ms_to_idx"][:], self.t_offset_us // 1000
        out = np.full(max(-(-duration_us // 1000) + 1, late_ms + len(stored)), len(self), np.uint64)
        out[:late_ms] = 0
        out[late_ms : late_ms + len(stored)] = stored
        return out

    def between(self, start_us: float, end_us: float) -> Events:
        """Read events by time: t [us], x, y [pixels], p with start_us <= t < end_us."""
        return self.read(self.index(start_us), self.index(end_us))
