"""Event files as structured NumPy arrays: t (int64, microseconds), x, y (uint16) and p (uint8, 1 = brighter).

    events = pecs.read("recording.raw")
    pecs.write("events.h5", events, width=1280, height=720)

`EventReader` and `EventWriter` do the same in blocks, for files larger than memory. Formats: `event_formats()`.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Iterator
from os import PathLike, fspath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._library import Handle, function, take_json

EVENT_DTYPE = np.dtype(
    {"names": ["t", "x", "y", "p"], "formats": ["<i8", "<u2", "<u2", "u1"], "offsets": [0, 8, 10, 12], "itemsize": 16}
)
_BLOCK = 1 << 16

_formats = function("pecs_event_formats", ctypes.c_void_p)
_open = function("pecs_events_open", ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p)
_info = function("pecs_events_info", ctypes.c_void_p, ctypes.c_void_p)
_read = function("pecs_events_read", ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
_close = function("pecs_events_close", None, ctypes.c_void_p, error=False)
_create = function("pecs_events_create", ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p)
_write = function("pecs_events_write", ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
_finish = function("pecs_events_finish", ctypes.c_int, ctypes.c_void_p)
_discard = function("pecs_events_discard", None, ctypes.c_void_p, error=False)


def event_formats() -> list[dict[str, Any]]:
    """[{"name", "description", "extensions", "reads", "writes"}, ...]"""
    return take_json(_formats())


class EventReader(Handle):
    """Iterates over a file's events in blocks. `format`: a name of `event_formats()`, or None: by content."""

    _free = staticmethod(_close)

    def __init__(self, path: str | PathLike[str], format: str | None = None):
        self._handle = _open(fspath(path).encode(), format.encode() if format else None)

    @property
    def info(self) -> dict[str, Any]:
        """format, width, height, camera. Width and height of a file that does not say are 0 until all is read."""
        return take_json(_info(self._alive()))

    def read(self, count: int = _BLOCK) -> NDArray[np.void]:
        """At most `count` events; empty at the end."""
        block = np.empty(count, EVENT_DTYPE)
        return block[: self.read_into(block)]

    def read_into(self, block: NDArray[np.void]) -> int:
        """Fills an array of EVENT_DTYPE; returns how many events, 0 only at the end."""
        if block.dtype != EVENT_DTYPE or not block.flags.c_contiguous:
            raise ValueError(f"block: got {block.dtype}, wanted contiguous EVENT_DTYPE")
        return _read(self._alive(), block.ctypes.data, len(block))

    def __iter__(self) -> Iterator[NDArray[np.void]]:
        while len(block := self.read()):
            yield block


class EventWriter(Handle):
    """Writes events in blocks, sorted by t. The file appears when the `with` block ends without an exception."""

    _free = staticmethod(_discard)

    def __init__(
        self, path: str | PathLike[str], width: int = 0, height: int = 0, format: str | None = None, camera: str = ""
    ):
        options = {"width": width, "height": height, "camera": camera, "format": format}
        self._handle = _create(fspath(path).encode(), json.dumps(options).encode())

    def write(self, events: NDArray[np.void]) -> None:
        """A structured array with the fields t, x, y and p, of integers (p also boolean)."""
        events = as_events(events)
        _write(self._alive(), events.ctypes.data, len(events))

    def finish(self) -> None:
        """Completes the file and gives it its name."""
        _finish(self._alive())
        self.close()

    def __exit__(self, exception: object, *_: object) -> None:
        if exception is None and self._handle:
            self.finish()
        self.close()


def read(path: str | PathLike[str], format: str | None = None) -> NDArray[np.void]:
    """All events of a file."""
    with EventReader(path, format) as reader:
        events = np.empty(_BLOCK, EVENT_DTYPE)
        size = 0
        while count := reader.read_into(events[size:]):
            size += count
            if size == len(events):
                events.resize(2 * size, refcheck=False)  # the block just filled is gone
    events.resize(size, refcheck=False)
    return events


def write(
    path: str | PathLike[str],
    events: NDArray[np.void],
    width: int = 0,
    height: int = 0,
    format: str | None = None,
    camera: str = "",
) -> None:
    """Writes a whole file. RAW and DAT need the width and height of the pixel array."""
    with EventWriter(path, width, height, format, camera) as writer:
        writer.write(events)


def as_events(events: NDArray[np.void]) -> NDArray[np.void]:
    events = np.asarray(events)
    if events.dtype == EVENT_DTYPE:
        return np.ascontiguousarray(events)
    if events.ndim != 1 or not set("txyp") <= set(events.dtype.names or ()):
        raise ValueError(f"events: got {events.dtype} of shape {events.shape}, wanted one dimension with t, x, y and p")
    out = np.zeros(len(events), EVENT_DTYPE)
    for name in "txyp":
        column, wanted = events[name], EVENT_DTYPE[name]
        if column.dtype.kind not in ("iub" if name == "p" else "iu"):
            unit = "integer microseconds" if name == "t" else "integers"
            raise ValueError(f"events: {name}: got {column.dtype}, wanted {unit}")
        if len(column) and not (np.iinfo(wanted).min <= column.min() and column.max() <= np.iinfo(wanted).max):
            raise ValueError(f"events: {name}: got values from {column.min()} to {column.max()}, wanted {wanted}")
        out[name] = column
    return out
