"""Pictures between their pixels."""

from __future__ import annotations

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
    """Values [H, W, C] at points [..., 2], those beyond the edge as at the edge."""
    height, width = values.shape[:2]
    x, y = (np.clip(points_px[..., k], 0, n - 1) for k, n in ((0, width), (1, height)))
    x0, y0 = (np.minimum(v.astype(np.int64), n - 2) for v, n in ((x, width), (y, height)))
    u, v = (x - x0)[..., None], (y - y0)[..., None]
    top = (1 - u) * values[y0, x0] + u * values[y0, x0 + 1]
    return (1 - v) * top + v * ((1 - u) * values[y0 + 1, x0] + u * values[y0 + 1, x0 + 1])
