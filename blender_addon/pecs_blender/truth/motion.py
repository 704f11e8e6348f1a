# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion of the surface point at a pixel's centre: from an interval's start to its quarters and end, and from its end
back (docs/reference/exr_stack.md)."""

from __future__ import annotations

import numpy as np
from pecs.motion import CHANNELS, QUARTERS

from ..output import Layer
from .surfaces import HitCache, Poses, SurfaceHits

STILL_PX = 1e-4  # smaller motion is rounding, and set to 0


class Motion(Layer):
    name, unit, at = "motion", "px, z in m", "interval"
    channels = CHANNELS

    def __init__(self, hits: HitCache):
        self._stage, self._hits, self._surfaces = hits.stage, hits, hits.surfaces

    def render(self, begin_s: float, end_s: float) -> np.ndarray:
        first, between = self._hits.at(begin_s), []
        for fraction in QUARTERS[:-1]:
            self._stage.set_time(begin_s + float(fraction) * (end_s - begin_s))
            between.append(self._surfaces.poses())
        last = self._hits.at(end_s)
        there, back = self._way(first, [*between, last.poses]), self._way(last, [*between[::-1], first.poses])
        return np.concatenate([there, back])

    def through(self, first: SurfaceHits, last: SurfaceHits, t_s: float, part: float) -> np.ndarray:
        """As `render`, of even motion between two instants that is exact at a time between them, a part of the way."""
        poses, channels = self._hits.at(t_s).poses, []
        for seen, way in ((first, part), (last, 1 - part)):
            x, y, z, z_now = self._way(seen, [poses])
            with np.errstate(invalid="ignore"):  # the sky's depth
                z_end = np.where(np.isfinite(z), z + (z_now - z) / way, z_now)
            channels += [*(q / way * move for q in QUARTERS for move in (x, y)), z, z_end]
        return np.stack(channels).astype(np.float32)

    def _way(self, seen: SurfaceHits, poses: list[Poses]) -> np.ndarray:
        """Half of the channels, of the motion of `seen` to these poses."""
        places = [self._surfaces.place(seen, one) for one in poses]
        moves = np.concatenate([place[:2] - self._surfaces.sight.centres() for place in places])
        moves[:, np.isnan(moves).any(0)] = np.nan
        moves[:, (np.hypot(moves[::2], moves[1::2]) < STILL_PX).all(0)] = 0
        z_end = np.where(np.isnan(moves[0]), np.nan, places[-1][2])
        if self._stage.moving_px:  # the rest is still by definition
            left, top, right, bottom = self._stage.moving_px
            still = np.ones(seen.depth.shape, bool)
            still[top:bottom, left:right] = False
            moves[:, still], z_end[still] = 0, seen.depth[still]
        return np.concatenate([moves, [seen.depth, z_end]]).astype(np.float32)
