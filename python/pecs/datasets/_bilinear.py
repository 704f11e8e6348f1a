"""Values between the pixels of a picture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


def neighbours(points_px: NDArray[Any], width: int, height: int) -> tuple[Any, NDArray[np.float64]]:
    """Indices (y, x) of the four pixels around points [..., 2] within the picture, and their weights [4, ..., 1]."""
    x, y = points_px[..., 0], points_px[..., 1]
    x0, y0 = (np.minimum(v.astype(np.int64), max(n - 2, 0)) for v, n in ((x, width), (y, height)))
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    u, v = (x - x0)[..., None], (y - y0)[..., None]
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
    return [(y0, x0), (y0, x1), (y1, x0), (y1, x1)], weights


def bilinear(values: NDArray[Any], points_px: NDArray[Any]) -> NDArray[np.float64]:
    """Values [H, W, C] at points [..., 2]; outside the picture, those at its edge."""
    height, width = values.shape[:2]
    around, weights = neighbours(np.clip(points_px, 0, [width - 1, height - 1]), width, height)
    return sum(weight * values[pixel] for weight, pixel in zip(weights, around, strict=True))


def on_surface(
    values: NDArray[Any], points_px: NDArray[Any], surface: NDArray[Any] | None = None, most: float = math.inf
) -> NDArray[np.float64]:
    """Values [H, W, C] at points [..., 2] within the picture: bilinear where the four pixels around show one surface,
    otherwise those of the nearest pixel. They show one surface if their values are finite and differ by at most `most`,
    and if `surface` [H, W] is the same number for all."""
    around, weights = neighbours(points_px, values.shape[1], values.shape[0])
    corners = np.stack([values[pixel] for pixel in around]).astype(np.float64)
    one = np.isfinite(corners).all((0, -1))
    with np.errstate(invalid="ignore"):
        one &= (np.ptp(corners, 0) <= most).all(-1)
    if surface is not None:
        one &= np.ptp(np.stack([surface[pixel] for pixel in around]), 0) == 0
    nearest = np.take_along_axis(corners, weights.argmax(0)[None], 0)[0]
    return np.where(one[..., None], (weights * corners).sum(0), nearest)
