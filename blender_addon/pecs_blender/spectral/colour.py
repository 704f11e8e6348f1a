# SPDX-License-Identifier: GPL-3.0-or-later
"""Bands as the eye would see them."""

from __future__ import annotations

import numpy as np
import pecs

RGB_FROM_XYZ = np.array(  # IEC 61966-2-1
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)


def linear_rgb(frame: np.ndarray, bands: list[dict]) -> np.ndarray:
    """[height, width, 3] linear Rec. 709 of a frame [bands, height, width] through CIE 1931; 1 % of the pixels
    reach 1."""
    xyz = pecs.spectrum("basis/cie1931", [b["lambda_nm"] for b in bands])
    per_band = RGB_FROM_XYZ @ (xyz * [b["weight_nm"] for b in bands])
    picture = np.einsum("ck,kyx->yxc", per_band, frame)
    return picture / max(float(np.percentile(picture.max(axis=2), 99)), 1e-30)
