# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the surface point goes that is seen at a pixel's centre: from an interval's start to its middle and end, and
from its end back (docs/exr_stack.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..job import Job
from ..surfaces import Poses, Seen, Surfaces

STILL_PX = 1e-4  # what moves less is still: rounding must not stir what stands


class Motion:
    name, unit, at = "motion", "px, z in m", "interval"
    channels = tuple(
        way + channel for way in ("", "back_") for channel in ("x_mid", "y_mid", "x_end", "y_end", "z", "z_end")
    )

    def __init__(self, job: Job, scratch: Path):
        self._job, self.surfaces = job, Surfaces(job, scratch, name="motion_rays")
        self._kept: dict[float, Seen] = {}
        self.keep = 1  # of the instants seen last; the next interval begins with one

    def render(self, begin_s: float, end_s: float) -> np.ndarray:
        first = self.seen(begin_s)
        self._job.set_time((begin_s + end_s) / 2)
        middle = self.surfaces.poses()
        last = self.seen(end_s)
        return np.concatenate([self._way(first, middle, last.poses), self._way(last, middle, first.poses)])

    def seen(self, t_s: float) -> Seen:
        """Moves the scene there, if it is not known."""
        if t_s not in self._kept:
            self._job.set_time(t_s)
            self._kept[t_s] = self.surfaces.seen()
            while len(self._kept) > self.keep:
                self._kept.pop(next(iter(self._kept)))
        return self._kept[t_s]

    def _way(self, seen: Seen, middle: Poses, end: Poses) -> np.ndarray:
        """Six channels."""
        places = self.surfaces.place(seen, middle), self.surfaces.place(seen, end)
        moves = np.concatenate([place[:2] for place in places]) - np.tile(self.surfaces.centres(), (2, 1, 1))
        moves[:, np.isnan(moves).any(0)] = np.nan
        moves[:, (np.hypot(moves[::2], moves[1::2]) < STILL_PX).all(0)] = 0
        z_end = np.where(np.isnan(moves[0]), np.nan, places[1][2])
        if self._job.moving_px:  # elsewhere the light is that of the start
            left, top, right, bottom = self._job.moving_px
            still = np.ones(seen.depth.shape, bool)
            still[top:bottom, left:right] = False
            moves[:, still], z_end[still] = 0, seen.depth[still]
        return np.concatenate([moves, [seen.depth, z_end]]).astype(np.float32)
