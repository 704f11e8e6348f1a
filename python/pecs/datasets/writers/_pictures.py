"""Pictures of events and depth for the eye."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import optional_module

OFF_ON = np.array([(213, 94, 0), (0, 114, 178)])  # RGB, as in `pecs view`


def event_picture(events: NDArray[Any], height: int, width: int) -> NDArray[np.uint8]:
    """[H, W, 3] RGB on white: ON blue, OFF orange, the darker the more; three events of a pixel are full colour."""
    counts = np.zeros((2, height * width), np.int64)
    where = events["y"].astype(np.int64) * width + events["x"]
    for p in (0, 1):
        counts[p] = np.bincount(where[events["p"] == p], minlength=height * width)
    share = np.minimum(counts, 3).reshape(2, height, width, 1) / 3
    return np.rint(255 - (share * (255 - OFF_ON[:, None, None])).max(0)).astype(np.uint8)


def depth_picture(z_m: NDArray[Any]) -> NDArray[np.uint8]:
    """[H, W]: white near, black far, linear in 1 / z from the nearest to none."""
    near = np.where(np.isfinite(z_m) & (z_m > 0), 1 / np.where(z_m > 0, z_m, 1), 0)
    return np.rint(255 * near / max(float(near.max()), 1e-9)).astype(np.uint8)


def smaller(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """At most `width` pixels wide, averaged over areas."""
    if picture.shape[1] <= width:
        return picture
    cv2 = optional_module("cv2", "opencv-python-headless", "writing pictures")
    height = max(1, round(picture.shape[0] * width / picture.shape[1]))
    out: NDArray[np.uint8] = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return out
