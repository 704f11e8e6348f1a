# SPDX-License-Identifier: GPL-3.0-or-later
"""Field of view of a lens for the 3-D viewport: border and first-order data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pecs

SIDE = 12  # steps along a side of the film


@dataclass(frozen=True)
class Setting:
    """A lens and a film. version: modification time of the lens file. focus_m, fnumber: None as for pecs.Lens."""

    lens: str
    version: int
    focus_m: float | None
    fnumber: float | None
    film_width_mm: float
    width: int
    height: int


@dataclass(frozen=True)
class Field:
    """border [4 SIDE, 2]: x/z and y/z of the chief rays around the film from its upper left pixel on, clockwise, in
    camera axes (x right, y down, z forward) from the entrance pupil; NaN where the lens blocks the ray.
    angles_deg: horizontal and vertical field of view through the centre. widest: f-number wide open."""

    border: np.ndarray
    angles_deg: tuple[float, float]
    efl_mm: float
    fnumber: float
    widest: float

    @property
    def width_per_distance(self) -> float:
        """Width of the field through its centre, per unit of distance."""
        right, left = self.border[SIDE + SIDE // 2, 0], self.border[3 * SIDE + SIDE // 2, 0]
        return float(right - left)

    def words(self) -> str:
        across, down = self.angles_deg
        return f"{self.efl_mm:.4g} mm f/{self.fnumber:.3g}, {across:.3g}° x {down:.3g}°"


def around(width: int, height: int) -> np.ndarray:
    """[4 SIDE, 2] pixels along the border of the film."""
    k = np.arange(SIDE) / SIDE
    zero, one = np.zeros(SIDE), np.ones(SIDE)
    x = np.concatenate([k, one, 1 - k, zero])
    y = np.concatenate([zero, k, one, 1 - k])
    return np.stack([x * width, y * height], axis=-1)


@lru_cache(32)
def field(setting: Setting) -> Field:
    """Takes 0.25 s. Raises pecs.PecsError for an invalid lens or setting."""
    s = setting
    film_height_mm = s.film_width_mm * s.height / s.width
    stop = {"focus_m": s.focus_m, "fnumber": s.fnumber}
    with pecs.Lens(s.lens) as lens:
        film = {"film_width_mm": s.film_width_mm, "film_height_mm": film_height_mm}
        info = lens.info(**stop, **film, field_rows=2)
        widest = info["fnumber"] if s.fnumber is None else lens.info(field_rows=2, focus_m=s.focus_m, **film)["fnumber"]
        rays = lens.directions(
            around(s.width, s.height),
            width=s.width,
            height=s.height,
            pixel_pitch_mm=s.film_width_mm / s.width,
            **stop,
        )
    border = rays[:, :2] / rays[:, 2:]
    ends = [(k * SIDE + SIDE // 2, (k + 2) * SIDE + SIDE // 2, axis) for k, axis in ((1, 0), (0, 1))]
    across, down = (sum(math.degrees(math.atan(abs(border[i, a]))) for i in (one, two)) for one, two, a in ends)
    return Field(border, (across, down), info["efl_mm"], info["fnumber"], widest)
