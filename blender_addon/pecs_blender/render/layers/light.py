# SPDX-License-Identifier: GPL-3.0-or-later
"""Film irradiance, or radiance, in every band.

Radiance in Cycles is relative so that values are O(1): in band k every lamp is divided by the strongest lamp's value
n_k there (emitters.py). Absolute radiance = rendered * n_k * s, with s of the scene (Source.radiance_per_unit).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from pecs._errors import bad_input

from .. import cycles, denoise
from .. import lens as lenses
from ..plan import Sampling
from ..stage import Stage
from ..tiles import Box, boxes
from .layer import Layer

NEAR_PX = 1  # a pixel without light takes that of a lit one within this distance
BLUR_PX, HALO_PX = 16, 64  # around a part, diffraction uses light of the same instant, and further out of another
CALL_RAYS = 6500  # of the camera, in the time that a render takes besides rays: 37 ms of 5.8 us (street, 2 cores)
DENOISE_PX = 32  # around a part, the denoiser uses light of another instant


class Light(Layer):
    name, unit, at = "light", "as stack.json's quantity", "instant"

    def __init__(self, stage: Stage, sampling: Sampling):
        """Sets samples and seed, and renders what is the same in every frame: lens normalisation and still parts.

        With `sampling.denoise` the samples of a pixel are rendered in two halves of one sequence, which are denoised
        alike: half of their difference has the standard deviation of the error that is left. A frame then has further
        channels: half the difference of the halves' bands (first minus second), and the denoiser's guides of each."""
        scene = stage.source.scene
        self.channels = tuple(f"{nm:g} nm" for nm in stage.lambda_nm)
        self._stage, self._film = stage, cycles.Film(scene)
        self._denoiser = denoise.Denoiser(sampling.threads) if sampling.denoise else None
        rays = replace(sampling, samples=sampling.samples * stage.rays_per_sample)
        scene.cycles.samples, scene.cycles.seed, self._samples = rays.samples, rays.seed, rays.samples
        to_film = stage.unit[:, None, None]
        if stage.lens and not any(stage.lens.tilt_deg):  # tables of flat films
            to_film = to_film * lenses.even_out(stage.lens, stage.passes, stage.lambda_nm, stage.size, rays)
        to_film = to_film.astype(np.float32)
        self._dark = [_nearest(~np.isfinite(gain), NEAR_PX * stage.subpixels) for gain in to_film]
        self._to_film = np.broadcast_to(np.where(np.isfinite(to_film), to_film, 0), (len(to_film), *stage.size[::-1]))
        if stage.moving_px:  # with uniform steps only, which are not denoised
            stage.set_time(0.0)
            self._still = self.fresh()

    def render(self, t_s: float) -> np.ndarray:
        if not self._stage.moving_px:
            return self.blur(self.fresh())
        left, top, right, bottom = self._stage.moving_px
        fresh, frame = self.fresh([self._stage.moving_px]), self._still.copy()
        frame[:, top:bottom, left:right] = fresh[:, top:bottom, left:right]
        self._light_up(frame)  # across the border of the box
        return self.blur(frame)

    def boxes(self, tiles: np.ndarray) -> list[Box]:
        """Boxes that cover the tiles, in the least time that `fresh` takes."""
        return boxes(tiles, *self._stage.size, CALL_RAYS / (self._samples // 2 if self._denoiser else self._samples))

    def fresh(self, boxes_px: list[Box] | None = None) -> np.ndarray:
        """[bands (and what __init__ lists), height, width] of the current instant in these boxes (None: everywhere),
        before diffraction; NaN elsewhere."""
        passes = range(len(self._stage.passes))
        if not self._denoiser:
            frame = self._rendered(passes, boxes_px)
        else:
            half, bands = self._samples // 2, len(self._to_film)
            halves = []
            for first in (0, half):
                with cycles.sample_subset(self._stage.source.scene, first, half):
                    halves.append(self._rendered(passes, boxes_px, denoise.GUIDES))
            a, b = (one[:bands] for one in halves)
            frame = np.concatenate([(a + b) / 2, (a - b) / 2, *(one[bands:] for one in halves)])
        self._light_up(frame)
        return frame

    def strips(self, boxes_px: list[Box], which: int) -> np.ndarray:
        """[bands, height, width] of one pass of the current instant in these boxes, before diffraction; NaN
        elsewhere."""
        frame = self._rendered(range(which, which + 1), boxes_px)
        self._light_up(frame)
        return frame

    def _rendered(self, passes: range, boxes_px: list[Box] | None, guides: tuple[str, ...] = ()) -> np.ndarray:
        """[bands + guides, height, width]; guides are means over the passes."""
        (width, height), scene, bands = self._stage.size, self._stage.source.scene, len(self._to_film)
        frame = np.full((bands + denoise.CHANNELS * len(guides), height, width), np.nan, np.float32)
        for count, one in enumerate((self._stage.passes[k] for k in passes), 1):
            if self._stage.lens:
                scene.camera = one.camera
            self._stage.spectral.set_pass(one.channels)
            for box in [(0, 0, width, height)] if boxes_px is None else boxes_px:
                cycles.set_border(scene, box if boxes_px else None)
                at = (slice(box[1], box[3]), slice(box[0], box[2]))
                pictures = self._film.passes("Combined", *guides)
                picture = pictures["Combined"][: one.bands.stop - one.bands.start, at[0], at[1]]
                frame[one.bands, at[0], at[1]] = picture * self._to_film[one.bands, at[0], at[1]]
                for first, name in enumerate(guides):
                    guide = frame[bands + denoise.CHANNELS * first :][: denoise.CHANNELS, at[0], at[1]]
                    new = pictures[name][:, at[0], at[1]]
                    guide[:] = new if count == 1 else guide + (new - guide) / count
        cycles.set_border(scene, None)
        return frame

    def clean(self, frame: np.ndarray, fast: bool = False) -> np.ndarray | None:
        """Denoised light of a frame or a part of one, before diffraction: [2 * bands, height, width], that of all
        samples, and half the difference of the halves; None if nothing is denoised."""
        if not self._denoiser:
            return None
        bands = len(self._to_film)
        mean, difference, guides = np.split(frame, (bands, 2 * bands))
        of_first, of_second = np.split(guides, 2)
        first = self._denoiser(mean + difference, of_first, fast=True)
        second = self._denoiser(mean - difference, of_second, fast=True)
        both = (first + second) / 2 if fast else self._denoiser(mean, (of_first + of_second) / 2)
        return np.concatenate([both, (first - second) / 2])

    def _light_up(self, frame: np.ndarray) -> None:
        """Gives pixels for which no ray passes the lens a neighbour's light."""
        for picture, (dark, near) in zip(frame, self._dark, strict=False):  # further channels follow
            picture.ravel()[dark] = picture.ravel()[near]

    def blur(self, frame: np.ndarray) -> np.ndarray:
        """Applies diffraction to [bands, height, width], or to several of them one after the other, in place."""
        for first in range(0, len(frame), len(self._to_film)):
            for one in self._stage.passes:
                for picture, blur in zip(frame[first:][one.bands], one.blurs, strict=False):  # none without diffraction
                    blur(picture)
        return frame

    def parts(self, boxes_px: list[Box], under: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Renders the current instant in these boxes: the frame, NaN elsewhere, and its light [bands, height, width]
        with diffraction. under: frame of another instant, which diffraction uses around the boxes."""
        bands = len(self._to_film)
        if not any(one.blurs for one in self._stage.passes):
            frame = self.fresh(boxes_px)
            return frame, frame[:bands]
        frame = self.fresh([self._grown(box, BLUR_PX) for box in boxes_px])
        return frame, self._in_boxes(_over(under[:bands], frame[:bands]), boxes_px)

    def clean_parts(self, boxes_px: list[Box], frame: np.ndarray, under: np.ndarray) -> np.ndarray | None:
        """As `clean`, with diffraction, of a frame that was rendered in these boxes, NaN elsewhere. under: frame of
        another instant, which denoiser and diffraction use around the boxes."""
        if not self._denoiser:
            return None
        corners = np.array([self._grown(box, DENOISE_PX) for box in boxes_px])
        (left, top), (right, bottom) = corners[:, :2].min(0), corners[:, 2:].max(0)
        around = _over(under, frame)
        clean = around[: 2 * len(self._to_film)].copy()
        clean[:, top:bottom, left:right] = self.clean(around[:, top:bottom, left:right], fast=True)
        return self._in_boxes(clean, boxes_px)

    def _in_boxes(self, light: np.ndarray, boxes_px: list[Box]) -> np.ndarray:
        """Light with diffraction in the boxes, NaN elsewhere."""
        result = np.full_like(light, np.nan)
        for box in boxes_px:
            left, top, right, bottom = self._grown(box, HALO_PX)
            part = self.blur(np.ascontiguousarray(light[:, top:bottom, left:right]))
            x, y = slice(box[0] - left, box[2] - left), slice(box[1] - top, box[3] - top)
            result[:, box[1] : box[3], box[0] : box[2]] = part[:, y, x]
        return result

    def _grown(self, box: Box, by_px: int) -> Box:
        (left, top, right, bottom), (width, height) = box, self._stage.size
        return max(0, left - by_px), max(0, top - by_px), min(width, right + by_px), min(height, bottom + by_px)


def _over(under: np.ndarray, frame: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(frame), under, frame)


def _nearest(dark: np.ndarray, reach_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the dark pixels of [height, width], and of the nearest lit pixel of each."""
    at = np.flatnonzero(dark)
    if not at.size:
        return at, at
    (y, x), near = np.divmod(at, dark.shape[1]), np.full(at.size, -1)
    steps = sorted(product(range(-reach_px, reach_px + 1), repeat=2), key=lambda step: step[0] ** 2 + step[1] ** 2)
    for dy, dx in steps:
        v, u = np.clip(y + dy, 0, dark.shape[0] - 1), np.clip(x + dx, 0, dark.shape[1] - 1)
        near = np.where((near < 0) & ~dark[v, u], v * dark.shape[1] + u, near)
    if (near < 0).any():
        raise bad_input("render", "--samples", "too few", "more, since in some pixels no ray passes the lens")
    return at, near
