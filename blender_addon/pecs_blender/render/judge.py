# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether two pictures of one instant show the same light, as a chip sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .job import Job
from .layers import Light
from .tiles import differing, differing_tiles, probe_strips

SAME = 0.02  # of the light: as far as samples of it may lie apart
SUSPECT_SIGMAS = 3.0  # samples that are left out in vain cost little


@dataclass(frozen=True)
class Judge:
    """weights: photocurrent per light in each band. tolerance: of ln(photocurrent). subpixels: of the pictures."""

    weights: np.ndarray
    tolerance: float
    subpixels: int

    def plane(self, light: np.ndarray, bands: slice = slice(None)) -> np.ndarray:
        """Photocurrent [height, width] of some bands of [bands, height, width]."""
        return np.einsum("k,kyx->yx", self.weights[bands].astype(np.float32), light[bands])

    def strips_differing(
        self, job: Job, light: Light, index: int, expected: Callable[[slice], np.ndarray]
    ) -> np.ndarray:
        """Tiles in which strips of the present instant, rendered in the brightest pass, differ from the plane that
        `expected` gives for the pass's bands. index: other strips for each."""
        probe = int(np.argmax([self.weights[one.bands].sum() for one in job.passes]))
        bands = job.passes[probe].bands
        seen = light.fresh(probe_strips(*job.size, index), slice(probe, probe + 1))
        return self.differing(expected(bands), self.plane(seen, bands))

    def differing(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Tiles [rows, columns] in which two planes differ; NaN says nothing."""
        return differing(a, b, self.tolerance, self.subpixels)

    def one_light(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Tiles [rows, columns] in which two planes are samples of the same light, as far as their noise lets see."""
        return ~(self.differing(a, b) | differing_tiles(a, b, SAME, self.subpixels, SUSPECT_SIGMAS))
