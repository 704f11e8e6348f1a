# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses keyframes so that motion explains the light between them.

Each interval is the longest one in which no visible surface moves further than `step_px`, hardly any turns or stretches
by more than TURN, and every path is, to within BEND_PX, the polynomial through its places after each quarter, which the
sensor follows (docs/reference/exr_stack.md). They are measured on a small picture at nine instants of the interval;
points without a place at its end are ignored. Nothing is in the picture between its ends alone, nor missing there.

Where this costs less, partial keyframes divide longer intervals of whole ones. In them, a part of the picture is
rendered: what moves or turns too far in the longer interval, such as a fan. The places of all other points are exact in
each of them, so that bends of their paths do not limit the longer interval.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

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
FAST = np.array([0.01, 0.05, 0.1, 0.2, 0.3])  # of the picture: what is rendered in partial keyframes covers less
GAIN = 2  # intervals with partial keyframes are longer by this factor
PARTIAL_COST, TILES = 0.15, 3  # of a partial keyframe, in whole ones: fixed, and per FAST (whole tiles are rendered)
PLAN_SCALE = 0.25  # size of the pictures on which motion is measured, of the sensor's


@dataclass(frozen=True)
class Keyframes:
    """grid: the finest instants; keys: indices of the keyframes; partial: positions in `keys` of those that are
    rendered in a small part; the first is whole. With a period, the last interval ends at its end. paths_px: mean path
    of the surface points in each interval, if the keyframes were chosen here."""

    grid: Timeline
    keys: list[int]
    partial: tuple[int, ...] = ()
    paths_px: tuple[float, ...] = ()

    @classmethod
    def at(cls, grid: Timeline, times_ns: list[int], partial: list[int]) -> Keyframes:
        """Raises KeyError for times that are not on the grid."""
        index = {t: i for i, t in enumerate(grid.times_ns)}
        return cls(grid, [index[t] for t in times_ns], tuple(partial))

    @property
    def timeline(self) -> Timeline:
        return Timeline([self.grid.times_ns[k] for k in self.keys], self.grid.period_ns)

    @property
    def ends(self) -> list[int]:
        """Grid indices at which the intervals end."""
        return self.keys[1:] + ([len(self.grid.times_ns)] if self.grid.period_ns else [])

    @cached_property
    def whole(self) -> list[int]:
        """Positions in `keys` of the keyframes that are rendered whole."""
        return sorted(set(range(len(self.keys))) - set(self.partial))

    def time_s(self, index: int) -> float:
        return self.grid.times_ns[self.keys[index]] * 1e-9

    def typical(self, count: int) -> Keyframes:
        """At most this many whole keyframes, and the partial ones between them: about as many as on average, otherwise
        near the middle."""
        begins = np.arange(max(1, len(self.whole) - count + 1))
        whole = np.array(self.whole)
        spans = whole[np.minimum(begins + count, len(whole)) - 1] - whole[begins]
        off = np.abs(spans - (whole[-1] - whole[0]) * (count - 1) / max(1, len(whole) - 1))
        at = min(begins, key=lambda i: (round(off[i]), abs(i - begins.mean())))
        some = self.whole[at : at + count]
        keys = self.keys[some[0] : some[-1] + 1]
        times_ns = self.grid.times_ns[keys[0] : keys[-1] + 1]
        partial = tuple(i - some[0] for i in self.partial if some[0] < i < some[-1])
        paths_px = self.paths_px[some[0] : some[-1]]
        return Keyframes(Timeline(times_ns, None), [key - keys[0] for key in keys], partial, paths_px)


def choose_keyframes(stage: Stage, instants: Instants, progress: Line) -> Keyframes:
    cameras = [stage.source.camera_at(t * 1e-9) for t in instants.grid.bounds_ns]
    cuts = [i for i in range(1, len(cameras)) if cameras[i] != cameras[i - 1]]
    paths, grid = Paths(stage, instants.step_px), instants.grid
    keys, partial = _choose(grid, cuts, paths, not stage.lamps.names, progress)
    chosen = Keyframes(grid, keys, tuple(partial))
    along_px = (
        paths.mean_px[grid.bounds_ns[a] * 1e-9, grid.bounds_ns[b] * 1e-9]
        for a, b in zip(keys, chosen.ends, strict=False)
    )
    return replace(chosen, paths_px=tuple(along_px))


