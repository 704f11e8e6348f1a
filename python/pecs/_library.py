"""Finds libpecs and loads it at the first call. Each module declares the functions it uses through `function`."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import math
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._errors import KINDS, PecsError, UsageError, bad_input
from ._platform import library_file

if TYPE_CHECKING:
    from typing_extensions import Self


class _CError(ctypes.Structure):
    _fields_ = [("code", ctypes.c_int), ("message", ctypes.c_char * 1024)]


def _find() -> Path:
    here = Path(__file__).resolve().parent
    file = library_file("pecs")
    tried = [here / "_lib" / file]  # installed wheel
    if "PECS_LIBRARY" in os.environ:
        tried.insert(0, Path(os.environ["PECS_LIBRARY"]))
    tried += [here.parent.parent / "build" / preset / "lib" / file for preset in ("release", "dev")]  # checkout
    for path in tried:
        if path.is_file():
            return path
    raise ImportError(f"{file} not found; looked at " + ", ".join(map(str, tried)) + " (scripts/setup.sh builds it)")


def _load(path: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(path))
    except OSError as e:
        raise ImportError(f"{path}: {e}; a wheel that pip built needs the libraries of its system") from None


@cache
def _library() -> ctypes.CDLL:
    _load_blender_tbb()
    lib = _load(_find())
    lib.pecs_version.restype = ctypes.c_char_p
    lib.pecs_text_free.argtypes = [ctypes.c_void_p]
    lib.pecs_text_free.restype = None
    return lib


def _load_blender_tbb() -> None:
    """Loads oneTBB of the module bpy, if this Python has one that is not imported yet.

    A checkout's libpecs and bpy both require version 12 of libtbb; the dynamic linker gives both the first one that the
    process loads. bpy fails with one older than its own, so its own is used in either order of imports. (Wheels contain
    oneTBB under another name.)
    """
    if "bpy" in sys.modules or not (spec := importlib.util.find_spec("bpy")):
        return
    for folder in spec.submodule_search_locations or ():
        if (tbb := Path(folder, "lib", library_file("tbb", "12"))).is_file():
            ctypes.CDLL(str(tbb))


def version() -> str:
    """The version of the library, such as "0.1.0"."""
    text: bytes = _library().pecs_version()
    return text.decode()


def function(name: str, restype: Any, *argtypes: Any, error: bool = True) -> Callable[..., Any]:
    """A callable for C function `name`; its first call loads the library. With `error`, the trailing pecs_error* is
    added and raised as PecsError."""

    @cache
    def symbol() -> Any:
        f = _library()[name]  # not shared, unlike an attribute
        f.restype = restype
        f.argtypes = [*argtypes, ctypes.POINTER(_CError)] if error else list(argtypes)
        return f

    def call(*args: Any) -> Any:
        if not error:
            return symbol()(*args)
        status = _CError()
        result = symbol()(*args, ctypes.byref(status))
        if status.code:
            raise KINDS.get(status.code, PecsError)(status.message.decode(errors="replace"), status.code)
        return result

    return call


def path_bytes(path: str | bytes | os.PathLike[str]) -> bytes:
    """A path as C takes it; names that are not UTF-8 as Python got them from the system."""
    out = os.fsencode(path)
    if b"\0" in out:
        raise UsageError(f"{out!r}: a path cannot contain NUL")
    return out


def take_text(text: int) -> str:
    """Text that the library returned, which is freed."""
    try:
        return ctypes.string_at(text).decode()
    finally:
        _library().pecs_text_free(text)


def take_json(text: int) -> Any:
    return json.loads(take_text(text))


def options_bytes(options: Any) -> bytes:
    """JSON of options for the library. Raises PecsInputError, with the key, for a number that is not finite."""

    def check(value: Any, place: str) -> None:
        if isinstance(value, Mapping):
            for key, part in value.items():
                check(part, f"{place}.{key}" if place else str(key))
        elif isinstance(value, (list, tuple)):
            for part in value:
                check(part, place)
        elif isinstance(value, Real) and not math.isfinite(value):
            raise bad_input(place, "", repr(value), "a finite number")

    check(options, "")
    return json.dumps(options, default=_number).encode()


def _number(value: Any) -> Any:
    """Of NumPy, as Python's."""
    if getattr(value, "shape", None) == ():
        return value.item()
    raise TypeError(f"got {value!r}, wanted a number, a text, True or False")


def data_dir(folder: str) -> Path:
    """The folder of data files that ship with PECS; `folder` is such as "lens_data/spectra"."""
    return Path(take_text(function("pecs_data_dir", ctypes.c_void_p, ctypes.c_char_p)(folder.encode())))


def json_function(name: str, *argtypes: Any) -> Callable[..., Any]:
    """As `function`, for functions that take JSON text last and return JSON text."""
    f = function(name, ctypes.c_void_p, *argtypes, ctypes.c_char_p)

    def call(*args: Any) -> Any:
        *front, options = args
        return take_json(f(*front, options_bytes(options)))

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

    def __reduce__(self) -> tuple[Any, ...]:
        """Neither copied nor pickled: two owners would free one handle."""
        raise TypeError(f"cannot copy or pickle {type(self).__name__}")

    def close(self) -> None:
        """Frees it; may be called again."""
        if self._handle is None:  # or never opened
            return
        with self._lock:
            handle, self._handle = self._handle, None
            if handle is not None:
                self._free(handle)

    def _call(self, function: Callable[..., Any], *args: Any) -> Any:
        """A function of the library on the handle."""
        with self._use() as handle:
            return function(handle, *args)

    @contextmanager
    def _use(self) -> Iterator[int]:
        """The handle, for this thread alone."""
        with self._lock:
            if self._handle is None:
                raise ValueError(f"this {type(self).__name__} is closed")
            yield self._handle
