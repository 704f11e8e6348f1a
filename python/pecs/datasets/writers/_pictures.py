"""Pictures of depth and flow for the eye, and smaller ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import optional_module


def depth_picture(z_m: NDArray[Any]) -> NDArray[np.uint8]:
    """[H, W]: white near, black far, linear in 1 / z from the nearest to none."""
    near = np.where(np.isfinite(z_m) & (z_m > 0), 1 / np.where(z_m > 0, z_m, 1), 0)
    return np.rint(255 * near / max(float(near.max()), 1e-9)).astype(np.uint8)


def flow_picture(flow: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Hue is the direction, saturation the length; grey is not known."""
    cv2 = optional_module("cv2", "opencv-python-headless", "the report")
    length, angle = np.hypot(flow[..., 0], flow[..., 1]), np.arctan2(flow[..., 1], flow[..., 0])
    known = np.isfinite(length)
    most = max(float(np.percentile(length[known], 99)) if known.any() else 1.0, 1e-6)
    hsv = np.stack([(angle / np.pi * 90 + 90), 255 * np.clip(length / most, 0, 1), np.full_like(length, 255)], -1)
    rgb = cv2.cvtColor(np.nan_to_num(hsv).astype(np.uint8), cv2.COLOR_HSV2RGB)
    return np.where(known[..., None], rgb, 150).astype(np.uint8)


def smaller(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """At most `width` pixels wide, averaged over areas."""
    if picture.shape[1] <= width:
        return picture
    cv2 = optional_module("cv2", "opencv-python-headless", "writing pictures")
    height = max(1, round(picture.shape[0] * width / picture.shape[1]))
    out: NDArray[np.uint8] = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return out
