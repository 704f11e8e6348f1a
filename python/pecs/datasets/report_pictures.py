"""Pictures of flow for the eye."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._errors import optional_module


def flow_picture(flow: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Hue is the direction, saturation the length; grey is not known."""
    cv2 = optional_module("cv2", "opencv-python-headless", "the report")
    length, angle = np.hypot(flow[..., 0], flow[..., 1]), np.arctan2(flow[..., 1], flow[..., 0])
    known = np.isfinite(length)
    most = max(float(np.percentile(length[known], 99)) if known.any() else 1.0, 1e-6)
    hsv = np.stack([(angle / np.pi * 90 + 90), 255 * np.clip(length / most, 0, 1), np.full_like(length, 255)], -1)
    rgb = cv2.cvtColor(np.nan_to_num(hsv).astype(np.uint8), cv2.COLOR_HSV2RGB)
    return np.where(known[..., None], rgb, 150).astype(np.uint8)
