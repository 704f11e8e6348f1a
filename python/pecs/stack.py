"""EXR stacks (docs/exr_stack.md): one spectral OpenEXR file per instant, written whole or not at all."""

from __future__ import annotations

import ctypes
import json
from os import PathLike, fspath
from typing import Any

import numpy as np

from ._library import Handle, function, take_json

_floats = np.ctypeslib.ndpointer(np.float32, flags="C_CONTIGUOUS")
_create = function("pecs_stack_create", ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p)
_has_frame = function("pecs_stack_has_frame", ctypes.c_int, ctypes.c_void_p, ctypes.c_int64, error=False)
_write_frame = function("pecs_stack_write_frame", ctypes.c_int, ctypes.c_void_p, ctypes.c_int64, _floats)
_close = function("pecs_stack_close", None, ctypes.c_void_p, error=False)
_open = function("pecs_stack_open", ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double)
_info = function("pecs_stack_reader_info", ctypes.c_void_p, ctypes.c_void_p)
_read_frame = function("pecs_stack_read_frame", ctypes.c_int, ctypes.c_void_p, ctypes.c_int64, _floats)
_reader_close = function("pecs_stack_reader_close", None, ctypes.c_void_p, error=False)


class StackWriter(Handle):
    """Opens a new stack, or continues one whose stack.json says the same as `stack`."""

    _free = staticmethod(_close)

    def __init__(self, folder: str | PathLike[str], stack: dict[str, Any]):
        self._handle = _create(fspath(folder).encode(), json.dumps(stack).encode())
        self.shape = (len(stack["bands"]), stack["height"], stack["width"])

    def has_frame(self, index: int) -> bool:
        """Whether the frame is whole on disk."""
        return bool(_has_frame(self._alive(), index))

    def write_frame(self, index: int, values: np.ndarray) -> None:
        """values: [bands, height, width], row 0 at the top, in the stack's unit."""
        values = np.ascontiguousarray(values, np.float32)
        if values.shape != self.shape:
            raise ValueError(f"frame: got shape {values.shape}, wanted {self.shape} (bands, height, width)")
        _write_frame(self._alive(), index, values)


class StackReader(Handle):
    """Reads a stack; `info` says size, bands, times and how many frames are on disk."""

    _free = staticmethod(_reader_close)

    def __init__(self, folder: str | PathLike[str], fps: float | None = None):
        self._handle = _open(fspath(folder).encode(), fps or 0.0)
        self.info: dict[str, Any] = take_json(_info(self._handle))
        self.shape = (len(self.info["bands"]), self.info["height"], self.info["width"])

    def read_frame(self, index: int) -> np.ndarray:
        """[bands, height, width], float32."""
        frame = np.empty(self.shape, np.float32)
        _read_frame(self._alive(), index, frame)
        return frame


def read_frame(folder: str | PathLike[str], index: int) -> np.ndarray:
    """One frame of a stack with stack.json, as [bands, height, width], float32."""
    with StackReader(folder) as stack:
        return stack.read_frame(index)
