"""Hot pixels, which are counted and left out of all recordings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._errors import optional_module
from .recordings import StillEvents


def find(stills: list[StillEvents]) -> tuple[NDArray[np.bool_], StillEvents] | None:
    """Pixels that fire ON far more often than all others in the recording with the fewest events, and that recording;
    None without one."""
    if not stills:
        return None
    stats = optional_module("scipy.stats", "SciPy", "pecs fit", "fit")
    of = min(stills, key=lambda q: float(q.on.mean()) / q.seconds)
    mean = float(np.sort(of.on)[: int(0.97 * of.pixels)].mean())
    hot: NDArray[np.bool_] = of.pixels * stats.poisson.sf(of.on - 1, 1.5 * mean + 0.5) < 0.01
    return hot, of


def share(hot: NDArray[np.bool_]) -> tuple[float, tuple[float, float]]:
    """Share of hot pixels, with its 95 % interval (Clopper & Pearson 1934)."""
    stats = optional_module("scipy.stats", "SciPy", "pecs fit", "fit")
    n, total = int(hot.sum()), len(hot)
    low = float(stats.beta.ppf(0.025, n, total - n + 1)) if n else 0.0
    return n / total, (low, float(stats.beta.ppf(0.975, n + 1, total - n)))


def rates_hz(hot: NDArray[np.bool_], of: StillEvents) -> NDArray[np.float64]:
    """Rate of each hot pixel above the mean of the others."""
    rates: NDArray[np.float64] = of.on[hot] / of.seconds - of.on[~hot].mean() / of.seconds
    return rates


def rate_hz(hot: NDArray[np.bool_], of: StillEvents) -> tuple[float, tuple[float, float]]:
    """Mean rate of the hot pixels above the others, with its 95 % interval: of their spread or of their number of
    events, whichever is wider."""
    n = int(hot.sum())
    rates = rates_hz(hot, of)
    spread = float(rates.std(ddof=1)) / np.sqrt(n) if n > 1 else 0.0
    sd = max(spread, float(np.sqrt(of.on[hot].sum())) / of.seconds / n)
    middle = float(rates.mean())
    return middle, (max(middle - 1.96 * sd, 0.0), middle + 1.96 * sd)
