# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiles in which two pictures of one instant differ beyond noise, and rectangles that cover them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import product

import numpy as np

TILE_PX = 16
BLOCK_PX = 4
EDGE_PX = 0.15  # tolerated shift of an edge, in sensor pixels
SIGMAS = 4.0
OF_HALVES = 2.0  # a difference counts beyond this times half the difference of the halves
LIKE_NEIGHBOURS = 3.0  # limit of a block's scatter, relative to its neighbours; more is not noise
CLEAR, CLEAR_PX = 0.5, 6  # change of a pixel, relative to the mean; pixels of a block that change so in one way
CALL_PX = 20000  # as slow as another call of numpy's functions

Box = tuple[int, int, int, int]  # left, top, right, bottom


def at(box: Box, origin: tuple[int, ...] = (0, 0)) -> tuple:
    """Index of a box in pictures [..., height, width] whose first pixel is `origin`, x and y."""
    x, y = origin[:2]
    return ..., slice(box[1] - y, box[3] - y), slice(box[0] - x, box[2] - x)


def box_of(box: Box, side: int) -> Box:
    """The same box counted in squares of this side, which it meets."""
    return box[0] // side, box[1] // side, -(-box[2] // side), -(-box[3] // side)


def part_boxes(tiles: np.ndarray, width: int, height: int) -> list[Box]:
    """Boxes that cover the tiles, for work on arrays."""
    return boxes(tiles, width, height, CALL_PX, TILE_PX)


