# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders a keyframe only where its light differs from an earlier keyframe's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.light import Light
from ..camera.stage import Stage
from ..camera.tiles import BLOCK_PX, at, grown, of_blocks, pixels_of, tiles_with
from ..truth.surfaces import HitCache, SurfaceHits
from .judge import Judge

MAX_CHANGED = 0.7  # of the picture; beyond it the whole picture is rendered


@dataclass(frozen=True)
class Picture:
    """frame: as Light.fresh renders it, before diffraction. raw: its bands with diffraction. clean: the same after
    denoising, and the noise that is left (Judge.with_noise); None if nothing is denoised. glance: as Light.glance
    renders it. Judge.lit gives each at the lamps' strengths of a time."""

    frame: np.ndarray
    raw: np.ndarray
    clean: np.ndarray | None
    glance: np.ndarray

    @property
    def light(self) -> np.ndarray:
        """Raw and clean, one after the other."""
        return self.raw if self.clean is None else np.concatenate([self.raw, self.clean])

    @property
    def written(self) -> np.ndarray:
        return self.raw if self.clean is None else self.clean


@dataclass(frozen=True)
class Anchor:
    """A keyframe: its frame, this denoised (both before diffraction), its picture and its hits."""

    t_s: float
    frame: np.ndarray
    clean: np.ndarray | None
    picture: Picture
    hits: SurfaceHits


class ChangedParts:
    """Renders a keyframe's light only where something moved since an earlier keyframe, the anchor, or where the light
    changed (a shadow, a reflection, a material). Such changes are found at the border of what moved and by one sample
    of each pixel. The result does not depend on which keyframes were rendered before."""

    def __init__(self, stage: Stage, light: Light, hits: HitCache, judge: Judge):
        self._stage, self._light, self._hits, self._judge = stage, light, hits, judge
        self._anchor: Anchor | None = None

    def render(self, t_s: float, anchor_s: float) -> Picture:
        """The keyframe at t_s. anchor_s: time of its anchor."""
        if self._anchor is None or self._anchor.t_s != anchor_s:
            hits = self._hits.at(anchor_s)
            self._stage.set_time(anchor_s)
            frame, clean = self._whole()
            picture = self._picture(frame, clean, self._light.glance())
            self._anchor = Anchor(anchor_s, frame, clean, picture, hits)
        if t_s == anchor_s:
            return self._anchor.picture
        now = self._hits.at(t_s)
        self._stage.set_time(t_s)
        glance = self._light.glance()
        frame = self._refreshed(self._anchor, now, glance)
        return self._picture(*self._whole(), glance) if frame is None else self._merged(self._anchor, frame, glance)

    def _refreshed(self, anchor: Anchor, now: SurfaceHits, glance: np.ndarray) -> np.ndarray | None:
        """The anchor's frame with the current light where it changed; None if that is most of the picture."""
        judge, factors, surfaces = self._judge, self._stage.factors, self._hits.surfaces
        moving = surfaces.moved(anchor.hits, now.poses) | surfaces.moved(now, anchor.hits.poses)
        moved = tiles_with(moving)
        if grown(moved).mean() > MAX_CHANGED:
            return None
        glances = [judge.photocurrent(one, factors) for one in (anchor.picture.glance, glance)]
        changed = judge.glances_differ(*glances) | of_blocks(judge.same_samples_differ(~moving, *glances))
        frame, more = anchor.frame.copy(), grown(moved | changed)
        before = judge.photocurrent(self._light.bands_of(anchor.frame), factors=factors)
        done = np.zeros_like(more)
        while more.any():
            done |= more
            if done.mean() > MAX_CHANGED:
                return None
            self._light.refresh_tiles(frame, more)
            after = judge.photocurrent(self._light.bands_of(frame), factors=factors)
            more = of_blocks(grown(judge.differing_blocks(before, after))) & ~done
        return frame

    def _merged(self, anchor: Anchor, frame: np.ndarray, glance: np.ndarray) -> Picture:
        """The anchor's values where no sample of a block changed: still parts stay bit-identical."""
        different = pixels_of(tiles_with((frame != anchor.frame).any(0), BLOCK_PX), self._stage.size, BLOCK_PX)
        reached = grown(tiles_with(different))  # by diffraction
        own = anchor.picture
        raw, clean = own.raw.copy(), None if own.clean is None else own.clean.copy()
        for box, part in self._light.raw_parts(frame, self._light.filter_boxes(reached)):
            raw[at(box)] = part
        for box, part in self._light.clean_parts(frame, reached, anchor.clean, different):
            clean[at(box)] = self._judge.with_noise(part, self._stage.factors)
        return Picture(frame, raw, clean, glance)

    def _whole(self) -> tuple[np.ndarray, np.ndarray | None]:
        """The current instant: its frame, and this denoised, both before diffraction."""
        frame = self._light.fresh()
        return frame, self._light.clean(frame)

    def _picture(self, frame: np.ndarray, clean: np.ndarray | None, glance: np.ndarray) -> Picture:
        raw, factors = self._light.blur(self._light.bands_of(frame).copy()), self._stage.factors
        noisy = None if clean is None else self._judge.with_noise(self._light.blur(clean.copy()), factors)
        return Picture(frame, raw, noisy, glance)
