# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion of the surface point at a pixel's centre: from an interval's start to its middle and end, and from its end
back (docs/reference/exr_stack.md)."""

from __future__ import annotations

import numpy as np

from ..surfaces import HitCache, Poses, SurfaceHits
from .layer import Layer

STILL_PX = 1e-4  # smaller motion is rounding, and set to 0


class Motion(Layer):
    name, unit, at = "motion", "px, z in m", "interval"
    channels = tuple(
        way + channel for way in ("", "back_") for channel in ("x_mid", "y_mid", "x_end", "y_end", "z", "z_end")
    )

    def __init__(self, hits: HitCache):
        self._stage, self._hits, self._surfaces = hits.stage, hits, hits.surfaces

    def render(self, begin_s: float, end_s: float) -> np.ndarray:
        first = self._hits.at(begin_s)
        self._stage.set_time((begin_s + end_s) / 2)
        middle = self._surfaces.poses()
        last = self._hits.at(end_s)
        return np.concatenate([self._way(first, middle, last.poses), self._way(last, middle, first.poses)])

    def _way(self, seen: SurfaceHits, middle: Poses, end: Poses) -> np.ndarray:
        """Six channels, of the motion from `seen` through `middle` to `end`."""
        places = self._surfaces.place(seen, middle), self._surfaces.place(seen, end)
        moves = np.concatenate([place[:2] for place in places]) - np.tile(self._surfaces.centres(), (2, 1, 1))
        moves[:, np.isnan(moves).any(0)] = np.nan
        moves[:, (np.hypot(moves[::2], moves[1::2]) < STILL_PX).all(0)] = 0
        z_end = np.where(np.isnan(moves[0]), np.nan, places[1][2])
        if self._stage.moving_px:  # the rest is still by definition
            left, top, right, bottom = self._stage.moving_px
            still = np.ones(seen.depth.shape, bool)
            still[top:bottom, left:right] = False
            moves[:, still], z_end[still] = 0, seen.depth[still]
        return np.concatenate([moves, [seen.depth, z_end]]).astype(np.float32)
