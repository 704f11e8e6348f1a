"""Finds and loads libpecs, declares nothing: each module declares the functions it uses through `function`.

A process that also uses Blender must import bpy before pecs: both carry libtbb.so.12, and the first one loaded serves
both.
"""

from __future__ import annotations

import ctypes
import json
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from typing_extensions import Self


FLOATS = np.ctypeslib.ndpointer(np.float32, flags="C_CONTIGUOUS")  # arguments that are whole arrays
DOUBLES = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")


class PecsError(RuntimeError):
    """An error from the library, one line. `code` is one of the program's exit codes (docs/reference/exit_codes.md).

    Its kinds are also Python's own: `PecsNotFoundError` a FileNotFoundError, `PecsInputError` a ValueError,
    `PecsOutputError` an OSError.
    """

    def __init__(self, message: str, code: int):
        super().__init__(message)
        self.code = code

    def __reduce__(self) -> tuple[type[PecsError], tuple[str, int]]:
        return type(self), (str(self), self.code)


class PecsNotFoundError(PecsError, FileNotFoundError):
    """An input is missing or cannot be opened."""


class PecsInputError(PecsError, ValueError):
    """An argument, or what an input says, is wrong."""


class PecsOutputError(PecsError, OSError):
    """An output cannot be written: no permission, disk full, exists and differs."""


_KINDS = {2: PecsInputError, 3: PecsNotFoundError, 4: PecsInputError, 5: PecsOutputError}


class _CError(ctypes.Structure):
    _fields_ = [("code", ctypes.c_int), ("message", ctypes.c_char * 1024)]


def _find() -> Path:
    here = Path(__file__).resolve().parent
    tried = [here / "_lib" / "libpecs.so"]  # installed wheel
    if "PECS_LIBRARY" in os.environ:
        tried.insert(0, Path(os.environ["PECS_LIBRARY"]))
    tried += [here.parents[1] / "build" / preset / "lib" / "libpecs.so" for preset in ("release", "dev")]  # checkout
    for path in tried:
        if path.is_file():
            return path
    raise ImportError("libpecs.so not found; looked at " + ", ".join(map(str, tried)) + " (scripts/setup.sh builds it)")


def _load(path: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(path))
    except OSError as e:
        raise ImportError(f"{path}: {e}; a wheel that pip built needs the libraries of its system") from None


_lib = _load(_find())
_lib.pecs_version.restype = ctypes.c_char_p
_lib.pecs_text_free.argtypes = [ctypes.c_void_p]
_lib.pecs_text_free.restype = None


def version() -> str:
    """The library's version."""
    text: bytes = _lib.pecs_version()
    return text.decode()


def function(name: str, restype: Any, *argtypes: Any, error: bool = True) -> Callable[..., Any]:
    """A callable for C function `name`. With `error`, the trailing pecs_error* is added and raised as PecsError."""
    f = _lib[name]  # not shared, unlike an attribute
    f.restype = restype
    f.argtypes = [*argtypes, ctypes.POINTER(_CError)] if error else list(argtypes)
    if not error:
        return f

    def call(*args: Any) -> Any:
        status = _CError()
        result = f(*args, ctypes.byref(status))
        if status.code:
            kind = _KINDS.get(status.code, PecsError)
            raise kind(status.message.decode(errors="replace"), status.code)
        return result

    return call


def path_bytes(path: str | bytes | os.PathLike[str]) -> bytes:
    """A path as C takes it; names that are not UTF-8 as Python got them from the system."""
    out = os.fsencode(path)
    if b"\0" in out:
        raise PecsInputError(f"{out!r}: got a NUL, wanted a path", 2)
    return out


def take_text(text: int) -> str:
    """Text that the library returned, which is freed."""
    try:
        return ctypes.string_at(text).decode()
    finally:
        _lib.pecs_text_free(text)


def take_json(text: int) -> Any:
    return json.loads(take_text(text))


def data_dir(room: str) -> Path:
    """The folder of the data files that ship with PECS, such as "lens_data/spectra"."""
    return Path(take_text(function("pecs_data_dir", ctypes.c_void_p, ctypes.c_char_p)(room.encode())))


def json_function(name: str, *argtypes: Any) -> Callable[..., Any]:
    """As `function`, for functions that take JSON text last and return JSON text."""
    f = function(name, ctypes.c_void_p, *argtypes, ctypes.c_char_p)

    def call(*args: Any) -> Any:
        *front, options = args
        return take_json(f(*front, json.dumps(options).encode()))

    return call


class Handle:
    """An opaque handle of the library; `_free` of the subclass gives it back.

    Any thread may call any method at any time: calls of one object wait for each other, `close` too. After `close`
    every method raises ValueError.
    """

    _handle: int | None = None
    _lock: threading.RLock
    _free: Callable[[int], None]

    def __init__(self, handle: int):
        self._lock = threading.RLock()
        self._handle = handle

    def __enter__(self) -> Self:
        with self._use():
            return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Frees it; may be called again."""
        if self._handle is None:  # or never opened
            return
        with self._lock:
            handle, self._handle = self._handle, None
            if handle is not None:
                self._free(handle)

    @contextmanager
    def _use(self) -> Iterator[int]:
        """The handle, for this thread alone."""
        with self._lock:
            if self._handle is None:
                raise ValueError(f"this {type(self).__name__} is closed")
            yield self._handle
