# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of neighbouring keyframes, shared along the motion: one of few samples is then as clean as one of many.

The light of each neighbour is carried to the keyframe's instant (as the sensor does it between them), and all that
show the same surface and agree are averaged. Seeds are those of every frame, so their noise stays where it is on the
film while surfaces move: it averages out where something moves, and what stands still stays the same, bit by bit.
"""

from __future__ import annotations

import numpy as np
import pecs

from .judge import Judge
from .surfaces import Seen, Surfaces
from .tiles import TILE_PX

DEPTH = 0.02  # as far apart as one surface may lie in two keyframes, relative
SKY_M = 1e6  # finite, so that it can be carried
ALMOST_ONE = 1 - 2.0**-20  # at 1 itself the other keyframe is handed back as it is


def shared(
    own: np.ndarray, seen: Seen, others: list[tuple[np.ndarray, Seen]], surfaces: Surfaces, judge: Judge
) -> np.ndarray:
    """Light [bands, height, width] of a keyframe and of its neighbours, with what is seen there."""
    depth = np.minimum(seen.depth, SKY_M)
    total, count, one = own.astype(np.float64), np.ones(own.shape[1:]), judge.plane(own)
    for light, there in others:
        carried = _carried(light, there, seen, surfaces)
        if carried is None:
            continue
        carried, z = carried[:-1], carried[-1]
        same = np.isfinite(carried).all(0) & (np.abs(z - depth) <= DEPTH * depth)
        agree = judge.one_light(np.where(same, one, np.nan), np.where(same, judge.plane(carried), np.nan))
        height, width = same.shape
        same &= np.kron(agree, np.ones((TILE_PX, TILE_PX), bool))[:height, :width]
        total[:, same] += carried[:, same]
        count[same] += 1
    return (total / count).astype(np.float32)


def _carried(light: np.ndarray, there: Seen, seen: Seen, surfaces: Surfaces) -> np.ndarray | None:
    """Light and depth at the instant of `seen`; nothing if nothing moves."""
    place = surfaces.place(there, seen.poses)
    move = place[:2] - surfaces.centres()
    if not np.any(move):
        return None
    z = np.minimum(place[2], SKY_M)
    motion = np.full((12, *z.shape), np.nan, np.float32)
    motion[:6] = [*(move / 2), *move, there.depth, place[2]]
    bands = np.concatenate([light, z[None].astype(np.float32)])
    return pecs.carry(bands, bands, motion, ALMOST_ONE, side="first")