def tiles_of(width: int, height: int, side: int = TILE_PX) -> tuple[int, int]:
    """Rows and columns."""
    return -(-height // side), -(-width // side)


def of_blocks(blocks: np.ndarray) -> np.ndarray:
    """Tiles [rows, columns] that contain any of the blocks."""
    return _blocks(blocks, TILE_PX // BLOCK_PX).any(-1)


def differing_tiles(a: np.ndarray, b: np.ndarray, tolerance: float, subpixels: float, sigmas: float) -> np.ndarray:
    """Tiles [rows, columns] whose means differ: more sensitive than blocks."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all-NaN slices
        a, b = (np.nanmean(_blocks(v), -1) for v in (a, b))
    return differing_blocks(a, b, tolerance, subpixels / BLOCK_PX, sigmas)


def differing_blocks(
    a: np.ndarray,
    b: np.ndarray,
    tolerance: float,
    subpixels: float,
    sigmas: float = SIGMAS,
    halves: np.ndarray | None = None,
    few_samples: bool = False,
) -> np.ndarray:
    """Blocks whose light differs by more than `tolerance` times itself plus a shift of its edges by EDGE_PX, and by
    more than `sigmas` times the scatter within blocks. a, b: [height, width] with `subpixels` per sensor pixel in x and
    y; NaN pixels are ignored. halves: half the difference of the halves of b's samples, from which the noise of blocks
    and their neighbours also follows; a bright path in one of them does not count. few_samples: a block may have more
    noise than its neighbours, such as a bright path."""
    d = b - a
    mean = (np.where(np.isnan(a), b, a) + np.where(np.isnan(b), a, b)) / 2
    down, right = np.gradient(np.nan_to_num(mean))
    allowed = tolerance * np.abs(mean) + EDGE_PX * subpixels * np.hypot(down, right)
    d = _blocks(d)
    known = np.isfinite(d)
    n = known.sum(-1)
    d = np.where(known, d, 0)
    total = d.sum(-1)
    scatter = np.sqrt(np.maximum((d**2).sum(-1) - total**2 / np.maximum(n, 1), 0) * n / np.maximum(n - 1, 1))
    limit = np.where(known, _blocks(allowed), 0).sum(-1)
    different = (n >= BLOCK_PX) & (np.abs(total) > limit)
    usual = LIKE_NEIGHBOURS * _of_neighbours(np.where(n >= BLOCK_PX, scatter, np.nan), different, np.nanmedian)
    noise = scatter[different] if few_samples else np.minimum(scatter[different], usual)
    different[different] = np.abs(total[different]) > sigmas * noise
    if halves is not None:
        noise = np.abs(np.where(known, _blocks(halves), 0).sum(-1))
        usual = _of_neighbours(np.where(n >= BLOCK_PX, noise**2, np.nan), different, np.nanmean) ** 0.5
        different[different] = np.abs(total[different]) > np.maximum(sigmas * usual, OF_HALVES * noise[different])
    return different


def clearly_changed_blocks(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Blocks in which, or in the square half a block further on, at least CLEAR_PX more pixels became clearly brighter
    than darker, or the other way round, such as in a thin shadow. a, b: from the same samples; NaN pixels are ignored.
    `differing_blocks` takes a change of up to half of a block for noise."""
    with np.errstate(invalid="ignore"):
        change = np.where(np.abs(b - a) > CLEAR / 2 * (a + b), np.sign(b - a), 0)
    most = np.zeros(tiles_of(*change.shape[::-1], BLOCK_PX))
    for y, x in product((0, BLOCK_PX // 2), repeat=2):
        net = np.abs(np.nansum(_blocks(change[y:, x:]), -1))
        part = most[: net.shape[0], : net.shape[1]]
        np.maximum(part, net, out=part)
    changed = most >= CLEAR_PX
    usual = _of_neighbours(np.nansum(_blocks(np.abs(change)), -1), changed, np.median)
    changed[changed] = most[changed] >= SIGMAS * np.sqrt(usual)
    return changed


def changed_blocks(a: np.ndarray, b: np.ndarray, tolerance: float) -> np.ndarray:
    """Blocks in which the pixels of two pictures [height, width] from the same samples differ, in the mean by more than
    `tolerance` of a."""
    return np.nansum(_blocks(np.abs(b - a)), -1) > tolerance * np.nansum(_blocks(a), -1)


def _blocks(values: np.ndarray, side: int = BLOCK_PX) -> np.ndarray:
    """[rows of blocks, columns of blocks, pixels]; pixels outside the picture are NaN or False."""
    rows, columns = (-(-n // side) for n in values.shape)
    padded = np.full((rows * side, columns * side), False if values.dtype == bool else np.nan, values.dtype)
    padded[: values.shape[0], : values.shape[1]] = values
    return padded.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows, columns, -1)


def _of_neighbours(values: np.ndarray, where: np.ndarray, mean: Callable) -> np.ndarray:
    """A mean, without NaN, of each value that is wanted and its 24 neighbours."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, mode="edge"), (5, 5))
    return mean(around[where].reshape(-1, 25), axis=1)


def tiles_with(pixels: np.ndarray, side: int = TILE_PX) -> np.ndarray:
    """Tiles that contain any of the pixels [height, width]."""
    return _blocks(pixels, side).any(-1)


def tiles_under(places: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Tiles in which these places [2, n], x and y in pixels, lie; NaN is ignored. size: width, height."""
    tiles = np.zeros(tiles_of(*size), bool)
    tiles[_square_of(places, tiles, TILE_PX)[1]] = True
    return tiles


def in_blocks(places: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """[...]: whether these places [2, ...], x and y in pixels, lie in the blocks; NaN lies in none."""
    inside, at = _square_of(places, blocks, BLOCK_PX)
    inside[inside] = blocks[at]
    return inside


def _square_of(places: np.ndarray, squares: np.ndarray, side: int) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Which places lie in the picture, and the indices of their squares."""
    (x, y), (rows, columns) = places / side, squares.shape
    inside = (x >= 0) & (y >= 0) & (x < columns) & (y < rows)
    return inside, (y[inside].astype(int), x[inside].astype(int))


def pixels_of(tiles: np.ndarray, size: tuple[int, int], side: int = TILE_PX) -> np.ndarray:
    """Pixels [height, width] of the tiles; size: width, height."""
    return tiles.repeat(side, 0).repeat(side, 1)[: size[1], : size[0]]


def faded(tiles: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels [height, width]: 1 in the tiles, and 0 in others, to which it falls over half a tile, so that borders of
    tiles are not seen in what is weighted with it; size: width, height."""
    others = np.pad(~tiles, 1)
    others = others[:-1] | others[1:]
    weights = (~(others[:, :-1] | others[:, 1:])).astype(np.float32)  # of corners of tiles
    for axis, length in enumerate(size[::-1]):
        place = (np.arange(length) + 0.5) / TILE_PX
        low, part = place.astype(int), np.expand_dims((place % 1).astype(np.float32), 1 - axis)
        weights = weights.take(low, axis) * (1 - part) + weights.take(low + 1, axis) * part
    return np.minimum(1, 2 * weights)


def grown(tiles: np.ndarray) -> np.ndarray:
    """Tiles, or pixels, and their eight neighbours."""
    more = np.pad(tiles, 1)
    more = more[:-2] | more[1:-1] | more[2:]
    return more[:, :-2] | more[:, 1:-1] | more[:, 2:]


def boxes(tiles: np.ndarray, width: int, height: int, call_px: float, around_px: float = 0) -> list[Box]:
    """Rectangles [px] that cover the tiles without overlap. They may also cover other tiles: each rectangle costs its
    pixels and those around it up to this distance, and `call_px` pixels more for the call that handles it."""
    call, around = call_px / TILE_PX**2, 2 * around_px / TILE_PX

    def cover(top: int, left: int, part: np.ndarray) -> tuple[float, list[Box]]:
        """The cost in tiles, and the rectangles."""
        if not part.any():
            return 0, []
        ys, xs = np.flatnonzero(part.any(1)), np.flatnonzero(part.any(0))
        top, left, part = int(top + ys[0]), int(left + xs[0]), part[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        h, w = part.shape
        x, y = left * TILE_PX, top * TILE_PX
        whole = call + (h + around) * (w + around), [(x, y, min(width, x + w * TILE_PX), min(height, y + h * TILE_PX))]
        if part.size - part.sum() <= call:  # another call costs more
            return whole
        y, x = (h // 2, w) if h > w else (h, w // 2)
        one, other = cover(top, left, part[:y, :x]), cover(top + y % h, left + x % w, part[y % h :, x % w :])
        return min(whole, (one[0] + other[0], one[1] + other[1]), key=lambda way: way[0])

    return cover(0, 0, tiles)[1]
