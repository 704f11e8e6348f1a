"""Light from events without a network."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

CUTOFF_HZ = 1.0


class HighPass:
    """Each event adds its contrast threshold to its pixel's ln(light), which decays to 0: the high-pass filter of
    Scheerlinck, Barnes and Mahony (ACCV 2018, eq. 9, without frames). As it is linear, a window's events are summed in
    closed form: the state at the window's end is exact.
    """

    def __init__(
        self,
        width: int,
        height: int,
        cutoff_hz: float = CUTOFF_HZ,
        threshold_on: float = 0.2,
        threshold_off: float = 0.2,
    ):
        """cutoff_hz: cutoff frequency; the decay is exp(-2 pi cutoff_hz t). Thresholds in ln(light)."""
        self._shape = height, width
        self._rate_per_us = 2e-6 * np.pi * cutoff_hz
        self._steps = np.array([-threshold_off, threshold_on])
        self._state = np.zeros(width * height)
        self._at_us: float | None = None

    def push(self, events: NDArray[Any], end_us: float) -> NDArray[np.float64]:
        """ln(light) at end_us [H, W], relative. events: with t, x, y, p, not before the last end nor after this one."""
        if self._at_us is not None:
            self._state *= np.exp(-self._rate_per_us * (end_us - self._at_us))
        self._at_us = end_us
        pixels = events["y"].astype(np.int64) * self._shape[1] + events["x"]
        added = self._steps[events["p"].astype(np.intp)] * np.exp(-self._rate_per_us * (end_us - events["t"]))
        self._state += np.bincount(pixels, added, self._state.size)
        return self._state.reshape(self._shape).copy()
