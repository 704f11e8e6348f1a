# SPDX-License-Identifier: GPL-3.0-or-later
"""Which way the surface faces that is seen at a pixel's centre, along chief rays (surfaces.py): the normal that
shading starts from, smooth where the mesh is shaded smooth, without bump and normal maps."""

from __future__ import annotations

import numpy as np

from ..surfaces import Look


class Normal:
    name, channels, unit, at = "normal", ("x", "y", "z"), "1", "instant"

    def __init__(self, look: Look):
        self._look = look
        look.surfaces.normals = True

    def render(self, t_s: float) -> np.ndarray:
        return self._look.seen(t_s).normals.astype(np.float32)
