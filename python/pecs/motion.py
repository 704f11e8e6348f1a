"""Light between two keyframes, carried along the motion of what is seen (docs/sensor.md)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._library import FLOATS, function

_carry = function(
    "pecs_carry",
    ctypes.c_int,
    *(FLOATS, FLOATS, ctypes.c_int),
    *(FLOATS, ctypes.c_int),
    *(ctypes.c_int, ctypes.c_int),
    *(ctypes.c_double, ctypes.c_char_p),
    *(FLOATS, ctypes.c_int64),
)


def carry(
    first: ArrayLike, second: ArrayLike, motion: ArrayLike, fraction: float, side: str = "both"
) -> NDArray[np.float32]:
    """The light at `fraction` (0 to 1) of the interval between two keyframes, float32, shaped as they are.

        half = pecs.carry(stack.read_frame(0), stack.read_frame(1), stack.read_layer("motion", 0), 0.5)

    first, second: [H, W] or [bands, H, W], any positive light. motion: [12, H, W], of a stack's layer `motion`; or
    [2, H, W], forward optical flow in pixels; or [4, H, W], forward and backward flow; NaN where it is not known.
    `side`: "first" or "second" is what that keyframe alone predicts, NaN where it does not show what is there.
    Raises ValueError for wrong shapes.
    """
    a, b, m = (np.ascontiguousarray(v, np.float32) for v in (first, second, motion))
    if a.shape != b.shape or a.ndim not in (2, 3):
        raise ValueError(f"keyframes: got shapes {a.shape} and {b.shape}, wanted two of [H, W] or [bands, H, W]")
    if m.ndim != 3 or m.shape[1:] != a.shape[-2:] or len(m) not in (2, 4, 12):
        raise ValueError(f"motion: got shape {m.shape}, wanted (12, {a.shape[-2]}, {a.shape[-1]}), or 2 or 4 channels")
    out = np.empty_like(a)
    bands = 1 if a.ndim == 2 else len(a)
    _carry(a, b, bands, m, len(m), a.shape[-1], a.shape[-2], fraction, side.encode(), out, out.size)
    return out
