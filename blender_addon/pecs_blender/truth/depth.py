# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance of the surface at a pixel's centre: Cycles' Position pass of one sample, along chief rays (sight.py)."""

from __future__ import annotations

import numpy as np

from ..camera.sight import transformed
from ..output import Layer
from ..scene import cycles
from .surfaces import HitCache


class Depth(Layer):
    name, channels, unit, at = "depth", ("distance", "z"), "m", "instant"

    def __init__(self, hits: HitCache):
        self._stage, self._film = hits.stage, cycles.Film(hits.stage.source.scene)
        self._sight = hits.surfaces.sight

    def render(self, t_s: float) -> np.ndarray:
        views = []
        with cycles.for_one_sample(self._stage.source.scene, camera := self._sight.camera()):
            passes = self._film.passes("Position", "Depth", inspect=lambda d: views.append(self._sight.view(d)))
        points = transformed(views[-1].camera_from_world, passes["Position"].astype(float))
        distance = points[2] if camera.data.type == "ORTHO" else np.linalg.norm(points, axis=0)
        depth = np.stack([distance, points[2]]) * self._stage.source.unit_m
        return np.where(passes["Depth"] < cycles.NO_SURFACE, depth, np.inf).astype(np.float32)
