# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether two pictures of one instant show the same light, as a chip sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.tiles import differing


@dataclass(frozen=True)
class Judge:
    """weights: photocurrent per light in each band. tolerance: of ln(photocurrent). subpixels: of the pictures."""

    weights: np.ndarray
    tolerance: float
    subpixels: int

    def plane(self, light: np.ndarray, bands: slice = slice(None)) -> np.ndarray:
        """Photocurrent [height, width] of some bands of [bands, height, width]."""
        return np.einsum("k,kyx->yx", self.weights[bands].astype(np.float32), light[bands])

    def differing(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Tiles [rows, columns] in which two planes differ; NaN says nothing."""
        return differing(a, b, self.tolerance, self.subpixels)
