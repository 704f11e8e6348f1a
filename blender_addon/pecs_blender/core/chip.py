# SPDX-License-Identifier: GPL-3.0-or-later
"""What the renderer asks of a chip profile."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .strict_json import JsonObject, read_json


@dataclass(frozen=True)
class Chip:
    width: int  # pixels; 0 for a chip of any size
    pixel_pitch_m: float
    contrast_threshold: float  # the smaller of both, natural log
    qe_lambda_nm: np.ndarray
    qe: np.ndarray  # relative

    def film_width_mm(self, width: int) -> float:
        """Of the whole chip; `width`: that of the picture, where the chip has none."""
        return round((self.width or width) * self.pixel_pitch_m * 1e3, 6)

    def weights(self, bands: list[dict]) -> np.ndarray:
        """Photocurrent per light in each band, but for a factor: lambda QE weight, as the sensor weighs them."""
        lambda_nm, weight_nm = (np.array([band[key] for band in bands]) for key in ("lambda_nm", "weight_nm"))
        return lambda_nm * np.interp(lambda_nm, self.qe_lambda_nm, self.qe, left=0, right=0) * weight_nm


def load_chip(name_or_path: str) -> Chip:
    import pecs

    path = Path(name_or_path)
    if path.suffix != ".json":
        path = pecs.data_dir("sensor/chips") / f"{name_or_path}.json"
    top = JsonObject(read_json(path), path)
    values, qe = top.object("values"), top.object("relative_qe")
    lambda_nm, relative = qe.numbers("lambda_nm", 100, 20000), qe.numbers("value", 0, 1)
    if len(lambda_nm) != len(relative) or len(lambda_nm) < 2:
        raise qe.fail("value", f"{len(relative)} values for {len(lambda_nm)} wavelengths", "as many, at least 2")

    def value(key: str, low: float, high: float) -> float:
        return values.object(key).number("value", low, high)

    return Chip(
        int(value("width", 0, 8192)),
        value("pixel_pitch_m", 1e-7, 1e-3),
        min(value(f"contrast_threshold_{polarity}", 1e-3, 5) for polarity in ("on", "off")),
        np.array(lambda_nm, float),
        np.array(relative, float),
    )
