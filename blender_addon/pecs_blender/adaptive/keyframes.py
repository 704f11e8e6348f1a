# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses keyframes so that motion explains the light between them.

Each interval is the longest one in which no visible surface moves further than `step_px`, hardly any turns or stretches
by more than TURN, and every path is, to within BEND_PX, the polynomial through its places after each quarter, which the
sensor follows (docs/reference/exr_stack.md). They are measured on a small picture at nine instants of the interval;
points without a place at its end are ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pecs._progress import Line
from pecs.motion import displacement_weights

from ..camera.stage import Stage
from ..scene.timeline import Instants, Timeline
from ..truth.surfaces import Poses, Recent, SurfaceHits, Surfaces

BEND_PX = 0.01  # a still outline, such as a turning disk's, moves by this over what is behind it
TURN = 0.5  # rad: the light of an edge's pixels depends on how it lies across them
TURNING = 0.01  # of the picture: what turns in less of it is rendered between keyframes
LONGEST = 256  # grid steps; limits aliasing of periodic motion
PARTS = 8  # of an interval
PLAN_SCALE = 0.25  # size of the pictures on which motion is measured, of the sensor's


@dataclass(frozen=True)
class Keyframes:
    """grid: the finest instants; keys: indices of the keyframes. With a period, the last interval ends at its end."""

    grid: Timeline
    keys: list[int]

    @classmethod
    def at(cls, grid: Timeline, times_ns: list[int]) -> Keyframes:
        """Raises KeyError for times that are not on the grid."""
        index = {t: i for i, t in enumerate(grid.times_ns)}
        return cls(grid, [index[t] for t in times_ns])

    @property
    def timeline(self) -> Timeline:
        return Timeline([self.grid.times_ns[k] for k in self.keys], self.grid.period_ns)

    @property
    def ends(self) -> list[int]:
        """Grid indices at which the intervals end."""
        return self.keys[1:] + ([len(self.grid.times_ns)] if self.grid.period_ns else [])

    def time_s(self, index: int) -> float:
        return self.grid.times_ns[self.keys[index]] * 1e-9

    def middle(self, count: int) -> Keyframes:
        """At most this many keyframes in the middle."""
        first = max(0, (len(self.keys) - count) // 2)
        keys = self.keys[first : first + count]
        times_ns = self.grid.times_ns[keys[0] : keys[-1] + 1]
        return Keyframes(Timeline(times_ns, None), [key - keys[0] for key in keys])


def choose_keyframes(stage: Stage, instants: Instants, progress: Line) -> Keyframes:
    scale = PLAN_SCALE / stage.subpixels
    paths = Paths(Surfaces(stage, scale, name="plan_rays"), stage.set_time, scale * stage.subpixels)
    cameras = [stage.source.camera_at(t * 1e-9) for t in instants.grid.bounds_ns]
    cuts = [i for i in range(1, len(cameras)) if cameras[i] != cameras[i - 1]]
    return Keyframes(instants.grid, _choose(instants.grid, cuts, paths, instants.step_px, progress))


class Paths:
    """Paths of surface points, with cached hits and poses of the last few instants."""

    def __init__(self, surfaces: Surfaces, set_time: Callable[[float], None], scale: float):
        self._surfaces, self._set_time, self._scale = surfaces, set_time, scale
        self._seen: Recent[SurfaceHits] = Recent(3)
        self._poses: Recent[Poses] = Recent(2 * PARTS + 4)

    def path(self, from_s: float, to_s: float) -> np.ndarray:
        """Between two instants: the longest path of a surface point [px], the largest deviation from its polynomial
        [px], and how much a surface turns or stretches at most."""
        times_s = np.linspace(from_s, to_s, PARTS + 1).tolist()
        return np.maximum(self._one_way(times_s), self._one_way(times_s[::-1]))  # equal times: poses are kept

    def _one_way(self, times_s: list[float]) -> np.ndarray:
        seen = self._seen.get(times_s[0], self._hits)
        poses = [self._poses.get(t, self._pose) for t in times_s]
        if any(one.view.camera != seen.poses.view.camera for one in poses):
            return np.full(3, np.inf)
        at = [self._surfaces.place(seen, one)[:2] for one in poses]
        height, width = at[0].shape[1:]
        limits = np.array([width, height])[:, None, None]
        inside = np.any([np.all((p >= 0) & (p <= limits), axis=0) for p in at[1:]], axis=0)
        known = np.all([np.isfinite(p).all(axis=0) for p in at], axis=0) & inside
        if not known.any():
            return np.zeros(3)
        turn = _turned(np.where(known, at[-1] - at[0], np.nan), seen.instance)
        at = [p[:, known] / self._scale for p in at]
        length = sum(np.linalg.norm(b - a, axis=0) for a, b in zip(at, at[1:], strict=False))
        moved = np.array(at) - at[0]
        bend = [moved[i] - np.tensordot(displacement_weights(i / PARTS), moved[2::2], 1) for i in range(1, PARTS, 2)]
        return np.array([length.max(), np.linalg.norm(bend, axis=1).max(), turn])

    def _hits(self, t_s: float) -> SurfaceHits:
        self._set_time(t_s)
        return self._surfaces.hits()

    def _pose(self, t_s: float) -> Poses:
        self._set_time(t_s)
        return self._surfaces.poses()


def _turned(moved: np.ndarray, instance: np.ndarray) -> float:
    """Change of the distance between neighbours on a surface, relative to it, of displacements [2, h, w]: what all but
    TURNING of the picture stays below. Of the two neighbours of a point along an axis, the one with the smaller change
    counts: the other may be behind it."""
    most = 0.0
    for ids, moves in ((instance, moved), (instance.T, moved.transpose(0, 2, 1))):
        parted = np.where(ids[1:] == ids[:-1], np.linalg.norm(moves[:, 1:] - moves[:, :-1], axis=0), np.nan)
        around = np.minimum(parted[1:], parted[:-1])  # NaN if one is
        most = max(most, float(np.quantile(np.nan_to_num(around), 1 - TURNING)))
    return most


def _choose(plan: Timeline, cuts: list[int], motion: Paths, step_px: float, progress: Line) -> list[int]:
    """Indices of the keyframes. They include the first and the last instant; with a period, the last interval ends at
    its end. cuts: indices at which another camera begins, each a keyframe, like the one before it."""
    grid_s = [t * 1e-9 for t in plan.bounds_ns]
    last = len(grid_s) - 1
    keys, guess = [0], 1
    while keys[-1] < last:
        start = keys[-1]
        cut = next((cut for cut in cuts if cut > start), last + 1)
        ends_s = grid_s[start : min(start + LONGEST, max(start + 1, cut - 1)) + 1]
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
        used = motion.path(ends_s[0], ends_s[steps]) / (step_px, BEND_PX, TURN)
        likely = 0.98 * steps * np.min(1 / np.maximum(used, 1e-9) ** (1, 1 / 5, 1))  # bends grow with the fifth power
        if used.max() <= 1:
            fits = steps
        else:
            fails = steps
        steps = int(np.clip(min(likely, 4 * steps), fits + 1, fails - 1))
        if fails - fits < 2 or (fits and steps < 1.1 * fits):
            return max(1, fits)
