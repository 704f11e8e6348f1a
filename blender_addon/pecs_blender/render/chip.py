# SPDX-License-Identifier: GPL-3.0-or-later
"""What the renderer asks of a chip profile, which libpecs reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pecs


@dataclass(frozen=True)
class Chip:
    profile: pecs.Chip

    @property
    def contrast_threshold(self) -> float:
        """The smaller of both, natural log."""
        return min(self.profile.contrast_threshold_on, self.profile.contrast_threshold_off)

    def film_width_mm(self, width: int) -> float:
        """Of the whole chip; `width`: that of the picture, where the chip has none."""
        return round((self.profile.width or width) * self.profile.pixel_pitch_m * 1e3, 6)

    def weights(self, bands: list[dict]) -> np.ndarray:
        """Photocurrent per light in each band, as the sensor weighs them."""
        return np.array(self.profile.amperes_per_unit(bands))


def load_chip(name_or_path: str) -> Chip:
    import pecs  # after bpy: both carry libtbb

    return Chip(pecs.Chip(name_or_path))
