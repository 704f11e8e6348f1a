"""Events as planes, for networks: float32, row 0 at the top, computed in one thread without Python's lock; and as a
picture.

    events = pecs.read("recording.raw")
    grid = pecs.voxel_grid(events, 346, 260, bins=5, begin_us=0, end_us=50_000, normalise=True)  # [5, 260, 346]

All take a structured array with t, x, y and p; `pecs.EVENT_DTYPE` is the fastest. Events outside [begin_us, end_us] do
not count; None is the first or the last event's time. `out`: an array to fill in place of a new one, such as
`torch.empty(shape, pin_memory=True).numpy()`. Raise PecsInputError for pixels outside the picture and wrong arguments.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._c_types import DOUBLE, FLOATS, INT, INT64, POINTER, TEXT, check_out
from ._library import function
from .events import as_events

_events = (POINTER, INT64, INT, INT)
_voxel_grid = function("pecs_voxel_grid", INT, *_events, INT, DOUBLE, DOUBLE, INT, FLOATS, INT64)
_time_surface = function("pecs_time_surface", INT, *_events, DOUBLE, DOUBLE, DOUBLE, FLOATS, INT64)
_event_histogram = function("pecs_event_histogram", INT, *_events, INT, DOUBLE, DOUBLE, FLOATS, INT64)

_picture = function("pecs_event_picture", INT, *_events, TEXT, POINTER, INT64)

_Planes = NDArray[np.float32]


def voxel_grid(
    events: NDArray[Any],
    width: int,
    height: int,
    bins: int = 5,
    begin_us: float | None = None,
    end_us: float | None = None,
    *,
    normalise: bool = False,
    out: _Planes | None = None,
) -> _Planes:
    """Voxel grid, bilinear in time (Zhu et al., CVPR 2019), as E2VID takes it.

    Bin b is the sum over events of (1 if p else -1) * max(0, 1 - |b - t*|), with t* = (bins - 1) (t - begin_us) /
    (end_us - begin_us).

    Parameters
    ----------
    events : structured array
        With the fields t, x, y and p.
    width, height : int
        Size of the planes [pixels].
    bins : int
        Number of bins. Default 5.
    begin_us, end_us : float, optional
        Window [us]. Default: that of the events.
    normalise : bool
        Give the values that are not 0 mean 0 and standard deviation 1. Default False.
    out : float32 array, optional
        Of the result's shape, written and returned.

    Returns
    -------
    float32 array
        [bins, height, width].
    """
    some, begin, end = _window(events, begin_us, end_us)
    planes = _planes(bins, height, width, out)
    _voxel_grid(some.ctypes.data, len(some), width, height, bins, begin, end, int(normalise), planes, planes.size)
    return planes


def time_surface(
    events: NDArray[Any],
    width: int,
    height: int,
    tau_us: float,
    begin_us: float | None = None,
    end_us: float | None = None,
    out: _Planes | None = None,
) -> _Planes:
    """Time surface (Lagorce et al., HOTS, TPAMI 2017): exp(-(end_us - t) / tau_us) of the pixel's last event.

    [2, height, width], OFF and ON; 0 without an event. Arguments as in `voxel_grid`; tau_us: time constant [us].
    """
    some, begin, end = _window(events, begin_us, end_us)
    planes = _planes(2, height, width, out)
    _time_surface(some.ctypes.data, len(some), width, height, begin, end, tau_us, planes, planes.size)
    return planes


def event_histogram(
    events: NDArray[Any],
    width: int,
    height: int,
    bins: int = 1,
    begin_us: float | None = None,
    end_us: float | None = None,
    out: _Planes | None = None,
) -> _Planes:
    """Counts of events, as RVT's stacked histograms (Gehrig & Scaramuzza, CVPR 2023), without their upper limit.

    [2 * bins, height, width]: all bins in time of OFF, then all of ON. Arguments as in `voxel_grid`.
    """
    some, begin, end = _window(events, begin_us, end_us)
    planes = _planes(2 * bins, height, width, out)
    _event_histogram(some.ctypes.data, len(some), width, height, bins, begin, end, planes, planes.size)
    return planes


def event_picture(events: NDArray[Any], width: int, height: int, theme: str = "light") -> NDArray[np.uint8]:
    """The picture that `pecs view` draws, [height, width, 3] RGB: ON blue, OFF orange; one event has 0.7 of its colour,
    two have 0.91. theme: "light" or "dark"."""
    some, out = as_events(events), np.empty((max(0, height), max(0, width), 3), np.uint8)
    _picture(some.ctypes.data, len(some), width, height, theme.encode(), out.ctypes.data, out.size)
    return out


def _window(
    events: NDArray[Any], begin_us: float | None, end_us: float | None
) -> tuple[NDArray[np.void], float, float]:
    some = as_events(events)
    first, last = (some["t"].min(), some["t"].max()) if len(some) and None in (begin_us, end_us) else (0, 0)
    return some, float(first if begin_us is None else begin_us), float(last if end_us is None else end_us)


def _planes(planes: int, height: int, width: int, out: _Planes | None) -> _Planes:
    shape = (planes, height, width)
    if out is None:
        return np.empty(tuple(max(0, n) for n in shape), np.float32)  # the library reports the error
    check_out("out", out, np.float32, shape)
    return out
