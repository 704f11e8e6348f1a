"""Types of C arguments: scalars, pointers, and whole arrays; arrays as the library takes them."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

INT, INT64, DOUBLE = ctypes.c_int, ctypes.c_int64, ctypes.c_double
POINTER = ctypes.c_void_p  # handles, and memory of any type
TEXT = ctypes.c_char_p
FLOATS = np.ctypeslib.ndpointer(np.float32, flags="C_CONTIGUOUS")
DOUBLES = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
INTEGERS = np.ctypeslib.ndpointer(np.int32, flags="C_CONTIGUOUS")


def unmasked(name: str, given: ArrayLike) -> NDArray[Any]:
    """A plain array. Raises ValueError for a masked one with masked values, which no array of C has."""
    mask = np.ma.getmask(given)  # of structured arrays: a flag for each field
    if np.frombuffer(mask.tobytes(), np.uint8).any():
        raise ValueError(f"{name}: got masked values, wanted an array without a mask")
    return np.asarray(given)


def times_from(given: ArrayLike) -> NDArray[np.float64]:
    """Times as float64. Raises ValueError for those of another type, such as timedelta64, which has a unit."""
    times = unmasked("t_us", given)
    if times.dtype.kind not in "iufO":
        raise ValueError(f"t_us: got {times.dtype}, wanted numbers")
    return np.asarray(times, np.float64)


def check_out(name: str, out: NDArray[Any], dtype: DTypeLike, shape: tuple[int, ...]) -> None:
    """Raises ValueError unless the library can write to this array."""
    if out.dtype != dtype or out.shape != shape or not (out.flags.c_contiguous and out.flags.writeable):
        got = f"{'' if out.flags.writeable else 'read-only '}{out.dtype} of shape {out.shape}"
        kind = "EVENT_DTYPE" if np.dtype(dtype).names else np.dtype(dtype)
        raise ValueError(f"{name}: got {got}, wanted contiguous, writeable {kind} of shape {shape}")
