# SPDX-License-Identifier: GPL-3.0-or-later
"""Normal of the surface at a pixel's centre, along chief rays (surfaces.py): the shading normal, smooth where the mesh
is shaded smooth, without bump and normal maps."""

from __future__ import annotations

import numpy as np

from ..output import Layer
from .surfaces import HitCache


class Normal(Layer):
    name, channels, unit, at = "normal", ("x", "y", "z"), "1", "instant"

    def __init__(self, hits: HitCache):
        self._hits = hits
        hits.surfaces.normals = True

    def render(self, t_s: float) -> np.ndarray:
        return self._hits.at(t_s).normals.astype(np.float32)
