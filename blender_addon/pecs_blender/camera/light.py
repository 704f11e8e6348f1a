# SPDX-License-Identifier: GPL-3.0-or-later
"""Film irradiance, or radiance, in every band.

Radiance in Cycles is relative so that values are O(1): in band k every lamp is divided by the strongest lamp's value
n_k there (emitters.py). Absolute radiance = rendered * n_k * s, with s of the scene (Source.radiance_per_unit).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from pecs._errors import bad_input

from ..output import Layer
from ..scene import cycles
from ..scene.cycles import Sampling
from . import denoise
from . import lens as lenses
from .stage import Stage
from .tiles import Box, at, boxes

NEAR_PX = 1  # a pixel without light takes that of a lit one within this distance
BLUR_PX, HALO_PX = 8, 64  # around a part, diffraction uses light of the same instant, and further out of another
CALL_RAYS, GPU_CALL_RAYS = 2400, 6000  # of the camera: as slow as another call (street, 2 cores); not measured on a GPU
DENOISE_PX = 16  # around a part, the denoiser uses light of another instant


class Light(Layer):
    _is_lit = False
    name, unit, at = "light", "as stack.json's quantity", "instant"

    def __init__(self, stage: Stage, sampling: Sampling):
        """Sets samples and seed, and renders what is the same in every frame: lens normalisation and still parts.

        With `sampling.denoise` the samples of a pixel are rendered in two halves of one sequence, which are denoised
        alike: half of their difference has the standard deviation of the error that is left. A frame then has further
        channels: half the difference of the halves' bands (first minus second), and the denoiser's guides of each.

        Wherever a frame has bands, those of each group of `stage.lamps` follow (Judge.lit)."""
        scene = stage.source.scene
        self.channels = tuple(f"{nm:g} nm" for nm in stage.lambda_nm)
        self._stage, self._film = stage, stage.film(sampling.samples)
        self._around_px = BLUR_PX if any(one.blurs for one in stage.passes) else 0
        self._denoiser = denoise.Denoiser(sampling.threads) if sampling.denoise else None
        rays = replace(sampling, samples=sampling.samples * stage.rays_per_sample)
        scene.cycles.samples, scene.cycles.seed = rays.samples, rays.seed
        self._call_samples = rays.samples // 2 if sampling.denoise else rays.samples
        self._call_rays = CALL_RAYS if sampling.device == "CPU" else GPU_CALL_RAYS
        to_film = stage.unit[:, None, None]
        if stage.lens and not any(stage.lens.tilt_deg):  # tables of flat films
            to_film = to_film * lenses.even_out(stage.lens, stage.passes, stage.lambda_nm, stage.size, rays)
        to_film = np.tile(to_film.astype(np.float32), (1 + len(stage.lamps.names), 1, 1))
        self._dark = [_nearest(~np.isfinite(gain), NEAR_PX * stage.subpixels) for gain in to_film]
        self._to_film = np.broadcast_to(np.where(np.isfinite(to_film), to_film, 0), (len(to_film), *stage.size[::-1]))
        if stage.moving_px:  # with uniform steps only, which are not denoised
            stage.set_time(0.0)
            self._still = self.fresh()

    def render(self, t_s: float) -> np.ndarray:
        if not self._stage.moving_px:
            return self.blur(self.fresh())
        frame = self._still.copy()
        self.refresh(frame, [self._stage.moving_px])
        return self.blur(frame)

    def bands_of(self, frame: np.ndarray) -> np.ndarray:
        """The light of a frame, without its further channels."""
        return frame[: len(self._to_film)]

    def halves_of(self, frame: np.ndarray) -> np.ndarray:
        """Half the difference of the halves' bands of a frame, if it is denoised."""
        return frame[len(self._to_film) : 2 * len(self._to_film)]

    def filter_boxes(self, tiles: np.ndarray) -> list[Box]:
        """Boxes that cover the tiles, in the least time that `raw_parts` and `clean_parts` take: the denoiser's, which
        takes ten times as long as diffraction, if there is one."""
        return boxes(tiles, *self._stage.size, 0, DENOISE_PX if self._denoiser else HALO_PX)

    def fresh(self) -> np.ndarray:
        """[bands (and what __init__ lists), height, width] of the current instant, before diffraction."""
        bands, guides = len(self._to_film), denoise.CHANNELS * len(denoise.GUIDES)
        frame = np.empty((2 * (bands + guides) if self._denoiser else bands, *self._stage.size[::-1]), np.float32)
        self.refresh(frame, [(0, 0, *self._stage.size)])
        if not self._is_lit:
            self._is_lit = True  # once
            if not self.bands_of(frame).any():
                print("render: the first picture is black: no light reaches the camera", file=sys.stderr)
        return frame

    def refresh_tiles(self, frame: np.ndarray, tiles: np.ndarray, around: bool = False) -> list[Box]:
        """Renders the current instant into boxes of a frame that cover these tiles, and returns them. around: also what
        diffraction brings into them from around them."""
        around_px = self._around_px if around else 0
        boxes_px = boxes(tiles, *self._stage.size, self._call_rays / self._call_samples, around_px)
        self.refresh(frame, [self._grown(box, around_px) for box in boxes_px])
        return boxes_px

    def refresh(self, frame: np.ndarray, boxes_px: list[Box]) -> None:
        """Renders the current instant into these boxes of a frame that is as `fresh` returns it."""
        passes, bands = self._stage.passes, len(self._to_film)
        if self._denoiser:
            halves = self._rendered(passes, boxes_px, (0, self._call_samples), denoise.GUIDES)
            patches = [
                np.concatenate([(a[:bands] + b[:bands]) / 2, (a[:bands] - b[:bands]) / 2, a[bands:], b[bands:]])
                for a, b in zip(*halves, strict=True)
            ]
        else:
            (patches,) = self._rendered(passes, boxes_px)
        for box, patch in zip(boxes_px, patches, strict=True):
            frame[at(box)] = patch
        self._light_up(frame)  # also across the borders of boxes

    def glance(self) -> np.ndarray:
        """[bands, height, width] of the current instant, before diffraction, from the first sample of each pixel, which
        is the same at all instants unless something changed; 0 in other bands than those of the brightest pass."""
        size, weights = self._stage.size, self._stage.weights
        brightest = max(self._stage.passes, key=lambda one: weights[one.bands].sum())
        ((frame,),) = self._rendered((brightest,), [(0, 0, *size)], samples=1)
        np.nan_to_num(frame, copy=False)
        self._light_up(frame)
        return frame

    def _rendered(
        self,
        passes: tuple[lenses.Pass, ...],
        boxes_px: list[Box],
        firsts: tuple[int, ...] = (0,),
        guides: tuple[str, ...] = (),
        samples: int | None = None,
    ) -> list[list[np.ndarray]]:
        """[bands + guides, height, width] of each box, for each of the first samples: from it and the following ones,
        by default half of all if light is denoised. Guides are means over the passes."""
        scene, channels = self._stage.source.scene, len(self._to_film) + denoise.CHANNELS * len(guides)
        shapes = [(channels, bottom - top, right - left) for left, top, right, bottom in boxes_px]
        rendered = [[np.full(shape, np.nan, np.float32) for shape in shapes] for _ in firsts]
        for count, one in enumerate(passes, 1):
            camera = self._stage.camera_of(one)
            if scene.camera != camera:  # Blender builds its dependency graphs again: 130 ms in scenes/street
                scene.camera = camera
            self._stage.spectral.set_pass(one.channels)
            for first, patches in zip(firsts, rendered, strict=True):
                with cycles.sample_subset(scene, first, samples or self._call_samples):
                    pictures = self._film.parts(boxes_px, "Combined", *self._stage.lamps.names, *guides)
                    for box, patch, picture in zip(boxes_px, patches, pictures, strict=True):
                        self._keep(box, patch, one, picture, guides, count)
        return rendered

    def _keep(
        self, box: Box, patch: np.ndarray, one: lenses.Pass, pictures: dict, guides: tuple[str, ...], count: int
    ) -> None:
        """Puts the pictures of one pass, the count-th, into its bands of a patch and into the means of guides."""
        bands = len(self._to_film)
        for group, light in enumerate(_apart(pictures, self._stage.lamps.names)):
            own = slice(*(end + group * len(self.channels) for end in (one.bands.start, one.bands.stop)))
            patch[own] = light[: own.stop - own.start] * self._to_film[own][at(box)]
        for index, name in enumerate(guides):
            guide, new = patch[bands + denoise.CHANNELS * index :][: denoise.CHANNELS], pictures[name]
            guide[:] = new if count == 1 else guide + (new - guide) / count

    def clean(self, frame: np.ndarray) -> np.ndarray | None:
        """Denoised light of a frame or a part of one, before diffraction: [2 * bands, height, width], the light, and
        half the difference of the halves; None if nothing is denoised. The light is the mean of what the denoiser makes
        of all samples, which is blurred less, and of both halves, which varies less (docs/studies/keyframes.md)."""
        if not self._denoiser:
            return None
        bands = len(self._to_film)
        mean, difference, guides = np.split(frame, (bands, 2 * bands))
        of_first, of_second = np.split(guides, 2)
        first = self._denoiser(mean + difference, of_first, fast=True)
        second = self._denoiser(mean - difference, of_second, fast=True)
        both = self._denoiser(mean, (of_first + of_second) / 2)
        return np.concatenate([both / 2 + (first + second) / 4, (first - second) / 2])

    def _light_up(self, frame: np.ndarray) -> None:
        """Gives pixels for which no ray passes the lens a neighbour's light."""
        for picture, (dark, near) in zip(frame, self._dark, strict=False):  # further channels follow
            picture.ravel()[dark] = picture.ravel()[near]

    def blur(self, frame: np.ndarray) -> np.ndarray:
        """Applies diffraction to [bands, height, width], or to several of them one after the other, in place."""
        for first in range(0, len(frame), len(self.channels)):
            for one in self._stage.passes:
                for picture, blur in zip(frame[first:][one.bands], one.blurs, strict=False):  # none without diffraction
                    blur(picture)
        return frame

    def raw_parts(self, frame: np.ndarray, boxes_px: list[Box]) -> Iterator[tuple[Box, np.ndarray]]:
        """The light [bands, height, width] in these boxes of a frame, with diffraction."""
        for box in boxes_px:
            outer = self._grown(box, HALO_PX)
            yield box, self.blur(self.bands_of(frame)[at(outer)].copy())[at(box, outer)]

    def clean_parts(
        self, frame: np.ndarray, tiles: np.ndarray, around: np.ndarray, where: np.ndarray | None = None
    ) -> Iterator[tuple[Box, np.ndarray]]:
        """As `clean`, with diffraction: boxes that cover the tiles, and their light. around: [2 * bands, height,
        width], what diffraction uses around a box and, with `where` [height, width], where that is False. Nothing if
        nothing is denoised."""
        for box in self.filter_boxes(tiles) if self._denoiser else []:
            outer, inner = self._grown(box, HALO_PX), self._grown(box, DENOISE_PX)
            part, clean = around[at(outer)].copy(), self.clean(frame[at(inner)])
            part[at(inner, outer)] = clean if where is None else np.where(where[at(inner)], clean, around[at(inner)])
            yield box, self.blur(part)[at(box, outer)]

    def _grown(self, box: Box, by_px: int) -> Box:
        (left, top, right, bottom), (width, height) = box, self._stage.size
        return max(0, left - by_px), max(0, top - by_px), min(width, right + by_px), min(height, bottom + by_px)


def _apart(pictures: dict[str, np.ndarray], lamps: tuple[str, ...]) -> list[np.ndarray]:
    """The light of each group of lamps, behind all other light."""
    light, apart = pictures["Combined"][:3], [pictures[name][:3] for name in lamps]
    return [np.maximum(light - sum(apart), 0), *apart] if apart else [light]


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
    if lost := int((near < 0).sum()):
        got, wanted = f"{lost} pixels that no ray reaches", "a lens that covers the film, or more --samples"
        raise bad_input("render", "--lens", got, wanted)
    return at, near
