"""Reading what others wrote: every fault is one line, `FILE: PLACE: got X, wanted Y`."""

from __future__ import annotations

import csv
import importlib
import json
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from .._library import PecsError, PecsInputError, PecsNotFoundError, PecsOutputError

_UNSUPPORTED = 6
_MISSING = object()


def fault(path: Path, place: str, got: Any, wanted: str) -> NoReturn:
    """Raises PecsInputError."""
    text = repr(got)
    raise PecsInputError(f"{path}: {place}: got {text if len(text) < 80 else text[:77] + '...'}, wanted {wanted}", 4)


def existing(path: Path, what: str) -> Path:
    if not path.exists():
        raise PecsNotFoundError(f"{path}: no such file or folder, wanted {what}", 3)
    return path


def cannot_write(path: Path, why: object) -> NoReturn:
    """Raises PecsOutputError."""
    raise PecsOutputError(f"{path}: {why}", 5)


def library(name: str, package: str, why: str, extra: str = "datasets") -> Any:
    """An imported module that `pip install 'pecs[EXTRA]'` brings."""
    try:
        return importlib.import_module(name)
    except ImportError as e:
        raise PecsError(f"{why} needs {package} (pip install 'pecs[{extra}]'): {e}", _UNSUPPORTED) from None


def read_json(path: Path, what: str) -> dict[str, Any]:
    existing(path, what)
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as e:
        raise PecsInputError(f"{path}: {e}, wanted JSON", 4) from None
    if not isinstance(value, dict):
        fault(path, "top", value, "an object")
    return value


class Fields:
    """The keys of a JSON object, each read once with the kind that it must have."""

    def __init__(self, path: Path, place: str, value: Any):
        if not isinstance(value, dict):
            fault(path, place or "top", value, "an object")
        self.path, self.place, self.value = path, place, value

    def at(self, key: str) -> str:
        return f"{self.place}.{key}" if self.place else key

    def fault(self, key: str, wanted: str) -> NoReturn:
        if key not in self.value:
            raise PecsInputError(f"{self.path}: {self.at(key)}: missing, wanted {wanted}", 4)
        fault(self.path, self.at(key), self.value[key], wanted)

    def text(self, key: str, one_of: tuple[str, ...] = ()) -> str:
        value = self.value.get(key)
        if not isinstance(value, str) or (one_of and value not in one_of) or not value:
            self.fault(key, " or ".join(map(repr, one_of)) or "text")
        return value

    def optional_text(self, key: str) -> str | None:
        return None if self.value.get(key, _MISSING) is None else self.text(key)

    def number(self, key: str, at_least: float = -np.inf) -> float:
        value = self.value.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not at_least <= value < np.inf:
            self.fault(key, "a number" + (f" >= {at_least:g}" if at_least > -np.inf else ""))
        return float(value)

    def whole(self, key: str, at_least: int = 0) -> int:
        value = self.value.get(key)
        if isinstance(value, bool) or not isinstance(value, int) or value < at_least:
            self.fault(key, f"an integer >= {at_least}")
        return value

    def array(self, key: str, *shape: int) -> NDArray[np.float64]:
        """Finite numbers; -1 in `shape` is any length."""
        wanted = f"{'x'.join('n' if s < 0 else str(s) for s in shape)} finite numbers"
        try:
            out = np.array(self.value.get(key), np.float64)
        except (TypeError, ValueError):
            self.fault(key, wanted)
        fits = out.ndim == len(shape) and all(s in (-1, n) for s, n in zip(shape, out.shape, strict=True))
        if not fits or not np.isfinite(out).all():
            self.fault(key, wanted)
        return out

    def objects(self, key: str) -> list[Fields]:
        value = self.value.get(key)
        if not isinstance(value, list):
            self.fault(key, "a list of objects")
        return [Fields(self.path, f"{self.at(key)}[{i}]", v) for i, v in enumerate(value)]


def read_rows(path: Path, header: tuple[str, ...], what: str) -> list[list[int]]:
    """A CSV file of integers under exactly this header."""
    rows = list(csv.reader(_lines(path, what)))
    if not rows or tuple(rows[0]) != header:
        fault(path, "line 1", ",".join(rows[0]) if rows else "", ",".join(header))
    out = []
    for number, row in enumerate(rows[1:], 2):
        try:
            out.append([int(word) for word in row])
        except ValueError:
            fault(path, f"line {number}", ",".join(row), "integers")
        if len(row) != len(header):
            fault(path, f"line {number}", ",".join(row), f"{len(header)} integers")
    return out


def _lines(path: Path, what: str) -> list[str]:
    existing(path, what)
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as e:
        raise PecsInputError(f"{path}: {e}, wanted text", 4) from None


def read_array(path: Path, what: str, dtype: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """An NPY file, not read until it is touched. -1 in `shape` is any length."""
    existing(path, what)
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError) as e:
        raise PecsInputError(f"{path}: {e}, wanted an NPY file", 4) from None
    if not isinstance(array, np.ndarray) or array.dtype != np.dtype(dtype):
        fault(path, "dtype", getattr(array, "dtype", type(array)), dtype)
    if array.ndim != len(shape) or any(s not in (-1, n) for s, n in zip(shape, array.shape, strict=True)):
        fault(path, "shape", array.shape, f"{shape} (-1: any)")
    return array
