# SPDX-License-Identifier: GPL-3.0-or-later
"""What motion does not explain between two keyframes is rendered at instants of the plan that lie between them.

Both keyframes, carried along the motion to the middle, must agree there (in photocurrent, by blocks of pixels, beyond
noise), and with strips that are rendered in the middle: when a lamp flickers, both may agree and be wrong. Where they
do not, the middle is rendered; and where that picture differs from what the sensor would have taken, each half in the
same way, down to the plan's own instants (docs/reference/motion.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pecs

from .job import Job
from .judge import Judge
from .layers import Light
from .output import Output
from .tiles import boxes, grown

ROUNDS = 3  # of growing, until what is rendered agrees at its rim
MOST = 0.6  # of the picture; more is rendered as a whole


@dataclass
class Interval:
    """Between keyframes `first` and `second` (light, [bands, height, width]) at plan instants `start` and `end`."""

    index: int
    start: int
    end: int
    first: np.ndarray
    second: np.ndarray
    motion: np.ndarray
    planes: tuple[np.ndarray, ...] = ()  # photocurrent of both
    residual: dict[int, np.ndarray] = field(default_factory=dict)  # ln(rendered / carried), NaN where not rendered


class Between:
    def __init__(self, job: Job, light: Light, judge: Judge, times_s: list[float], output: Output):
        """times_s: the plan's instants."""
        self._job, self._light, self._judge, self._times_s, self._output = job, light, judge, times_s, output

    def refine(self, it: Interval) -> None:
        """Renders and writes what its keyframes and its motion do not tell."""
        if it.end - it.start > 1:
            it.planes = self._judge.plane(it.first), self._judge.plane(it.second)
            self._halve(it, it.start, it.end, self._disagreeing(it) | self._probed(it))

    def _fraction(self, it: Interval, step: int) -> float:
        start_s, end_s = self._times_s[it.start], self._times_s[it.end]
        return (self._times_s[step] - start_s) / (end_s - start_s)

    def _disagreeing(self, it: Interval) -> np.ndarray:
        first, second = it.planes
        fraction = self._fraction(it, (it.start + it.end) // 2)
        a, b = (pecs.carry(first, second, it.motion, fraction, side=side) for side in ("first", "second"))
        nowhere = np.isnan(a) & np.isnan(b)
        return self._judge.differing(np.where(nowhere, first, a), np.where(nowhere, second, b))

    def _probed(self, it: Interval) -> np.ndarray:
        middle = (it.start + it.end) // 2

        def carried(bands: slice) -> np.ndarray:
            planes = (self._judge.plane(light, bands) for light in (it.first, it.second))
            return pecs.carry(*planes, it.motion, self._fraction(it, middle))

        self._job.set_time(self._times_s[middle])
        return self._judge.strips_differing(self._job, self._light, it.index, carried)

    def _predicted(self, it: Interval, step: int, carried: np.ndarray) -> np.ndarray:
        """As the sensor will: carried, times what was rendered between."""
        nodes = sorted(it.residual)
        shape = it.first.shape[1:]
        before, after = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        t_before = np.full(shape, self._times_s[it.start])
        t_after = np.full(shape, self._times_s[it.end])
        for node in nodes:
            known = np.isfinite(it.residual[node])
            t, values = self._times_s[node], it.residual[node]
            earlier = known & (node < step)
            before[earlier], t_before[earlier] = values[earlier], t
            later = known & (node > step) & (t < t_after)
            after[later], t_after[later] = values[later], t
        part = (self._times_s[step] - t_before) / (t_after - t_before)
        return carried * np.exp(before + part * (after - before))

    def _halve(self, it: Interval, low: int, high: int, wrong: np.ndarray) -> None:
        middle = (low + high) // 2
        if middle == low or not wrong.any():
            return
        carried = pecs.carry(*it.planes, it.motion, self._fraction(it, middle))
        predicted = self._predicted(it, middle, carried)
        self._job.set_time(self._times_s[middle])
        wanted, picture = np.zeros_like(wrong), np.full(it.first.shape, np.nan, np.float32)
        for _ in range(ROUNDS):
            more = grown(wrong) & ~wanted
            if not more.any():
                break
            if (wanted | more).mean() > MOST:
                more = ~wanted
            fresh = self._light.parts(boxes(more, *self._job.size), it.first)
            picture = np.where(np.isnan(fresh), picture, fresh)
            wanted |= more
            plane = self._judge.plane(picture)
            wrong = self._judge.differing(predicted, plane)
        self._output.write_between(it.index, middle - it.start, round(self._times_s[middle] * 1e9), picture)
        with np.errstate(divide="ignore", invalid="ignore"):
            residual = np.log(plane / carried)
        it.residual[middle] = np.where(np.isinf(residual), 0, residual)
        self._halve(it, low, middle, wrong)
        self._halve(it, middle, high, wrong)
