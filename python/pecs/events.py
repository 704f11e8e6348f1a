"""Event files as structured NumPy arrays: t (int64, microseconds), x, y (uint16) and p (uint8, 1 = brighter).

    events = pecs.read("recording.raw")
    bright = events[events["p"] == 1]                # keeps events.width and events.height
    pecs.write("events.h5", bright)

`EventReader` and `EventWriter` do the same in blocks, for files larger than memory. Formats: `event_formats()`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from operator import index
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._c_types import INT, INT64, POINTER, TEXT, check_out, unmasked
from ._library import Handle, function, options_bytes, path_bytes, take_json

EVENT_DTYPE = np.dtype(
    {"names": ["t", "x", "y", "p"], "formats": ["<i8", "<u2", "<u2", "u1"], "offsets": [0, 8, 10, 12], "itemsize": 16}
)
_BLOCK = 1 << 16

if TYPE_CHECKING:
    _Array = np.ndarray[Any, np.dtype[Any]]
else:
    _Array = np.ndarray


class Events(_Array):
    """Events with the size of their sensor: a structured array with the fields t [us], x, y [pixels] and p (1: ON, 0:
    OFF).

    Slices, masks and copies keep `width` and `height` [pixels] (0: unknown); a single field is a plain array.
    """

    width: int
    height: int
    __array_priority__ = 1.0  # np.concatenate gives Events

    def __new__(cls, events: ArrayLike, width: int = 0, height: int = 0) -> Events:
        out: Events = np.asarray(events).view(cls)
        out.width, out.height = width, height
        return out

    def __array_finalize__(self, source: object) -> None:
        self.width, self.height = getattr(source, "width", 0), getattr(source, "height", 0)

    def __getitem__(self, key: Any) -> Any:
        return _plain_fields(super().__getitem__(key))

    def __array_function__(
        self, func: Callable[..., Any], types: Iterable[type], args: Iterable[Any], kwargs: Mapping[str, Any]
    ) -> Any:
        out = _plain_fields(super().__array_function__(func, types, args, kwargs))
        if isinstance(out, Events) and not out.width:  # np.concatenate
            out.width, out.height = self.width, self.height
        return out

    def __reduce__(self) -> tuple[Any, ...]:
        reduced: Any = super().__reduce__()
        make, arguments, state = reduced
        return make, arguments, (*state, self.width, self.height)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        *plain, self.width, self.height = state
        super().__setstate__(tuple(plain))


def _plain_fields(value: Any) -> Any:
    return value.view(np.ndarray) if isinstance(value, Events) and value.dtype.names is None else value


_formats = function("pecs_event_formats", POINTER)
_open = function("pecs_event_reader_open", POINTER, TEXT, TEXT)
_info = function("pecs_event_reader_info", POINTER, POINTER)
_read = function("pecs_event_reader_read", INT64, POINTER, POINTER, INT64)
_reader_close = function("pecs_event_reader_close", None, POINTER, error=False)
_create = function("pecs_event_writer_create", POINTER, TEXT, TEXT)
_write = function("pecs_event_writer_write", INT, POINTER, POINTER, INT64)
_finish = function("pecs_event_writer_finish", INT, POINTER)
_writer_close = function("pecs_event_writer_close", None, POINTER, error=False)


def event_formats() -> list[dict[str, Any]]:
    """List `name`, `description`, `extensions`, `reads` and `writes` of each format of event files."""
    formats: list[dict[str, Any]] = take_json(_formats())
    return formats


class EventReader(Handle):
    """Read a file of events in blocks; iterating gives `Events`.

        with pecs.EventReader("recording.raw") as reader:
            on = sum(int(block["p"].sum()) for block in reader)

    Parameters
    ----------
    path : str or path
        The file.
    format : str, optional
        A name of `event_formats()`. Default: detected from the content.
    time_unit : str, optional
        "s", "ms", "us" or "ns": unit of the times of text, NPZ and HDF5 that do not state it. Default: as the format
        has it; times that contradict it are refused.
    size : (int, int), optional
        Width and height [pixels] of a sensor that the file does not state. Default: measured.
    late : str, optional
        "sort" (in memory) or "drop" events that are earlier than one before them. Default: they are returned as they
        are.

    Raises
    ------
    PecsNotFoundError
        There is no such file.
    PecsInputError
        The file is damaged; events before the damage are valid.
    """

    _free = staticmethod(_reader_close)

    def __init__(
        self,
        path: str | PathLike[str],
        format: str | None = None,
        *,
        time_unit: str | None = None,
        size: tuple[int, int] | None = None,
        late: str | None = None,
    ):
        width, height = map(index, size) if size else (None, None)
        options = {"format": format, "time_unit": time_unit, "width": width, "height": height, "late": late}
        super().__init__(_open(path_bytes(path), options_bytes(options)))

    @property
    def info(self) -> dict[str, Any]:
        """`format`, `width`, `height` [pixels] and `camera` of the file; with `late` also the number `late_events` so
        far. If the file does not state its size, width and height are 0 until all events are read.
        """
        info: dict[str, Any] = take_json(self._call(_info))
        return info

    def read(self, count: int = _BLOCK) -> Events:
        """Read the next events, at most `count`; empty at the end of the file."""
        block = np.empty(count, EVENT_DTYPE)
        with self._use():
            block = block[: self.read_into(block)]
            return self._sized(block)

    def _sized(self, events: NDArray[np.void]) -> Events:
        info = self.info
        return Events(events, info["width"], info["height"])

    def read_into(self, block: NDArray[np.void]) -> int:
        """Read the next events into a contiguous array of `EVENT_DTYPE`. Returns their number; 0 only at the end of the
        file."""
        check_out("block", block, EVENT_DTYPE, (len(block),))
        count: int = self._call(_read, block.ctypes.data, len(block))
        return count

    def __iter__(self) -> Iterator[Events]:
        while len(block := self.read()):
            yield block


class EventWriter(Handle):
    """Write a file of events in blocks. The file appears when the `with` block ends without an exception.

        with pecs.EventWriter("events.raw", 1280, 720) as writer:
            writer.write(events)

    Parameters
    ----------
    path : str or path
        The file.
    width, height : int
        Size of the sensor [pixels]; required by RAW and DAT. Default 0: unknown.
    format : str, optional
        A name of `event_formats()`. Default: by the extension.
    camera : str
        Name of the camera for formats that have one. Default "".

    Raises
    ------
    PecsOutputError
        The file cannot be written.
    PecsInputError
        The format cannot contain these events.
    """

    _free = staticmethod(_writer_close)

    def __init__(
        self, path: str | PathLike[str], width: int = 0, height: int = 0, format: str | None = None, camera: str = ""
    ):
        options = {"width": width, "height": height, "camera": camera, "format": format}
        super().__init__(_create(path_bytes(path), options_bytes(options)))

    def write(self, events: NDArray[Any]) -> None:
        """Append events: a structured array with the integer fields t, x, y and p (p may be boolean), with increasing
        t."""
        events = as_events(events)
        self._call(_write, events.ctypes.data, len(events))

    def finish(self) -> None:
        """Complete the file and give it its name."""
        with self._use() as handle:
            _finish(handle)
            self.close()

    def __exit__(self, *exception: object) -> None:
        try:
            if exception[0] is None and self._handle:
                self.finish()
        finally:
            self.close()


def read(
    path: str | PathLike[str],
    format: str | None = None,
    *,
    time_unit: str | None = None,
    size: tuple[int, int] | None = None,
    late: str | None = None,
) -> Events:
    """Read all events of a file. Options and errors are those of `EventReader`."""
    with EventReader(path, format, time_unit=time_unit, size=size, late=late) as reader:
        events = np.empty(_BLOCK, EVENT_DTYPE)
        size = 0
        while count := reader.read_into(events[size:]):
            size += count
            if size == len(events):
                events.resize(2 * size, refcheck=False)  # the block just filled is gone
        events.resize(size, refcheck=False)
        return reader._sized(events)


def write(
    path: str | PathLike[str],
    events: NDArray[Any],
    width: int = 0,
    height: int = 0,
    format: str | None = None,
    camera: str = "",
) -> None:
    """Write all events to a file. Options and errors are those of `EventWriter`; the size is that of `events` by
    default.

        pecs.write("events.raw", events)
    """
    width, height = width or getattr(events, "width", 0), height or getattr(events, "height", 0)
    with EventWriter(path, width, height, format, camera) as writer:
        writer.write(events)


def as_events(events: NDArray[Any]) -> NDArray[np.void]:
    """A plain, contiguous array of EVENT_DTYPE."""
    events = unmasked("events", events)
    if events.ndim != 1 or not set("txyp") <= set(events.dtype.names or ()):
        raise ValueError(f"events: got {events.dtype} of shape {events.shape}, wanted one dimension with t, x, y and p")
    if events.dtype == EVENT_DTYPE:
        return np.ascontiguousarray(events)
    out = np.zeros(len(events), EVENT_DTYPE)
    for name in "txyp":
        column, wanted = events[name], EVENT_DTYPE[name]
        if column.dtype.kind not in ("iub" if name == "p" else "iu"):
            unit = "integer microseconds" if name == "t" else "integers"
            raise ValueError(f"events: {name}: got {column.dtype}, wanted {unit}")
        fits = np.can_cast(column.dtype, wanted) or not len(column)
        column = np.ascontiguousarray(column)  # its least and greatest are found faster
        if not fits and not (np.iinfo(wanted).min <= column.min() and column.max() <= np.iinfo(wanted).max):
            raise ValueError(f"events: {name}: got values from {column.min()} to {column.max()}, wanted {wanted}")
        out[name] = column
    return out
