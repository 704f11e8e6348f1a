# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands still is rendered once: of each keyframe only what moved since an earlier one, the anchor, and where the
light changed with it (a shadow, a reflection), which is found at the rim of what moved and by strips across the
picture.
"""

from __future__ import annotations

import numpy as np

from .job import Job
from .judge import Judge
from .layers import Light
from .surfaces import Look, Seen
from .tiles import boxes, grown, tiles_with

ANCHOR_EVERY = 64  # keyframes
MOST = 0.7  # of the picture; more is rendered as a whole


class Frames:
    """Light of keyframes, before samples are shared. The result does not depend on which were asked for before."""

    def __init__(self, job: Job, light: Light, look: Look, judge: Judge):
        self._job, self._light, self._look, self._judge = job, light, look, judge
        self._anchor: tuple[float, np.ndarray, Seen] | None = None  # time, light before diffraction, what is seen

    def render(self, index: int, t_s: float, anchor_s: float) -> np.ndarray:
        """[bands, height, width] of keyframe `index`. anchor_s: when keyframe index - index % ANCHOR_EVERY is."""
        if self._anchor is None or self._anchor[0] != anchor_s:
            seen = self._look.seen(anchor_s)
            self._job.set_time(anchor_s)
            self._anchor = anchor_s, self._light.fresh(), seen
        _, still, there = self._anchor
        if t_s == anchor_s:
            return self._light.blur(still.copy())
        now = self._look.seen(t_s)
        self._job.set_time(t_s)
        changed = self._judge.strips_differing(
            self._job, self._light, index, lambda bands: self._judge.plane(still, bands)
        )
        frame, plane = still.copy(), self._judge.plane(still)
        more = grown(self._moved(there, now) | changed)
        done = np.zeros_like(more)
        while more.any():
            done |= more
            if done.mean() > MOST:
                return self._light.blur(self._light.fresh())
            fresh = self._light.fresh(boxes(more, *self._job.size))
            frame = np.where(np.isnan(fresh), frame, fresh)
            more = grown(self._judge.differing(plane, self._judge.plane(frame))) & ~done
        return self._light.blur(frame)

    def _moved(self, before: Seen, now: Seen) -> np.ndarray:
        """Tiles in which something was, or is, that stood elsewhere or is not known at the other instant."""
        surfaces = self._look.surfaces
        centres, moved = surfaces.centres(), np.zeros(before.depth.shape, bool)
        for seen, poses in ((before, now.poses), (now, before.poses)):
            moved |= ~(surfaces.place(seen, poses)[:2] == centres).all(0)
        return tiles_with(moved)
