# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive steps: keyframes, the motion between them, and pictures between keyframes (docs/reference/motion.md).

A keyframe is complete when its layers are written, the light last; the interval after it is complete when its motion is
written, which follows the pictures between.

The light that is written is denoised. Decisions (what changed, which samples are shared, what is rendered between) are
made on the light as rendered: a denoiser's error has no known distribution, that of samples has.
"""

from __future__ import annotations

from bisect import bisect
from dataclasses import dataclass

import numpy as np
import pecs
from pecs.motion import CHANNELS

from ..camera.light import Light
from ..camera.stage import Stage
from ..camera.tiles import in_blocks, tiles_under
from ..output import Layer, Output
from ..truth.surfaces import HitCache, Recent, SurfaceHits
from .between import Between, KeyframeInterval, PartialKeyframe
from .changed import ChangedParts, Picture
from .judge import Judge
from .keyframes import Keyframes, Paths
from .sharing import average_samples

SHARED = 2  # keyframes on each side whose samples are shared
ANCHOR_EVERY = 64  # keyframes; also at a cut

# Motion as written: its files are a third as large as without rounding
MOTION_STEP_PX = 2.0**-10
DEPTH_BITS = 16  # of the 23 bits of a mantissa


def _usable(motion: np.ndarray) -> np.ndarray:
    """Rounds CHANNELS in place, and returns them. Where the motion at one end is unknown, it is unknown at both: what
    vanishes or appears would otherwise show what is behind it at all other times."""
    unit, (there, back) = 1 << (23 - DEPTH_BITS), np.split(motion, 2)
    unknown = np.isnan(there[0]) | np.isnan(back[0])
    for way in (there, back):
        way[:8, unknown], way[9, unknown] = np.nan, np.nan
    for name, plane in zip(CHANNELS, motion, strict=True):
        if name.removeprefix("back_") in ("z", "z_end"):
            bits = plane.view(np.int32)
            bits += unit // 2
            bits &= -unit
        else:
            np.rint(plane / MOTION_STEP_PX, out=plane)
            plane *= MOTION_STEP_PX
    return motion


@dataclass(frozen=True)
class Division:
    """An interval of whole keyframes that partial ones divide. start, end: grid indices; first, last: hits there; fast,
    turning: [2, height, width], pixels of both that show surfaces that move or turn too far, and that turn too far."""

    start: int
    end: int
    first: SurfaceHits
    last: SurfaceHits
    fast: np.ndarray
    turning: np.ndarray


@dataclass(frozen=True)
class Middle:
    """The partial keyframe in the middle of a division. wrong: as Division.turning, of surfaces whose light is not that
    of the whole keyframes there."""

    index: int
    keyframe: PartialKeyframe
    wrong: np.ndarray


def _moves(motion: np.ndarray) -> np.ndarray:
    """[2, 2, height, width]: x and y of the displacement over the interval, of both ways."""
    return motion[[[CHANNELS.index(f"{way}{x}_end") for way in ("", "back_")] for x in "xy"]]


class Adaptive:
    """Writes keyframes and intervals of a stack."""

    warm_up = 2 * SHARED  # frames until the caches are full

    def __init__(
        self,
        stage: Stage,
        keyframes: Keyframes,
        light: Light,
        layers: list[Layer],
        *,
        hits: HitCache,
        tolerance: float,
        step_px: float,
        output: Output,
    ):
        self._stage, self._keyframes, self._hits, self._output = stage, keyframes, hits, output
        self._motion = next(layer for layer in layers if layer.name == "motion")
        self._instant_layers = [layer for layer in layers if layer.at == "instant"]
        self._judge = Judge(stage.weights, tolerance, stage.subpixels)
        self._changes = ChangedParts(stage, light, hits, self._judge)
        self._grid_s = [t * 1e-9 for t in keyframes.grid.bounds_ns]
        self._light = light
        self._whole = keyframes.whole
        self._times_s = [keyframes.time_s(i) for i in self._whole]  # by number of the whole keyframe, as what follows
        self._cameras = [stage.source.camera_at(t_s) for t_s in self._times_s]
        self._anchors: list[int] = []
        for number, camera in enumerate(self._cameras):
            begins = number % ANCHOR_EVERY == 0 or camera != self._cameras[number - 1]
            self._anchors.append(number if begins else self._anchors[-1])
        self._own: dict[int, Picture] = {}  # before samples are shared
        self._shared: Recent[Picture] = Recent(3)
        self._partial: Recent[PartialKeyframe] = Recent(2)
        self._divided: Recent[Division] = Recent(1)
        self._middles: Recent[Middle] = Recent(1)
        self._paths = Paths(stage, step_px) if keyframes.partial else None
        self._slow_px = step_px * stage.subpixels  # the longest path of what is not rendered in partial keyframes
        hits.keep(2 * SHARED + 4)

    def is_written(self, index: int) -> bool:
        due = [*self._instant_layers, *([self._motion] if index < len(self._keyframes.ends) else [])]
        return self._output.has_layer("light", index) and all(one.is_written(self._output, index) for one in due)

    def write(self, index: int) -> None:
        output, t_s = self._output, self._keyframes.time_s(index)
        for layer in self._instant_layers:
            if not layer.is_written(output, index):
                self._stage.set_time(t_s)
                layer.write(output, index, t_s)
        first = self.keyframe(index)
        if not output.has_layer("light", index):
            output.write_layer("light", index, self._judge.lit(first.written, self._stage.lamps.factors(t_s)))
        if index < len(self._keyframes.ends):
            self._write_interval(index, first)

    def _write_interval(self, index: int, first: Picture) -> None:
        """Writes the pictures between a keyframe and the next one, then the motion."""
        keyframes = self._keyframes
        start, end, following = keyframes.keys[index], keyframes.ends[index], (index + 1) % len(keyframes.keys)
        second = self.keyframe(following)
        motion = _usable(self._motion.render(keyframes.time_s(index), self._grid_s[end]))
        if end - start > 1:
            path_px = float(np.nan_to_num(np.hypot(*_moves(motion))).max())
            self._between(index, start, end, first, second, motion, path_px).refine()
        self._output.write_layer("motion", index, motion)

    def _between(
        self, index: int, start: int, end: int, first: Picture, second: Picture, motion: np.ndarray, path_px: float
    ) -> Between:
        interval = KeyframeInterval(
            index=index,
            start=start,
            end=end,
            first=first,
            second=second,
            carrier=pecs.Carrier(motion),
            path_px=path_px,
            still=(_moves(motion) == 0).all((0, 1)),
        )
        return Between(self._stage, self._light, self._judge, self._output, self._grid_s, interval)

    def keyframe(self, index: int) -> Picture:
        """A whole keyframe after sample sharing, or a partial one."""
        if index in self._keyframes.partial:
            return self._partial.get(index, self._in_part).picture
        return self._shared.get(self._whole.index(index), self._share_samples)

    def _in_part(self, index: int) -> PartialKeyframe:
        """A partial keyframe: what the whole keyframes around do not explain, in their light. Unless something appears
        between them, this is what turns too far, and the surfaces that they do not explain in the middle one."""
        number = bisect(self._whole, index) - 1
        middle = self._middles.get(number, self._middle)
        if index == middle.index:
            return middle.keyframe
        of, step = self._divided.get(number, self._divide), self._keyframes.keys[index]
        between, places, fast = self._around(number, index)
        wrong = None if middle.keyframe.found else tiles_under(places[:, middle.wrong | of.turning], self._stage.size)
        return between.keyframe(step, fast, wrong)

    def _middle(self, number: int) -> Middle:
        of, keys = self._divided.get(number, self._divide), self._keyframes.keys
        inside = [i for i in self._keyframes.partial if of.start < keys[i] < of.end]
        index = min(inside, key=lambda i: abs(2 * keys[i] - of.start - of.end))
        between, places, fast = self._around(number, index)
        keyframe = between.keyframe(keys[index], fast)
        return Middle(index, keyframe, in_blocks(places, keyframe.differing))

    def _around(self, number: int, index: int) -> tuple[Between, np.ndarray, np.ndarray]:
        """What lies between the whole keyframes around a partial one, along motion that is exact in it, the places
        [2, 2, height, width] there, x and y, of the surfaces seen in both, and the tiles under fast ones."""
        of = self._divided.get(number, self._divide)
        first, second = (self._shared.get(n % len(self._whole), self._share_samples) for n in (number, number + 1))
        from_s, t_s, to_s = (self._grid_s[i] for i in (of.start, self._keyframes.keys[index], of.end))
        part = (t_s - from_s) / (to_s - from_s)
        motion = _usable(self._motion.through(of.first, of.last, t_s, part))
        moves = _moves(motion) * np.array([part, 1 - part])[:, None, None]
        between = self._between(self._whole[number], of.start, of.end, first, second, motion, self._slow_px)
        places = moves + self._hits.surfaces.sight.centres()[:, None]
        return between, places, tiles_under(places[:, of.fast], self._stage.size)

    def _divide(self, number: int) -> Division:
        keys, whole = self._keyframes.keys, self._whole
        start, end = keys[whole[number]], [*(keys[i] for i in whole[1:]), self._keyframes.ends[-1]][number]
        from_s, to_s = self._grid_s[start], self._grid_s[end]
        fast, turning = self._paths.fast(from_s, to_s, self._stage.size)
        return Division(start, end, self._hits.at(from_s), self._hits.at(to_s), fast, turning)

    def _share_samples(self, number: int) -> Picture:
        """Averages a whole keyframe with its neighbours, each warped to its instant, where they show the same surface
        in the same light.

        All frames have the same seed, so noise stays where it is on the film while surfaces move: it averages out where
        something moves, and still parts stay bit-identical.
        """
        count, periodic = len(self._whole), self._keyframes.grid.period_ns
        near = range(number - SHARED, number + SHARED + 1)
        near = [i % count if periodic else i for i in near]
        near = list(dict.fromkeys(i for i in near if 0 <= i < count and self._cameras[i] == self._cameras[number]))
        at_ends = {*range(SHARED), *range(count - SHARED, count)} if periodic else set()
        self._own = {i: own for i, own in self._own.items() if i in near or i in at_ends}
        times_s = self._times_s
        for i in near:
            if i not in self._own:
                self._own[i] = self._changes.render(times_s[i], times_s[self._anchors[i]])
        if len(near) == 1:
            return self._own[number]
        hits = {i: self._hits.at(times_s[i]) for i in near}
        own, factors = self._own[number], self._stage.lamps.factors(times_s[number])
        neighbours = [(self._own[i].light, hits[i]) for i in near if i != number]
        shared = average_samples(own.light, hits[number], neighbours, self._hits.surfaces, self._judge, factors)
        bands = len(own.raw)
        return Picture(own.frame, shared[:bands], None if own.clean is None else shared[bands:], own.glance)
