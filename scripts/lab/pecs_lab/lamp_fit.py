"""A lamp that hangs above a disk and shines down: its light there, and the lamp that fits a measured light."""

import numpy as np
from scipy.optimize import least_squares

ELEMENTS = (24, 3)  # of the lamp, along its length and width


def illuminance(x_mm: np.ndarray, up_mm: np.ndarray, lamp: dict, walls: float) -> np.ndarray:
    """Relative, at points of the disk's plane; lamp_before_mm: in front of that plane."""
    along, across = (((np.arange(n) + 0.5) / n - 0.5) for n in ELEMENTS)
    total = 0
    for right in lamp["lamp_right_mm"] + lamp["lamp_length_mm"] * along:
        for d in lamp["lamp_before_mm"] + lamp["lamp_width_mm"] * across:
            h = lamp["lamp_up_mm"] - up_mm
            total = total + d * h / ((right - x_mm) ** 2 + h**2 + d**2) ** 2
    return total / total.mean() + walls


def fit(corner_hz, x_mm, up_mm, cos4, area, size: dict, walls: float) -> tuple[dict, float]:
    """The lamp, and the RMS of what ln of the light misses; `area`: of the map's regions, relative."""
    root = np.sqrt(area)

    def lamp(v: np.ndarray) -> dict:
        return dict(zip(("lamp_right_mm", "lamp_up_mm", "lamp_before_mm"), v.tolist(), strict=True)) | size

    def misses(v: np.ndarray) -> np.ndarray:
        ratio = np.log(illuminance(x_mm, up_mm, lamp(v), walls) * cos4 / corner_hz)
        return ((ratio - np.average(ratio, weights=area)) * root).ravel()

    starts = [(right, above, before) for right in (-300, 300) for above in (200, 500) for before in (200, 500)]
    bounds = (-3000, up_mm.max() + 5, size["lamp_width_mm"]), (3000, 3000, 3000)  # above the disk and before it
    best = min((least_squares(misses, s, bounds=bounds) for s in starts), key=lambda found: found.cost)
    return lamp(best.x), float(np.sqrt(np.mean(best.fun**2)))