class Paths:
    """Paths of surface points, with cached hits and poses of the last few instants. mean_px: of their lengths, between
    the two instants of each call of `needs`."""

    def __init__(self, stage: Stage, step_px: float):
        self._surfaces = Surfaces(stage, PLAN_SCALE / stage.subpixels, name="plan_rays")
        self._set_time, self._limits = stage.set_time, (step_px, BEND_PX, TURN, TURN)
        self._seen: Recent[SurfaceHits] = Recent(3)
        self._poses: Recent[Poses] = Recent(2 * PARTS + 4)
        self.mean_px: dict[tuple[float, float], float] = {}

    def needs(self, from_s: float, to_s: float) -> np.ndarray:
        """Intervals that paths between two instants require: of all surfaces, where the longest paths, their largest
        deviation from the polynomial and what turns or stretches most decide; and the whole ones, with partial ones, if
        all but each of FAST of the picture decides, without that deviation."""
        ways = self._ways(from_s, to_s)
        self.mean_px[from_s, to_s] = self._limits[0] * float(ways[0][0].mean()) if ways else 0.0
        if ways is None:
            return np.full(1 + len(FAST), np.inf)
        comes_or_goes = self._comes_or_goes([self._poses.get(t, self._pose) for t in _instants(from_s, to_s)])
        required = [np.full(1 + len(FAST), 2.0 * comes_or_goes)]
        for used in ways:
            turned = [np.quantile(one, 1 - TURNING) for one in (used[2, 1:-1], used[3, :, 1:-1])]
            every = max(used[0].max(), np.power(used[1].max(), 1 / 5), *turned)  # bends grow with the fifth power
            required.append([every, *np.quantile(_far(used), 1 - FAST)])
        return np.max(required, axis=0)

    def fast(self, from_s: float, to_s: float, size: tuple[int, int]) -> np.ndarray:
        """[2, 2, height, width]: pixels of pictures of this size at two instants that show surfaces that move or turn
        too far in between, and those that turn too far."""
        far = np.array([(_far(used) > 1, used[2:].max(0) > 1) for used in self._ways(from_s, to_s)]).swapaxes(0, 1)
        x, y = (np.arange(n) * own // n for n, own in zip(size, self._surfaces.size, strict=True))
        return far[:, :, y][..., x]

    def _ways(self, from_s: float, to_s: float) -> list[np.ndarray] | None:
        """What `_used` returns, of the surfaces seen at each of the two instants; None across a cut."""
        times_s, found = _instants(from_s, to_s), []
        for along_s in (times_s, times_s[::-1]):  # equal times: poses are kept
            seen = self._seen.get(along_s[0], self._hits)
            poses = [self._poses.get(t, self._pose) for t in along_s]
            if any(one.view.camera != seen.poses.view.camera for one in poses):
                return None
            places = [self._surfaces.place(seen, one)[:2] for one in poses]
            found.append(self._used(places, seen.instance))
        return found

    def _used(self, at: list[np.ndarray], instance: np.ndarray) -> np.ndarray:
        """[4, h, w], relative to what is allowed in an interval: length of the path, its deviation from the polynomial,
        turn or stretch against neighbours in y and in x. 0 if the path is unknown."""
        height, width = at[0].shape[1:]
        limits = np.array([width, height])[:, None, None]
        inside = np.any([np.all((p >= 0) & (p <= limits), axis=0) for p in at[1:]], axis=0)
        known = np.all([np.isfinite(p).all(axis=0) for p in at], axis=0) & inside
        out = np.zeros((4, height, width))
        moved = np.where(known, at[-1] - at[0], np.nan)
        out[2] = _turned(moved, instance)
        out[3] = _turned(moved.transpose(0, 2, 1), instance.T).T
        at = [p[:, known] / PLAN_SCALE for p in at]
        out[0, known] = sum(np.linalg.norm(b - a, axis=0) for a, b in zip(at, at[1:], strict=False))
        moved = np.array(at) - at[0]
        bend = [moved[i] - np.tensordot(displacement_weights(i / PARTS), moved[2::2], 1) for i in range(1, PARTS, 2)]
        out[1, known] = np.linalg.norm(bend, axis=1).max(0)
        return out / np.array(self._limits)[:, None, None]

    def _comes_or_goes(self, poses: list[Poses]) -> bool:
        """Whether an instance, its box or this box's middle, is in the picture between the first and the last of these
        instants but at neither, or at both while the instance does not exist in between; or a lamp is on or off in
        between alone."""
        lit = [one.lamps.keys() for one in poses]
        if any((one ^ lit[0]) - (lit[0] ^ lit[-1]) for one in lit):
            return True
        ids = np.unique(np.concatenate([one.ids for one in poses]))
        outside = [self._surfaces.outside(one, ids) for one in poses]
        gaps = ~np.all([one.find(ids) >= 0 for one in poses], axis=0)
        for points in np.s_[..., :-1], np.s_[..., -1:]:
            first, last = (~outside[end][points].all(-1).any(-1) for end in (0, -1))
            passes = np.any([~(a & b)[points].all(-1).any(-1) for a, b in pairwise(outside)], axis=0)
            if (passes & ~first & ~last | first & last & gaps).any():
                return True
        return False

    def _hits(self, t_s: float) -> SurfaceHits:
        self._set_time(t_s)
        return self._surfaces.hits()

    def _pose(self, t_s: float) -> Poses:
        self._set_time(t_s)
        return self._surfaces.poses()


def _instants(from_s: float, to_s: float) -> list[float]:
    return np.linspace(from_s, to_s, PARTS + 1).tolist()


def _far(used: np.ndarray) -> np.ndarray:
    """The larger one of length and turns, relative to what is allowed in an interval."""
    return used[[0, 2, 3]].max(0)


def _turned(moved: np.ndarray, instance: np.ndarray) -> np.ndarray:
    """[h, w]: change of the distance between neighbours in y on a surface, relative to it, of displacements [2, h, w].
    Of the two neighbours of a point, the one with the smaller change counts: the other may be behind it."""
    parted = np.where(instance[1:] == instance[:-1], np.linalg.norm(moved[:, 1:] - moved[:, :-1], axis=0), np.nan)
    return np.pad(np.nan_to_num(np.minimum(parted[1:], parted[:-1])), ((1, 1), (0, 0)))  # NaN if one is


def _choose(
    plan: Timeline, cuts: list[int], paths: Paths, may_be_partial: bool, progress: Line
) -> tuple[list[int], list[int]]:
    """Indices of the keyframes, and the positions of the partial ones among them. They include the first and the last
    instant; with a period, the last interval ends at its end. cuts: indices at which another camera begins, each a
    keyframe, like the one before it."""
    grid_s = [t * 1e-9 for t in plan.bounds_ns]
    last = len(grid_s) - 1
    keys, partial, guesses = [0], [], [1, 1]
    while keys[-1] < last:
        start = keys[-1]
        cut = next((cut for cut in cuts if cut > start), last + 1)
        ends_s = grid_s[start : min(start + LONGEST, max(start + 1, cut - 1)) + 1]
        steps, likely = _longest(guesses[0], paths, ends_s, 0)
        guesses[0] = whole = steps
        if may_be_partial and (of := _cheapest(steps, np.minimum(likely, len(ends_s) - 1))):
            longer, _ = _longest(max(guesses[1], GAIN * steps), paths, ends_s, of)
            if longer >= GAIN * steps:
                guesses[1] = whole = longer
        end, most = start + whole, start + len(ends_s) - 1
        while keys[-1] + steps < end:
            partial.append(len(keys))
            keys.append(keys[-1] + steps)
            steps, _ = _longest(steps, paths, grid_s[keys[-1] : end + 1], 0)
        if start < keys[-1] and end < most and 2 * (end - keys[-1]) < keys[-1] - keys[-2]:
            partial.pop()  # the last partial one is the whole one: a short interval costs as much as a long one
        else:
            keys.append(end)
        progress("", keys[-1], last)
    if plan.period_ns:
        keys.pop()
    return keys, partial


def _cheapest(steps: int, likely: np.ndarray) -> int:
    """Which of Paths.needs gives the cheapest whole intervals, of these lengths, that partial keyframes divide after
    `steps` each; 0 for whole ones of `steps`."""
    partial = (likely[1:] / steps - 1) * (PARTIAL_COST + TILES * FAST)
    cost = np.append(1 / steps, np.where(likely[1:] >= GAIN * steps, (1 + partial) / np.maximum(likely[1:], 1), np.inf))
    return int(np.argmin(cost))


def _longest(guess: int, paths: Paths, ends_s: list[float], of: int) -> tuple[int, np.ndarray]:
    """Length of the longest interval whose paths fit, in steps and to about 10 %, at least 1; and about that of each of
    Paths.needs. of: which of them must fit."""
    most = len(ends_s) - 1
    fits, fails, steps = 0, most + 1, max(1, min(guess, most))
    while True:
        needs = paths.needs(ends_s[0], ends_s[steps])
        likely = 0.98 * steps / np.maximum(needs, 1e-9)
        if needs[of] <= 1:
            fits = steps
        else:
            fails = steps
        steps = int(np.clip(min(likely[of], 4 * steps), fits + 1, fails - 1))
        if fails - fits < 2 or (fits and steps < 1.1 * fits):
            return max(1, fits), likely
