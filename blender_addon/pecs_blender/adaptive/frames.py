# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive steps: keyframes, the motion between them, and pictures between keyframes (docs/reference/motion.md).

A keyframe is complete when its layers are written, the light last; the interval after it is complete when its motion is
written, which follows the pictures between.

The light that is written is denoised. Decisions (what changed, which samples are shared, what is rendered between) are
made on the light as rendered: a denoiser's error has no known distribution, that of samples has.
"""

from __future__ import annotations

import numpy as np
import pecs
from pecs.motion import CHANNELS

from ..camera.light import Light
from ..camera.stage import Stage
from ..output import Layer, Output
from ..truth.surfaces import HitCache, Recent
from .between import Between, KeyframeInterval
from .changed import ChangedParts, Picture
from .judge import Judge
from .keyframes import Keyframes
from .sharing import average_samples

SHARED = 2  # keyframes on each side whose samples are shared
ANCHOR_EVERY = 64  # keyframes; at a cut, too

# Motion as written: its files are a third as large as without rounding
MOTION_STEP_PX = 2.0**-10
DEPTH_BITS = 16  # of the 23 bits of a mantissa


def _rounded(motion: np.ndarray) -> np.ndarray:
    """Rounds CHANNELS in place, and returns them."""
    unit = 1 << (23 - DEPTH_BITS)
    for name, plane in zip(CHANNELS, motion, strict=True):
        if name.removeprefix("back_") in ("z", "z_end"):
            bits = plane.view(np.int32)
            bits += unit // 2
            bits &= -unit
        else:
            np.rint(plane / MOTION_STEP_PX, out=plane)
            plane *= MOTION_STEP_PX
    return motion


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
        output: Output,
    ):
        self._stage, self._keyframes, self._hits, self._output = stage, keyframes, hits, output
        self._motion = next(layer for layer in layers if layer.name == "motion")
        self._instant_layers = [layer for layer in layers if layer.at == "instant"]
        self._judge = Judge(stage.weights, tolerance, stage.subpixels)
        self._changes = ChangedParts(stage, light, hits, self._judge)
        self._grid_s = [t * 1e-9 for t in keyframes.grid.bounds_ns]
        self._light = light
        self._cameras = [stage.source.camera_at(keyframes.time_s(i)) for i in range(len(keyframes.keys))]
        self._anchors: list[int] = []
        for i, camera in enumerate(self._cameras):
            begins = i % ANCHOR_EVERY == 0 or camera != self._cameras[i - 1]
            self._anchors.append(i if begins else self._anchors[-1])
        self._own: dict[int, Picture] = {}  # before samples are shared
        self._shared: Recent[Picture] = Recent(3)
        hits.keep(2 * SHARED + 2)

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
        start, end = self._keyframes.keys[index], self._keyframes.ends[index]
        second = self.keyframe((index + 1) % len(self._keyframes.keys))
        motion = _rounded(self._motion.render(self._keyframes.time_s(index), self._grid_s[end]))
        if end - start > 1:
            ends_px = motion[[CHANNELS.index(name) for name in ("x_end", "y_end", "back_x_end", "back_y_end")]]
            interval = KeyframeInterval(
                index=index,
                start=start,
                end=end,
                first=first,
                second=second,
                carrier=pecs.Carrier(motion),
                path_px=float(np.nanmax(np.hypot(ends_px[::2], ends_px[1::2]), initial=0)),
            )
            Between(self._stage, self._light, self._judge, self._output, self._grid_s, interval).refine()
        self._output.write_layer("motion", index, motion)

    def keyframe(self, index: int) -> Picture:
        """A keyframe after sample sharing."""
        return self._shared.get(index, self._share_samples)

    def _share_samples(self, index: int) -> Picture:
        """Averages a keyframe with its neighbours, each warped to the keyframe's instant, where they show the same
        surface in the same light.

        All frames have the same seed, so noise stays where it is on the film while surfaces move: it averages out where
        something moves, and still parts stay bit-identical.
        """
        count, periodic = len(self._keyframes.keys), self._keyframes.grid.period_ns
        near = range(index - SHARED, index + SHARED + 1)
        near = [i % count if periodic else i for i in near]
        near = list(dict.fromkeys(i for i in near if 0 <= i < count and self._cameras[i] == self._cameras[index]))
        at_ends = {*range(SHARED), *range(count - SHARED, count)} if periodic else set()
        self._own = {i: own for i, own in self._own.items() if i in near or i in at_ends}
        time_s = self._keyframes.time_s
        for i in near:
            if i not in self._own:
                self._own[i] = self._changes.render(i, time_s(i), time_s(self._anchors[i]))
        if len(near) == 1:
            return self._own[index]
        hits = {i: self._hits.at(time_s(i)) for i in near}
        own, factors = self._own[index], self._stage.lamps.factors(time_s(index))
        neighbours = [(self._own[i].light, hits[i]) for i in near if i != index]
        shared = average_samples(own.light, hits[index], neighbours, self._hits.surfaces, self._judge, factors)
        bands = len(own.raw)
        return Picture(own.frame, shared[:bands], None if own.clean is None else shared[bands:])
