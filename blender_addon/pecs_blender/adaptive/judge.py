# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares pictures of one instant: which parts show different light, beyond their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.tiles import (
    BLOCK_PX,
    TILE_PX,
    Box,
    at,
    box_of,
    clearly_changed_blocks,
    differing_blocks,
    differing_tiles,
    of_blocks,
    tiles_of,
)

SAME_LIGHT = 0.02  # relative difference of light within which samples are averaged
SUSPECT_SIGMAS = 3.0  # low: leaving out a good sample costs little
MOST_NOISE = 0.99  # difference of the halves' photocurrents over their sum
LEFT_TO_GLANCES = 0.5  # of the tolerance; changes that interpolation follows so well are not rendered
AROUND_PX = 21  # side of the squares in which a difference is compared with noise, in rendered pixels


@dataclass(frozen=True)
class Judge:
    """Compares pictures of one instant as a chip sees them. weights: photocurrent per light in each band. tolerance: of
    ln(photocurrent). subpixels: per sensor pixel, in x and y."""

    weights: np.ndarray
    tolerance: float
    subpixels: int

    def lit(self, light: np.ndarray, factors: np.ndarray | tuple) -> np.ndarray:
        """[bands and further channels, height, width] at these strengths of lamps. light: bands without these lamps,
        bands of each group of lamps at its largest strength, and further channels."""
        if not len(factors):
            return light
        bands, apart = len(self.weights), len(factors) + 1
        parts = light[: apart * bands].reshape(apart, bands, *light.shape[1:])
        total = parts[0] + np.tensordot(factors.astype(np.float32), parts[1:], 1)
        return np.concatenate([total, light[apart * bands :]])

    def photocurrent(self, light: np.ndarray, factors: np.ndarray | tuple = ()) -> np.ndarray:
        """[height, width] of light [bands, height, width], or of light as in `lit` with its factors; further channels
        are ignored."""
        lit = self.lit(light, factors)[: len(self.weights)]
        return np.einsum("k,kyx->yx", self.weights.astype(np.float32), lit)

    def with_noise(self, clean: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """The light as Light.clean returns it, as [bands, height, width] of the mean of the halves, and in a further
        channel ln(photocurrent) of the first half minus that of the second, halved, at these strengths of lamps."""
        mean, difference = np.split(clean, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.divide(*(self.photocurrent(part, factors=factors) for part in (difference, mean)))
        noise = np.arctanh(np.clip(np.nan_to_num(share), -MOST_NOISE, MOST_NOISE))
        return np.concatenate([mean, np.where(np.isnan(mean[:1]), np.nan, noise).astype(np.float32)])

    def mixed(self, expected: np.ndarray, rendered: np.ndarray) -> np.ndarray:
        """`rendered`, with less noise where it shows what was expected. Both: [bands + 1, height, width], as
        `with_noise` returns them, `expected` with NaN where nothing is known.

        ln(rendered / expected) is split into its mean over the surroundings and the rest; of each the part is taken
        that the noise does not explain: 1 - noise^2 / difference^2, averaged over the surroundings (Wiener)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            difference = np.log(self.photocurrent(rendered) / self.photocurrent(expected))
        noise = rendered[-1] - expected[-1]
        known = np.isfinite(difference) & np.isfinite(noise)
        wide, wide_noise = _around_known(known, difference, noise)
        wide_share = _signal(wide, wide_noise)
        fine_share = _signal(np.where(known, difference - wide, 0), np.where(known, noise - wide_noise, 0))
        lifted, lowered = expected.copy(), rendered.copy()  # differ in the rest only
        lifted[:-1] *= np.exp(wide_share * wide)
        lowered[:-1] *= np.exp((wide_share - 1) * wide)
        return np.where(known, lifted + fine_share * (lowered - lifted), rendered).astype(np.float32)

    def differing(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Tiles [rows, columns] in which two photocurrents differ; NaN pixels are ignored."""
        return of_blocks(self.differing_blocks(a, b))

    def glances_differ(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """As `differing`, for pictures of one sample in each pixel."""
        return of_blocks(differing_blocks(a, b, self.tolerance, self.subpixels, few_samples=True))

    def same_samples_differ(self, same: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Blocks [rows, columns] in which clearly more pixels of two photocurrents are brighter than darker, or the
        other way round, of pixels [height, width] of which both have the same samples."""
        return clearly_changed_blocks(np.where(same, a, np.nan), b)

    def differing_blocks(self, a: np.ndarray, b: np.ndarray, halves: np.ndarray | None = None) -> np.ndarray:
        """Blocks [rows, columns] in which two photocurrents differ. halves: half the difference of the halves of
        b's samples."""
        return differing_blocks(a, b, self.tolerance, self.subpixels, halves=halves)

    def differing_in(
        self, boxes_px: list[Box], same: np.ndarray, a: np.ndarray, b: np.ndarray, halves: np.ndarray | None = None
    ) -> np.ndarray:
        """As `differing_blocks` and `same_samples_differ`, in these boxes of tiles; False elsewhere. The pictures are
        read up to a tile beyond."""
        out = np.zeros(tiles_of(*a.shape[::-1], BLOCK_PX), bool)
        for left, top, right, bottom in boxes_px:
            x, y = max(0, left - TILE_PX), max(0, top - TILE_PX)
            part = np.s_[y : bottom + TILE_PX, x : right + TILE_PX]
            differing = self.differing_blocks(a[part], b[part], None if halves is None else halves[part])
            differing |= self.same_samples_differ(same[part], a[part], b[part])
            inner = box_of((left, top, right, bottom), BLOCK_PX)
            out[at(inner)] = differing[at(inner, (x // BLOCK_PX, y // BLOCK_PX))]
        return out

    def interpolable(self, a: np.ndarray, b: np.ndarray, path_px: float) -> np.ndarray:
        """Photocurrent a [height, width], with the part of ln(b / a) that interpolation between them follows. Where a
        surface moves through shading, or shading over a surface, by up to path_px, ln(b / a) is the difference of
        ln(shading) over the path, and interpolation is wrong by an eighth of the path times the slope of that."""
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.log(b / a)
        (change,) = _around_known(np.isfinite(change), change)
        error = path_px / 8 * _slope(change)
        return np.where(error <= LEFT_TO_GLANCES * self.tolerance, a * np.exp(change), a).astype(np.float32)

    def same_light(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Tiles [rows, columns] in which two photocurrents are samples of the same light, within their noise."""
        return ~(self.differing(a, b) | differing_tiles(a, b, SAME_LIGHT, self.subpixels, SUSPECT_SIGMAS))


def _around(values: np.ndarray) -> np.ndarray:
    """Means over the squares around the pixels; 0 outside."""
    n = AROUND_PX
    padded = np.pad(values.astype(np.float64), ((n // 2 + 1, n // 2), (n // 2 + 1, n // 2)))
    total = padded.cumsum(0).cumsum(1)
    return (total[n:, n:] - total[n:, :-n] - total[:-n, n:] + total[:-n, :-n]) / n**2


def _around_known(known: np.ndarray, *pictures: np.ndarray) -> list[np.ndarray]:
    """Means over the known pixels in the squares around the pixels; 0 where there are none."""
    share = np.maximum(_around(known), 1 / AROUND_PX**2)
    return [_around(np.where(known, values, 0)) / share for values in pictures]


def _slope(values: np.ndarray) -> np.ndarray:
    """Slope per pixel of means over AROUND_PX, between pixels that share few of them."""
    n = AROUND_PX // 2
    padded = np.pad(values, n, mode="edge")
    return np.hypot(padded[n:-n, 2 * n :] - padded[n:-n, : -2 * n], padded[2 * n :, n:-n] - padded[: -2 * n, n:-n]) / (
        2 * n
    )


def _signal(difference: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Share of a difference that is not noise."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.clip(1 - _around(noise**2) / _around(difference**2), 0, 1))
