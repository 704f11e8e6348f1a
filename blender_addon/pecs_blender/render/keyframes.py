# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses keyframes so that motion explains the light between them.

Each interval is the longest one in which no visible surface moves further than `step_px` and every path is a parabola
to within BEND_PX, which the sensor can follow (docs/reference/exr_stack.md). Both are measured on a small picture at
five instants of the interval; points without a place at its end are ignored.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pecs._progress import Line

from .surfaces import Poses, SurfaceHits, Surfaces
from .timeline import Timeline

BEND_PX = 0.01  # a still outline, such as a turning disk's, moves by this over what is behind it
LONGEST = 256  # grid steps; limits aliasing of periodic motion
FRACTIONS = (0.25, 0.5, 0.75, 1.0)


class Paths:
    """Paths of surface points, with cached hits and poses of the last few instants."""

    def __init__(self, surfaces: Surfaces, set_time: Callable[[float], None], scale: float):
        self._surfaces, self._set_time, self._scale = surfaces, set_time, scale
        self._seen: dict[float, SurfaceHits] = {}
        self._poses: dict[float, Poses] = {}

    def path(self, from_s: float, to_s: float) -> tuple[float, float]:
        """Longest path [px] of a surface point between two instants, and largest deviation [px] from a parabola."""
        forward = self._one_way(from_s, to_s)
        backward = self._one_way(to_s, from_s)
        return max(forward[0], backward[0]), max(forward[1], backward[1])

    def _one_way(self, from_s: float, to_s: float) -> tuple[float, float]:
        seen = self._hits_at(from_s)
        at = [self._surfaces.place(seen, self._pose(from_s + f * (to_s - from_s)))[:2] for f in (0.0, *FRACTIONS)]
        height, width = at[0].shape[1:]
        limits = np.array([width, height])[:, None, None]
        inside = np.any([np.all((p >= 0) & (p <= limits), axis=0) for p in at[1:]], axis=0)
        known = np.all([np.isfinite(p).all(axis=0) for p in at], axis=0) & inside
        if not known.any():
            return 0.0, 0.0
        at = [p[:, known] / self._scale for p in at]
        length = sum(np.linalg.norm(b - a, axis=0) for a, b in zip(at, at[1:], strict=False))
        middle, end = at[2] - at[0], at[4] - at[0]
        bend = [np.linalg.norm(at[i] - at[0] - parabola(middle, end, FRACTIONS[i - 1]), axis=0) for i in (1, 3)]
        return float(length.max()), float(np.max(bend))

    def _hits_at(self, t_s: float) -> SurfaceHits:
        if t_s not in self._seen:
            self._set_time(t_s)
            self._keep(self._seen, t_s, self._surfaces.hits(), 3)
        return self._seen[t_s]

    def _pose(self, t_s: float) -> Poses:
        if t_s not in self._poses:
            self._set_time(t_s)
            self._keep(self._poses, t_s, self._surfaces.poses(), 12)
        return self._poses[t_s]

    @staticmethod
    def _keep(kept: dict, key: float, value, most: int) -> None:
        kept[key] = value
        while len(kept) > most:
            kept.pop(next(iter(kept)))


def parabola(middle: np.ndarray, end: np.ndarray, fraction: float) -> np.ndarray:
    """Displacement at a fraction of the interval, from those in its middle and at its end."""
    return middle * (4 * fraction * (1 - fraction)) + end * (fraction * (2 * fraction - 1))


def choose(plan: Timeline, motion: Paths, step_px: float, progress: Line) -> list[int]:
    """Indices of the keyframes. They include the first and the last instant; with a period, the last interval ends at
    its end."""
    grid_s = [t * 1e-9 for t in plan.bounds_ns]
    last = len(grid_s) - 1
    keys, guess = [0], 1
    while keys[-1] < last:
        start = keys[-1]
        ends_s = grid_s[start : start + LONGEST + 1]
        guess = _longest(guess, motion, ends_s, step_px)
        keys.append(start + guess)
        progress("", keys[-1], last)
    if plan.period_ns:
        keys.pop()
    return keys


def _longest(guess: int, motion: Paths, ends_s: list[float], step_px: float) -> int:
    """Length of the longest interval whose paths fit, in steps and to about 10 %; at least 1."""
    most = len(ends_s) - 1
    fits, fails, steps = 0, most + 1, max(1, min(guess, most))
    while True:
        length, bend = motion.path(ends_s[0], ends_s[steps])
        likely = 0.98 * steps * min(step_px / max(length, 1e-9), (BEND_PX / max(bend, 1e-9)) ** (1 / 3))
        if length <= step_px and bend <= BEND_PX:
            fits = steps
        else:
            fails = steps
        steps = int(np.clip(min(likely, 4 * steps), fits + 1, fails - 1))
        if fails - fits < 2 or (fits and steps < 1.1 * fits):
            return max(1, fits)
