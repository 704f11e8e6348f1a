# SPDX-License-Identifier: GPL-3.0-or-later
"""Shares samples between keyframes: light is averaged where motion shows that it is the same."""

from __future__ import annotations

import math

import numpy as np
import pecs
from pecs.motion import CHANNELS, QUARTERS

from ..camera.tiles import Box, at, boxes, faded, grown, tiles_with
from ..output import as_written
from ..truth.surfaces import SurfaceHits, Surfaces
from .judge import Judge

SAME_DEPTH = 0.02  # relative difference of depth within which two hits are on one surface
SKY_M = 1e6  # depth of the sky: finite, so that it can be warped
ALMOST_ONE = 1 - 2.0**-20  # at 1 itself, pecs.carry returns the other keyframe unchanged


def average_samples(
    own: np.ndarray,
    hits: SurfaceHits,
    neighbours: list[tuple[np.ndarray, SurfaceHits]],
    surfaces: Surfaces,
    judge: Judge,
    factors: np.ndarray,
) -> np.ndarray:
    """Mean light [channels, height, width] of a keyframe and those parts of its neighbours that show the same light, at
    these strengths of lamps, in the first channels, those of Picture.raw; rounded as in the file."""
    more, weights = np.zeros(own.shape), np.zeros(own.shape[1:])  # from neighbours
    centres = surfaces.sight.centres()
    for light, there in neighbours:
        place = surfaces.place(there, hits.poses)
        moving = (place[:2] != centres).any(0)
        if not moving.any():
            continue
        box = _differing_part(moving | (own != light).any(0), place[:2, moving])
        here, move = own[at(box)], place[:2][at(box)] - centres[at(box)]
        warped, z = np.split(_warped(light[at(box)], there.depth[at(box)], move, place[2][at(box)]), [len(own)])
        depth = np.minimum(hits.depth[at(box)], SKY_M)
        same = np.isfinite(warped).all(0) & (np.abs(z[0] - depth) <= SAME_DEPTH * depth)
        current, other = (judge.photocurrent(one, factors=factors) for one in (here, warped))
        agree = judge.same_light(np.where(same, current, np.nan), np.where(same, other, np.nan))
        weight = np.where(same, faded(agree, same.shape[::-1]), 0)
        more[at(box)] += weight * np.where(same, warped, 0)
        weights[at(box)] += weight
    mean = own.copy()
    shared = weights > 0
    mean[:, shared] = (own[:, shared] + more[:, shared]) / (1 + weights[shared])
    return as_written(mean)


def _differing_part(different: np.ndarray, landed: np.ndarray) -> Box:
    """The box of tiles, and some more around them, that contains all different pixels [height, width] and the places
    [2, n] at which moving surface points land."""
    height, width = different.shape
    x, y = landed[:, np.isfinite(landed).all(0)]
    reached = different.copy()
    reached[np.clip(y, 0, height - 1).astype(int), np.clip(x, 0, width - 1).astype(int)] = True
    return boxes(grown(tiles_with(reached)), width, height, math.inf)[0]


def _warped(light: np.ndarray, depth: np.ndarray, move: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Light [channels, height, width] whose points at these depths move by `move` [2, height, width] to the depth z,
    warped; in a further channel z."""
    z = np.minimum(z, SKY_M)
    motion = np.full((len(CHANNELS), *z.shape), np.nan, np.float32)
    motion[: len(CHANNELS) // 2] = [*(part for q in QUARTERS for part in q * move), depth, z]
    bands = np.concatenate([light, z[None].astype(np.float32)])
    return pecs.carry(bands, bands, motion, ALMOST_ONE, side="first")
