"""EXR stacks (docs/reference/exr_stack.md): OpenEXR files, one per instant and layer, written whole or not at all."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._c_types import DOUBLE, FLOATS, INT, INT64, POINTER, TEXT
from ._library import Handle, function, options_bytes, path_bytes, take_json

LIGHT = "light"  # the layer of the bands

_frame = (POINTER, TEXT, INT64)  # stack, layer, index
_create = function("pecs_stack_writer_create", POINTER, TEXT, TEXT)
_has_frame = function("pecs_stack_writer_has_frame", INT, *_frame)
_write_frame = function("pecs_stack_writer_write_frame", INT, *_frame, FLOATS, INT64)
_between = (POINTER, INT64, INT64, INT64)  # stack, interval, number, time_ns
_has_between = function("pecs_stack_writer_has_between", INT, *_between)
_write_between = function("pecs_stack_writer_write_between", INT, *_between, FLOATS, INT64)
_writer_close = function("pecs_stack_writer_close", None, POINTER, error=False)
_open = function("pecs_stack_reader_open", POINTER, TEXT, DOUBLE)
_info = function("pecs_stack_reader_info", POINTER, POINTER)
_read_frame = function("pecs_stack_reader_read_frame", INT, *_frame, FLOATS, INT64)
_between_ns = function("pecs_stack_reader_between", INT64, POINTER, INT64, POINTER, INT64)
_read_between = function("pecs_stack_reader_read_between", INT, POINTER, INT64, INT64, FLOATS, INT64)
_reader_close = function("pecs_stack_reader_close", None, POINTER, error=False)


def _shape(info: dict[str, Any]) -> tuple[int, int, int]:
    """Shape of the light in a file, without its noise."""
    side = info.get("subpixels") or 1
    return len(info["bands"]), info["height"] * side, info["width"] * side


class StackWriter(Handle):
    """Write a stack, or continue one whose stack.json (docs/reference/exr_stack.md) is equal to `stack`.

    Frames and layers are [bands or channels, height, width], row 0 at the top, in the stack's or the layer's unit.
    """

    _free = staticmethod(_writer_close)

    def __init__(self, folder: str | PathLike[str], stack: dict[str, Any]):
        super().__init__(_create(path_bytes(folder), options_bytes(stack)))
        self.shape = _shape(stack)
        self._written = self.shape[0] + bool(stack.get("noise")), *self.shape[1:]
        self._channels = {entry["name"]: len(entry["channels"]) for entry in stack.get("layers") or []}

    def has_frame(self, index: int) -> bool:
        """Whether the light of a frame is complete on disk."""
        return self.has_layer(LIGHT, index)

    def has_layer(self, name: str, index: int) -> bool:
        """Whether a frame of a layer is complete on disk."""
        return bool(self._call(_has_frame, name.encode(), index))

    def write_frame(self, index: int, values: NDArray[np.float32]) -> None:
        """Write the light of a frame. In a stack with noise, the noise follows the bands."""
        self.write_layer(LIGHT, index, values)

    def write_layer(self, name: str, index: int, values: NDArray[np.float32]) -> None:
        """Write a frame of a layer."""
        values = np.ascontiguousarray(values, np.float32)
        shape = (self._channels.get(name, self._written[0]), *self.shape[1:])
        if values.shape != shape:
            raise ValueError(f"{name}: got shape {values.shape}, wanted {shape} (channels, height, width)")
        self._call(_write_frame, name.encode(), index, values, values.size)

    def has_between(self, interval: int, number: int, time_ns: int) -> bool:
        """Whether image `number` of the interval that begins at frame `interval`, at `time_ns`, is complete on disk."""
        return bool(self._call(_has_between, interval, number, time_ns))

    def write_between(self, interval: int, number: int, time_ns: int, values: NDArray[np.float32]) -> None:
        """Write the light at a time within the interval that begins at frame `interval`, NaN where it was not rendered.
        `number` increases with the time."""
        values = np.ascontiguousarray(values, np.float32)
        if values.shape != self._written:
            raise ValueError(f"between: got shape {values.shape}, wanted {self._written} (bands, height, width)")
        self._call(_write_between, interval, number, time_ns, values, values.size)


class StackReader(Handle):
    """Read a stack, or a folder of spectral EXR files with a frame rate `fps` [Hz].

    `info`: size, bands, times [ns], and the number of frames on disk. `layers`: `name`, `channels`, `unit` and `at`
    ("instant" or "interval") of each layer, the light first. `shape`: bands, height, width.
    """

    _free = staticmethod(_reader_close)

    def __init__(self, folder: str | PathLike[str], fps: float | None = None):
        super().__init__(_open(path_bytes(folder), fps or 0.0))
        self.info: dict[str, Any] = take_json(self._call(_info))
        self.layers: list[dict[str, Any]] = self.info["layers"]
        self.shape = _shape(self.info)

    def read_frame(self, index: int) -> NDArray[np.float32]:
        """Read the light of a frame, [bands, height, width] in the stack's unit."""
        return self.read_layer(LIGHT, index)

    def between_ns(self, interval: int) -> list[int]:
        """List the times [ns] at which light was rendered within the interval that begins at frame `interval`."""
        times = np.empty(self._call(_between_ns, interval, None, 0), np.int64)
        self._call(_between_ns, interval, times.ctypes.data, len(times))
        return [int(t) for t in times]

    def read_between(self, interval: int, which: int) -> NDArray[np.float32]:
        """Read the light at time `which` of `between_ns(interval)`, [bands, height, width]; NaN where it was not
        rendered."""
        frame = np.empty(self.shape, np.float32)
        self._call(_read_between, interval, which, frame, frame.size)
        return frame

    def read_layer(self, name: str, index: int) -> NDArray[np.float32]:
        """Read a frame of a layer, [channels, height, width]."""
        channels = next((len(layer["channels"]) for layer in self.layers if layer["name"] == name), 0)
        frame = np.empty((channels, *self.shape[1:]), np.float32)
        self._call(_read_frame, name.encode(), index, frame, frame.size)
        return frame
