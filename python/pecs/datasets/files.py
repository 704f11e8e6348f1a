"""Contents of data-set files: arrays, pictures and tables, with the same bytes for the same content."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._config import read_json
from .._errors import PecsError, PecsInputError, bad_input, existing, one_line, optional_module
from .._files import read_text

MAX_BYTES = 1 << 28
OWN = "files.json"  # checksums of a sequence


def read_object(path: Path, what: str) -> dict[str, Any]:
    """The top of a JSON file."""
    value = read_json(existing(path, what), MAX_BYTES)
    if not isinstance(value, dict):
        raise bad_input(path, "", value, "an object")
    return value


def read_rows(path: Path, header: tuple[str, ...], what: str) -> list[list[int]]:
    """A CSV file of integers under exactly this header."""
    rows = list(csv.reader(read_text(existing(path, what), MAX_BYTES).splitlines()))
    if not rows or tuple(rows[0]) != header:
        raise bad_input(path, "line 1", ",".join(rows[0]) if rows else "nothing", ",".join(header))
    out = []
    for number, row in enumerate(rows[1:], 2):
        try:
            out.append([int(word) for word in row])
            np.array(out[-1], np.int64)
        except (ValueError, OverflowError):
            raise bad_input(path, f"line {number}", ",".join(row), "integers") from None
        if len(row) != len(header):
            raise bad_input(path, f"line {number}", ",".join(row), f"{len(header)} integers")
    return out


def read_numbers(path: Path, what: str) -> list[float]:
    """A text file of finite numbers."""
    found = []
    for word in read_text(existing(path, what), MAX_BYTES).split():
        try:
            found.append(float(word))
        except ValueError:
            found.append(math.nan)
        if not math.isfinite(found[-1]):
            raise bad_input(path, "", word, f"numbers: {what}")
    return found


def load(path: Path, what: str) -> Any:
    """The array of an NPY file, mapped into memory, or the arrays of an NPZ file. Code in them does not run."""
    try:
        return np.load(existing(path, what), mmap_mode="r", allow_pickle=False)
    except PecsError:
        raise
    except Exception as e:  # NumPy raises many types
        raise PecsInputError(f"{path}: not an NPY file: {one_line(str(e)) or type(e).__name__}") from None


def read_array(path: Path, what: str, dtype: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """An NPY file, mapped into memory. -1 in `shape` is any length."""
    array = load(path, what)
    if not isinstance(array, np.ndarray) or array.dtype != np.dtype(dtype):
        raise bad_input(path, "dtype", str(getattr(array, "dtype", type(array))), dtype)
    if array.ndim != len(shape) or any(s not in (-1, n) for s, n in zip(shape, array.shape, strict=True)):
        raise bad_input(path, "shape", array.shape, f"{list(shape)} (-1: any)")
    return array


def npy_bytes(array: NDArray[Any]) -> bytes:
    out = io.BytesIO()
    np.save(out, array, allow_pickle=False)
    return out.getvalue()


def read_picture(path: Path) -> NDArray[np.uint8]:
    """[H, W, 3] RGB, 8 bit."""
    cv2 = optional_module("cv2", "opencv-python-headless", "reading pictures")
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise PecsInputError(f"{path}: not a readable picture; PNG is required")
    return np.asarray(picture[..., ::-1])
