# SPDX-License-Identifier: GPL-3.0-or-later
"""What is rendered, resolved: layers ask it for all they need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .lens import Lens, Pass
from .source import Source
from .spectral import SpectralScene


@dataclass(frozen=True)
class Job:
    source: Source
    spectral: SpectralScene
    size: tuple[int, int]  # pixels
    lambda_nm: np.ndarray  # of the bands
    lens: Lens | None
    passes: tuple[Pass, ...]
    unit: np.ndarray  # per band: film irradiance (or radiance) of a rendered 1
    moving_px: tuple[int, int, int, int] | None
    rays_per_sample: int = 1
    subpixels: int = 1  # of a sensor's pixel, in x and y: `size` counts them

    def set_time(self, t_s: float) -> None:
        self.spectral.before_instant()
        self.source.set_time(t_s)
        self.spectral.after_instant()
        if self.lens:
            self.source.place([one.camera for one in self.passes])
