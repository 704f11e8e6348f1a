"""Statistics of recordings that a fit compares: the same function computes them for the recorded and for the simulated
events, with their covariance by a jackknife over groups of pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .recordings import StepEvents, StillEvents

KEPT_EVENTS = 10  # of a pixel behind a switch whose times are used
LATER = (2, 3, 4, 6, 9)  # events whose median time behind the first one counts
GROUPS = 60  # of pixels, for the jackknife
READOUT_US = 1.0  # standard deviation of the readout's delays
DARK_NOISE = 0.03  # of the root of a rate
RAMP_NUMBER = 0.01  # of a number of events: a screen's levels
QUANTILES = (0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """Events in the direction of one switch: times behind it [pixel, cycle, event] (NaN: none) and numbers; and the
    shortest gap between events of any direction [pixel, cycle]."""

    times_us: Floats
    count: NDArray[np.int64]
    gap_us: Floats

    def select(self, pixels: NDArray[Any]) -> Table:
        return Table(self.times_us[pixels], self.count[pixels], self.gap_us[pixels])


def tables(of: StepEvents) -> list[Table]:
    """One for each level; the first cycle is left out, since the pixels may not yet repeat."""
    k = len(of.levels)
    cycles = (len(of.edges_us) - 1) // k
    switch = np.searchsorted(of.edges_us, of.t_us, "right") - 1
    t_us = of.t_us + np.random.default_rng(1).random(len(of.t_us))  # stamps are whole us, rounded down
    out = []
    for j in range(k):
        up = of.levels[j] > of.levels[j - 1]
        of_level = (switch % k == j) & (switch >= k)
        gap_us = _shortest(of.pixel[of_level] * (cycles - 1) + switch[of_level] // k - 1, t_us[of_level])
        mine = of_level & (of.on == up)
        cycle = switch[mine] // k - 1
        cell = of.pixel[mine] * (cycles - 1) + cycle
        order = np.lexsort((t_us[mine], cell))
        cell, behind = cell[order], (t_us[mine] - of.edges_us[switch[mine]])[order]
        count = np.bincount(cell, minlength=of.pixels * (cycles - 1))
        rank = np.arange(len(cell)) - (np.cumsum(count) - count)[cell]
        times = np.full((len(count), KEPT_EVENTS), np.nan)
        few = rank < KEPT_EVENTS
        times[cell[few], rank[few]] = behind[few]
        shape = (of.pixels, cycles - 1)
        gap_us = np.pad(gap_us, (0, len(count) - len(gap_us)), constant_values=np.inf)
        out.append(Table(times.reshape(*shape, KEPT_EVENTS), count.reshape(shape), gap_us.reshape(shape)))
    return out


def _shortest(cell: NDArray[np.int64], t_us: Floats) -> Floats:
    """Shortest gap between events of each cell; infinite without two events."""
    order = np.lexsort((t_us, cell))
    cell, gap_us = cell[order], np.diff(t_us[order])
    out = np.full(int(cell.max(initial=-1)) + 1, np.inf)
    same = cell[1:] == cell[:-1]
    np.minimum.at(out, cell[1:][same], gap_us[same])
    return out


def later_events(table: Table) -> list[int]:
    """Those of LATER that nearly all pixels of a recording have."""
    return [k for k in LATER if (table.count >= k).mean() > 0.8]


def _log_us(value: float, missing_us: float) -> float:
    return float(np.log(max(value, 0.0) + 1.0 if np.isfinite(value) else missing_us))


def _numbers(table: Table) -> dict[str, float]:
    of_pixel, over_cycles = table.count.mean(axis=1), float(table.count.var(axis=1, ddof=1).mean())
    over_pixels = float(of_pixel.var()) - over_cycles / table.count.shape[1]  # any number of cycles has the same mean
    return {
        "events per pixel": float(of_pixel.mean()),
        "their spread over pixels": float(np.sqrt(max(over_pixels, 0.0))),
        "their spread over cycles": float(np.sqrt(over_cycles)),
    }


def of_switch(
    table: Table, later: Sequence[int], exact: bool, length_us: float, ramp: bool = False
) -> dict[str, float]:
    """Statistics of the events behind one switch. Times are relative to the median first event of each cycle where the
    time of the switch is not known (`exact`). Events of a ramp are only counted."""
    if ramp:
        gap = float(np.quantile(table.gap_us, 0.1))
        return _numbers(table) | {"shortest gap of a tenth of the pixels, ln us": _log_us(gap, length_us)}
    first = table.times_us[:, :, 0]
    fired = np.isfinite(first)
    if not fired.any():
        first, fired = np.full_like(first, length_us), np.ones_like(fired)
    middle = np.array([np.median(c[f]) if f.any() else length_us for c, f in zip(first.T, fired.T, strict=True)])
    low5, low10, low, mid, high, high10, high5 = np.quantile((first - middle)[fired], QUANTILES)
    out = {
        "width of the middle half of first events, ln us": _log_us(high - low, length_us),
        "width of the middle 90 % of first events, ln us": _log_us(high5 - low5, length_us),
        "early tail of first events / width": float((mid - low5 + 1) / (high5 - low5 + 2)),
    }
    if exact:
        at = dict(zip((10, 25, 50, 75, 90), np.quantile(first[fired], (0.1, 0.25, 0.5, 0.75, 0.9)), strict=True))
        out |= {f"first event, quantile {q} %, ln us": _log_us(v, length_us) for q, v in at.items()}
    jitter = np.abs(np.diff(np.where(fired, first - middle, np.nan), axis=1))
    jitter = jitter[np.isfinite(jitter)]
    out["jitter of first events, ln us"] = _log_us(float(np.median(jitter)) if len(jitter) else np.nan, length_us)
    out |= _numbers(table)
    for k in later:
        gap = (table.times_us[:, :, k - 1] - first).ravel()
        gap = gap[np.isfinite(gap)]
        out[f"event {k} behind the first, ln us"] = _log_us(float(np.median(gap)) if len(gap) else np.nan, length_us)
        if k == 2:
            shortest = float(np.quantile(gap, 0.05)) if len(gap) else np.nan
            out["shortest 5 % of the gaps before event 2, ln us"] = _log_us(shortest, length_us)
    return out


def thresholds(ramps: StepEvents) -> dict[str, float]:
    """By counting, without noise and leak: a ramp that is longer by a threshold has an event more."""
    of = tables(ramps)
    number = np.array([t.count.mean() for t in of])
    length = np.log(np.array(ramps.levels) / np.roll(ramps.levels, 1))
    out, spreads = {}, [float(t.count.mean(axis=1).std() / t.count.mean()) for t in of]
    for key, mine in (("contrast_threshold_on", length > 0), ("contrast_threshold_off", length < 0)):
        out[key] = 1 / float(np.polyfit(np.abs(length[mine]), number[mine], 1)[0])
    return out | {"threshold_mismatch": float(np.mean(spreads))}


def of_still(of: StillEvents, pixels: NDArray[Any] | None = None) -> dict[str, float]:
    on, off = (of.on, of.off) if pixels is None else (of.on[pixels], of.off[pixels])
    out = {f"root of the {p} rate, Hz": float(np.sqrt(n.mean() / of.seconds)) for p, n in (("ON", on), ("OFF", off))}
    if of.level == 0:
        out["variance / mean of the number of ON events"] = float(on.var() / on.mean()) if on.any() else 1.0
    return out


def unknown(name: str, value: float, ramp: bool) -> float:
    """Standard deviation of what is not simulated: the readout's delays, noise of pixels in darkness, a screen."""
    if ramp and name == "events per pixel":
        return RAMP_NUMBER * value
    if name.endswith("ln us"):
        return float(READOUT_US * np.exp(-value))
    return DARK_NOISE * value if name.startswith("root") else 0.0


def jackknife(compute: Callable[[NDArray[Any]], Sequence[float]], pixels: int) -> NDArray[np.float64]:
    """Covariance of statistics: each group of pixels left out once."""
    group = np.random.default_rng(1).permutation(pixels) % GROUPS
    left = np.array([compute(np.flatnonzero(group != g)) for g in range(GROUPS)])
    left -= left.mean(axis=0)
    covariance: NDArray[np.float64] = (GROUPS - 1) / GROUPS * left.T @ left
    return covariance
