# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of a render, as job/resolve.py makes it from the options: each stage takes its part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pecs

from ..scene.camera_path import CameraPath
from ..scene.cycles import Sampling
from ..scene.timeline import Instants
from ..spectral.bands import Bands
from .tiles import Box


@dataclass(frozen=True, kw_only=True)
class View:
    """The picture and its camera. None: the scene's own value."""

    pixels: tuple[int, int]  # of the sensor: width, height
    subpixels: int  # rendered pixels per sensor pixel, in x and in y
    film_width_mm: float
    film_shift_mm: tuple[float, float]
    film_tilt_deg: tuple[float, float]
    lens: str | None
    stop_diameter_mm: float | None
    fnumber: float | None
    focus_m: float | None
    focus_bands_nm: tuple[float, ...]  # empty: all bands
    focal_mm: float  # of a scene folder's pinhole
    moving_px: Box | None  # rendered pixels; None: everything may move
    path: CameraPath | None

    @property
    def size(self) -> tuple[int, int]:
        """Rendered pixels: width, height."""
        return self.pixels[0] * self.subpixels, self.pixels[1] * self.subpixels

    def record(self, through_lens: bool, own_fnumber: float | None) -> dict[str, Any]:
        """The first entries of stack.json. own_fnumber: of the scene's camera."""
        fnumber = None if through_lens else self.fnumber or own_fnumber
        return {
            "pecs_stack": 1,
            "quantity": "irradiance" if through_lens else "radiance",
            "width": self.pixels[0],
            "height": self.pixels[1],
            "pixel_pitch_m": self.film_width_mm * 1e-3 / self.pixels[0],
            **({"fnumber": fnumber} if fnumber else {}),
        }


@dataclass(frozen=True, kw_only=True)
class Plan:
    """layers: names of the layers besides the light. recorded: options for stack.json. verbosity: for Progress."""

    view: View
    bands: Bands
    sampling: Sampling
    instants: Instants
    light: bool
    layers: tuple[str, ...]
    recorded: dict[str, Any]
    verbosity: dict[str, bool]


def lower_threshold(chip: pecs.Chip) -> float:
    """The lower of the ON and OFF contrast thresholds, natural log."""
    return min(chip.contrast_threshold_on, chip.contrast_threshold_off)
