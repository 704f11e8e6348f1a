"""Light and object ids between two keyframes, warped along the motion (docs/reference/sensor.md)."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._c_types import DOUBLE, FLOATS, INT, INT64, INTEGERS, POINTER, TEXT, check_out, unmasked
from ._library import Handle, function
from .events import as_events
from .stack import StackReader

_open = function("pecs_carrier_open", POINTER, FLOATS, INT, INT, INT)
_open_light = function("pecs_carried_open", POINTER, POINTER, FLOATS, FLOATS, INT)
_light_at = function("pecs_carried_at", INT, POINTER, DOUBLE, TEXT, POINTER, INT, FLOATS, INT64)
_close_light = function("pecs_carried_close", None, POINTER, error=False)
_labels = function("pecs_carrier_labels", INT, POINTER, INTEGERS, INTEGERS, DOUBLE, INTEGERS, INT64)
_close = function("pecs_carrier_close", None, POINTER, error=False)
_event_labels = function("pecs_event_labels", INT64, POINTER, INT64, POINTER, TEXT, DOUBLE, POINTER, INT64)


CHANNELS = tuple(  # of the layer `motion`
    way + name
    for way in ("", "back_")
    for name in ("x_q1", "y_q1", "x_mid", "y_mid", "x_q3", "y_q3", "x_end", "y_end", "z", "z_end")
)
CHANNEL_COUNTS = (2, 4, len(CHANNELS))  # of motion: forward flow, both, the layer
QUARTERS = np.arange(1, 5) / 4  # fractions of an interval at which the layer contains displacements
_POWERS = np.arange(1, 5)
_COEFFICIENTS = np.linalg.inv(QUARTERS[:, None] ** _POWERS)  # [power, quarter]


def displacement_weights(fraction: float) -> NDArray[np.float64]:
    """[4]: weights of the displacements after each quarter of an interval, whose sum is that at a fraction of it."""
    return np.asarray(fraction**_POWERS @ _COEFFICIENTS)


def velocity_weights(fraction: float) -> NDArray[np.float64]:
    """[4]: as `displacement_weights`, of the velocity per interval."""
    return np.asarray(_POWERS * fraction ** (_POWERS - 1) @ _COEFFICIENTS)


class Carrier(Handle):
    """The motion between two keyframes, prepared once for any number of instants.

        with pecs.Carrier(stack.read_layer("motion", 0)) as carrier:
            light = pecs.CarriedLight(carrier, first, second)
            third, half = light.at(1 / 3), light.at(1 / 2)

    `motion` is [20, H, W], a stack's layer `motion`; [2, H, W], forward optical flow [pixels]; or [4, H, W], forward
    and backward flow. NaN: unknown.
    """

    _free = staticmethod(_close)

    def __init__(self, motion: ArrayLike):
        m = np.ascontiguousarray(unmasked("motion", motion), np.float32)
        if m.ndim != 3 or len(m) not in CHANNEL_COUNTS:
            raise ValueError(f"motion: got shape {m.shape}, wanted ({len(CHANNELS)}, H, W), or 2 or 4 channels")
        self._size = m.shape[1:]
        super().__init__(_open(m, len(m), m.shape[2], m.shape[1]))

    def labels(self, first: ArrayLike, second: ArrayLike, fraction: float) -> NDArray[np.int32]:
        """Object ids [H, W] at a time within the interval (`fraction`, 0 to 1) between two planes of them, warped along
        the motion.

        The nearest surface wins; ids are never blended. Where neither plane shows the surface: what both have at the
        pixel, or 0.
        """
        a, b = _whole(first), _whole(second)
        if a.shape != b.shape or a.ndim != 2:
            raise ValueError(f"labels: got shapes {a.shape} and {b.shape}, wanted two of [H, W]")
        self._check_size(a.shape)
        out = np.empty_like(a)
        self._call(_labels, a, b, fraction, out, out.size)
        return out

    def _check_size(self, size: tuple[int, ...]) -> None:
        if size != self._size:
            raise ValueError(f"motion: got {self._size[0]} x {self._size[1]} pixels, wanted {size[0]} x {size[1]}")


class CarriedLight(Handle):
    """The light between two keyframes [H, W] or [bands, H, W], warped along the motion; prepared once for any number of
    instants. The carrier may be closed afterwards; contiguous float32 keyframes are not copied and must not change.
    """

    _free = staticmethod(_close_light)

    def __init__(self, carrier: Carrier, first: ArrayLike, second: ArrayLike):
        a, b = (np.ascontiguousarray(unmasked("keyframes", v), np.float32) for v in (first, second))
        if a.shape != b.shape or a.ndim not in (2, 3):
            raise ValueError(f"keyframes: got shapes {a.shape} and {b.shape}, wanted two of [H, W] or [bands, H, W]")
        carrier._check_size(a.shape[-2:])
        self._keyframes = a, b  # the library has pointers to them
        super().__init__(carrier._call(_open_light, a, b, 1 if a.ndim == 2 else len(a)))

    def at(
        self,
        fraction: float,
        boxes: ArrayLike | None = None,
        out: NDArray[np.float32] | None = None,
        side: str = "both",
    ) -> NDArray[np.float32]:
        """The light at one instant (`fraction` of the interval, 0 to 1), in the shape of the keyframes.

        `boxes` [n, 4] (left, top, right, bottom [px]) are the parts to compute; light elsewhere is unspecified. `out`
        is filled and returned. `side`: "both"; "first" or "second" is what this keyframe alone predicts, NaN where it
        does not show the surface.
        """
        shape = self._keyframes[0].shape
        out = np.full(shape, np.nan, np.float32) if out is None else out
        check_out("out", out, np.float32, shape)
        some = np.ascontiguousarray(() if boxes is None else boxes, np.int32).reshape(-1, 4)
        parts = None if boxes is None else some.ctypes.data
        self._call(_light_at, fraction, side.encode(), parts, len(some), out, out.size)
        return out


def carry(
    first: ArrayLike, second: ArrayLike, motion: ArrayLike, fraction: float, side: str = "both"
) -> NDArray[np.float32]:
    """The light at one instant between two keyframes, warped along motion: `CarriedLight.at`, with the arguments of
    `Carrier` and `CarriedLight`.

        half = pecs.carry(stack.read_frame(0), stack.read_frame(1), stack.read_layer("motion", 0), 0.5)
    """
    with Carrier(motion) as carrier:
        return CarriedLight(carrier, first, second).at(fraction, side=side)


def carry_labels(first: ArrayLike, second: ArrayLike, motion: ArrayLike, fraction: float) -> NDArray[np.int32]:
    """Object ids at one instant between two planes of them, warped along motion: `Carrier(motion).labels`."""
    with Carrier(motion) as carrier:
        return carrier.labels(first, second, fraction)


def event_labels(
    events: NDArray[Any], stack: str | PathLike[str] | StackReader, layer: str = "objects", begin_us: float = 0.0
) -> NDArray[np.uint16]:
    """The object that each event's pixel saw at the event's own time, to half a pixel of motion: one id per event; 0
    outside the stack's time, which a period repeats, and where the layer has 0.

        ids = pecs.event_labels(pecs.read("events.h5"), "truth")

    `stack` has the layer `motion` and `layer`, of one channel of whole numbers; light is not required. Events are
    sorted by t; `begin_us` is their time at the stack's first frame.
    """
    if not isinstance(stack, StackReader):
        with StackReader(stack) as reader:
            return event_labels(events, reader, layer, begin_us)
    some = as_events(events)
    out = np.empty(len(some), np.uint16)
    with stack._use() as handle:
        _event_labels(some.ctypes.data, len(some), handle, layer.encode(), begin_us, out.ctypes.data, len(out))
    return out


def _whole(labels: ArrayLike) -> NDArray[np.int32]:
    given = unmasked("labels", labels)
    out = np.ascontiguousarray(given.astype(np.int32))
    if not np.array_equal(out, given):
        raise ValueError("labels: got values that are no whole numbers of 32 bits")
    return out
