# SPDX-License-Identifier: GPL-3.0-or-later
"""A chip profile with the quantities that rendering needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pecs


@dataclass(frozen=True)
class Chip:
    profile: pecs.Chip

    @property
    def contrast_threshold(self) -> float:
        """The lower of the ON and OFF thresholds, natural log."""
        return min(self.profile.contrast_threshold_on, self.profile.contrast_threshold_off)

    def film_width_mm(self, width: int) -> float:
        """Of the whole chip; of `width` pixels if the profile has no size."""
        return round((self.profile.width or width) * self.profile.pixel_pitch_m * 1e3, 6)

    def weights(self, bands: list[dict]) -> np.ndarray:
        """Photocurrent per light in each band, as in the sensor."""
        return np.array(self.profile.amperes_per_unit(bands))


def load_chip(name_or_path: str) -> Chip:
    return Chip(pecs.Chip(name_or_path))
