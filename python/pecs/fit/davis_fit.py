"""A chip profile from a recording of a DAVIS with frames: thresholds from its moving frames (davis.py), noise and the
step of its exposures from its still windows (davis_still.py)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError, UsageError, optional_module
from ..chip import Chip
from . import hot
from .davis import Moving, find_exposures, measure_moving, refractory_us
from .davis_recording import Davis, DavisEvents, load_davis
from .davis_still import AFTER_US, BURST_US, MODEL_SD, MOST_WINDOWS, StillProblem, StillStatistics, still_windows
from .estimate import NORMAL_95, Compared, Fitted, Value, kept
from .recordings import StillEvents
from .search import FLICKER, FREE, LIGHT, PHASE, Floats, Search, back, forward

PIXELS_PER_SIMULATED = 4  # of --pixels: still pixels are cheap
LIGHT_SD, SPREAD_SD = 1.0, 1.0  # of logarithms, about the start: hardly constrained
WHITE_A = 5e-13  # photocurrent of white where a search begins
MAX_SD = 0.7  # of a logarithm; a value known less well is kept
LARGE_STEPS = 1.3  # bursts are of steps above the median by as many spreads: with more spread, the median is lower
HISTORY_SD = 0.2  # of ln noise_std: the rate of noise in still light depends for minutes on the light before
LEAST_HOT = 4  # events of a hot pixel
LEAST_FOUND = 0.2  # share of hot pixels that have as many; below it, their number is not known
COARSE_SD = 0.3  # far from the best values
# Factor on deviations in still windows. Found on drawn chips (seeds 400 to 411 and 500 to 509 of
# scripts/studies/fit_hidden.py), of whose steps and spreads intervals with 1.4 held 32 of 39.
WIDER = 2.0

Values = dict[str, Value]


def fit_davis(
    of: Davis,
    chip: str | Path | None = None,
    *,
    keep: Sequence[str] = (),
    pixels: int = 1024,
    seed: int = 1,
    progress: Callable[[int], object] | None = None,
) -> Fitted:
    """Fit the values of a chip profile to a recording of a DAVIS with frames.

    Parameters
    ----------
    of : Davis
        AEDAT4, a ROS bag, or a folder with events and images.txt or exposures.csv.
    chip : str or path
        Starting profile, with `frames`. Default "davis240c" for recordings of 240x180 pixels, otherwise "davis346".
    keep : sequence of str
        Keys of the profile that stay as they are. Default none.
    pixels : int
        A quarter of the number of simulated pixels. Default 1024.
    seed : int
        Of the simulation. Default 1.
    progress : callable, optional
        Called with the number of simulations.

    Returns
    -------
    Fitted

    Raises
    ------
    PecsInputError
        The recording has no frames, its events do not follow them, or it has more pixels than the chip.
    UsageError
        The chip takes no frames, or a key of `keep` does not exist.
    """
    optional_module("scipy", "SciPy", "pecs fit", "fit")
    loaded = None if chip else load_davis(of)
    chip = chip_of(loaded.shape) if loaded else chip
    base = {key: float(entry["value"]) for key, entry in Chip(chip).info["values"].items()}
    if "frame_period_s" not in base:
        raise UsageError(f"fit: {chip}: got a chip without frames, wanted davis240c, davis346 or a profile like them")
    for key in set(keep) - set(base):
        raise UsageError(f"fit: keep: got {key}, wanted one of {', '.join(sorted(base))}")
    found = find_exposures(loaded or load_davis(of))
    height, width = found.shape
    if width > base["width"] or height > base["height"]:
        got = f"{width}x{height} pixels"
        raise PecsInputError(f"{of.file}: got {got}, wanted at most {base['width']:g}x{base['height']:g}, as {chip}")
    moving = measure_moving(found, refractory_us(found, 1e6 * base["refractory_period_s"]))
    values = {**_of_frames(found, moving, base), **_of_motion(moving, base)}
    windows = still_windows(found)
    data: list[Any] = []
    simulated: list[Any] = []
    compared: list[Compared] = []
    correlations: dict[str, dict[str, float]] = {}
    light = kept(0.0, "no still window")
    if len(windows):
        hot_values = _of_hot_pixels(found, windows, base)
        fixed = {key: v.value for key, v in values.items() if v.fitted and key not in keep}
        fixed |= {"hot_pixel_fraction": 0.0}
        problem = StillProblem(
            found, windows[-MOST_WINDOWS:], moving.black, chip, fixed, PIXELS_PER_SIMULATED * pixels, seed, progress
        )
        still = _Still(problem, base, moving, keep)
        values |= still.values | hot_values
        light, data, simulated = still.light, [problem], [still.simulated]
        compared, correlations = still.compared, still.correlations
    else:
        why = "no still window: between no two frames does the picture stay"
        values |= {key: kept(base[key], why) for key in (*_Still.KEYS, "hot_pixel_fraction", "hot_pixel_hz")}
    others = "frames and still windows do not show it; the thresholds and the noise hold for it"
    values |= {key: kept(base[key], others) for key in ("corner_hz_per_a", "amplifier_cutoff_hz", "leak_rate_hz")}
    values |= {"refractory_period_s": kept(base["refractory_period_s"], others)}
    values |= {key: kept(base[key], "as given (--keep)") for key in keep}
    squares = [((c.simulated - c.measured) / c.deviation) ** 2 for c in compared]
    misfit = float(np.sqrt(np.mean(squares))) if squares else None
    corner = base["corner_hz_per_a"]
    corner_hz = Value(light.value * corner, (light.interval[0] * corner, light.interval[1] * corner), 0.0, light.fitted)
    out = Fitted(str(chip), [str(of.file)], values, corner_hz, correlations, compared, misfit, data, simulated, {}, {})
    out.moving[str(of.file)] = moving
    return out


def chip_of(shape: tuple[int, int]) -> str:
    """Name of the profile for frames [height, width]."""
    return "davis240c" if shape == (180, 240) else "davis346"


def _of_frames(of: DavisEvents, moving: Moving, base: dict[str, float]) -> Values:
    """The clock of the frames, as stamped or found."""
    period_s, length_us = 1e-6 * of.period_us, of.end_us - of.begin_us
    exposure_s = 1e-6 * float(np.median(length_us))
    out = {"frame_period_s": Value(period_s, (period_s, period_s), base["frame_period_s"])}
    if exposure_s > 0:
        ends = float(1e-6 * length_us.min()), float(1e-6 * length_us.max())
        out["frame_exposure_s"] = Value(exposure_s, ends, base["frame_exposure_s"])
        rest_s = max(0.0, period_s - exposure_s - 1e-6)
        if rest_s < base["frame_dead_s"]:
            out["frame_dead_s"] = Value(rest_s, (0.0, rest_s), base["frame_dead_s"])
    else:
        out["frame_exposure_s"] = kept(base["frame_exposure_s"], "neither stamps nor bursts show it")
    offset = moving.black * (2 ** base["frame_adc_bits"] - 1)
    out["frame_offset_dn"] = kept(base["frame_offset_dn"], f"the frames have {offset:.0f}, dark current included")
    return out


def _of_motion(moving: Moving, base: dict[str, float]) -> Values:
    out = {}
    for key, of in (
        ("contrast_threshold_on", moving.threshold_on),
        ("contrast_threshold_off", moving.threshold_off),
        ("threshold_mismatch", moving.mismatch),
    ):
        if of is None:
            out[key] = kept(base[key], "too few frames with motion")
            continue
        value, sd = of
        doubt = 1.0 if key == "threshold_mismatch" else moving.doubt
        ends = max(value - NORMAL_95 * sd, 0.0) / doubt, doubt * (value + NORMAL_95 * sd)
        out[key] = Value(value, ends, base[key])
    return out


def _of_hot_pixels(of: DavisEvents, windows: NDArray[np.int64], base: dict[str, float]) -> Values:
    """Counted in still windows, where no exposure has begun or ended (unless one always has)."""
    counts, exposure_us = np.zeros((2, of.shape[0] * of.shape[1]), np.int64), float(np.median(of.end_us - of.begin_us))

    def calm(phase_us: Floats) -> NDArray[np.bool_]:
        since_us = (phase_us - BURST_US[0] - np.array([[0.0], [exposure_us]])) % of.period_us
        return np.all(since_us > AFTER_US - BURST_US[0], axis=0)

    share = float(calm(np.linspace(0, of.period_us, 1000)).mean())
    for k in windows:
        e = of.events[slice(*np.searchsorted(of.events["t"], (of.begin_us[k], of.begin_us[k] + of.period_us)))]
        e = e[calm(e["t"] - of.begin_us[k])] if share > 0 else e
        pixel = e["y"].astype(np.int64) * of.shape[1] + e["x"]
        for i, p in enumerate((1, 0)):
            counts[i] += np.bincount(pixel[e["p"] == p], minlength=counts.shape[1])
    seconds = 1e-6 * of.period_us * len(windows) * (share or 1.0)
    found = hot.find([StillEvents(of.name, 1.0, *counts, seconds)])
    assert found
    is_hot, still = found
    # A hot pixel fires ON at random; one with as many OFF events is noisy.
    is_hot = is_hot & (counts[1] < 0.5 * counts[0]) & (counts[0] > LEAST_HOT)
    if not is_hot.any():
        out = {"hot_pixel_fraction": Value(*hot.share(is_hot), base["hot_pixel_fraction"])}
        return out | {"hot_pixel_hz": kept(base["hot_pixel_hz"], "no hot pixel was found")}
    # Hot pixels with few events are not found: the mean and the number are those of a cut Poisson distribution.
    rate_hz, rates = hot.rate_hz(is_hot, still)
    poisson = optional_module("scipy.stats", "SciPy", "pecs fit", "fit").poisson
    least, mean = int(counts[0][is_hot].min()), float(counts[0][is_hot].mean())
    numbers = np.geomspace(0.3 * mean, mean, 400)
    number = float(
        numbers[np.argmin(np.abs(numbers * poisson.sf(least - 2, numbers) / poisson.sf(least - 1, numbers) - mean))]
    )
    lower, found_share = number / mean, float(poisson.sf(least - 1, number))
    if found_share < LEAST_FOUND:
        few = "those found have as few events as noisy pixels"
        return {key: kept(base[key], few) for key in ("hot_pixel_fraction", "hot_pixel_hz")}
    share, shares = hot.share(is_hot)
    return {
        "hot_pixel_fraction": Value(
            share / found_share, (shares[0], shares[1] / found_share), base["hot_pixel_fraction"]
        ),
        "hot_pixel_hz": Value(rate_hz * lower, (rates[0] * lower**2, rates[1]), base["hot_pixel_hz"]),
    }


class _Still:
    """The search in still windows."""

    KEYS = ("noise_std", "background_on_hz", "background_off_hz", "frame_step", "frame_step_spread")

    def __init__(self, problem: StillProblem, base: dict[str, float], moving: Moving, keep: Sequence[str]):
        start = {key: base[key] or FREE[key][3] for key in self.KEYS} | {LIGHT: WHITE_A}
        start["noise_std"] *= moving.threshold_on[0] / base["contrast_threshold_on"]
        if "threshold_mismatch" not in problem.fixed:
            start["threshold_mismatch"] = base["threshold_mismatch"] or FREE["threshold_mismatch"][3]
        if problem.lamp_hz:
            start |= {FLICKER: FREE[FLICKER][3], PHASE: 0.0}
        problem.fixed |= {key: base[key] for key in keep}
        start = {key: v for key, v in start.items() if key not in keep}
        self.problem, self.base, self.search, self.keys = problem, base, Search(problem, start), list(start)  # type: ignore[arg-type]
        self.search.known = {LIGHT: LIGHT_SD, "frame_step_spread": SPREAD_SD}
        x, covariance = self._run(np.array([forward(key, v) for key, v in start.items()]))
        slopes = self.search.slopes(self.keys, x, both_sides=True)
        self._finish(x, self.search.spread(self.keys, x, slopes, covariance, WIDER), moving)

    def _run(self, x: Floats) -> tuple[Floats, Floats]:
        problem, search, keys = self.problem, self.search, self.keys
        measured = problem.covariance(problem.recorded)
        search.variance = 2 * np.diag(measured) + COARSE_SD**2
        x = self._best_start(x)
        x = search.approach(keys, x, "soft_l1", 8)
        covariance = measured + problem.covariance(problem.simulate(search.values(keys, x)))
        covariance += MODEL_SD**2 * np.eye(len(covariance))
        search.variance = np.diag(covariance)
        return search.refine(keys, x, 4), covariance

    def _best_start(self, x: Floats) -> Floats:
        """The best noise, and the best phase of a lamp, of some: numbers of events depend on them far from linearly."""
        for key, values in (("noise_std", np.geomspace(0.4, 2.0, 7)), (PHASE, np.arange(0, 2 * np.pi, 0.8))):
            if key not in self.keys:
                continue
            i, tried = self.keys.index(key), []
            for v in values:
                at = x.copy()
                at[i] = forward(key, v * self.search.start[key] if key == "noise_std" else v)
                tried.append((float(np.sum(np.log1p(self.search.residuals(self.keys, at) ** 2))), at))
            x = min(tried, key=lambda t: t[0])[1]
        return x

    def _finish(self, x: Floats, spread: Floats, moving: Moving) -> None:
        problem, keys, sd = self.problem, self.keys, np.sqrt(np.diag(spread))
        best = self.search.values(keys, x)
        self.values: Values = {}
        threshold_sd = float(
            np.hypot(moving.threshold_on[1] / moving.threshold_on[0], np.log(moving.doubt) / NORMAL_95)
        )
        for i, key in enumerate(keys):
            more = {"noise_std": float(np.hypot(threshold_sd, HISTORY_SD)), "frame_step": threshold_sd}.get(key, 0.0)
            wide = float(np.hypot(sd[i], more))
            limits = self.search.limits([key])
            ends = [back(key, float(np.clip(x[i] + s * NORMAL_95 * wide, *limits)[0])) for s in (-1, 1)]
            if key.startswith("background"):  # leak, and what pixels still do after motion, are part of it
                ends.append(0.0)
            value = Value(best[key], (min(ends), max(ends)), self.base.get(key, 0.0))
            if FREE[key][0] == "logarithm" and wide > MAX_SD:
                value = kept(self.base.get(key, best[key]), f"still windows hardly show it ({best[key]:.3g})")
            if key == LIGHT:
                self.light = value
            elif key not in (FLICKER, PHASE):
                self.values[key] = value
        step, width = (self.values.get(key) for key in ("frame_step", "frame_step_spread"))
        if step and width and step.fitted and width.fitted:
            of_width = (float(np.exp(LARGE_STEPS * (width.value - end))) for end in width.interval[::-1])
            least, most = (end * factor for end, factor in zip(step.interval, of_width, strict=True))
            self.values["frame_step"] = Value(step.value, (least, most), step.start)
        self.simulated: StillStatistics = problem.simulate(best)
        numbers, deviation = problem.simulated(best), np.sqrt(self.search.variance)
        rows = zip(problem.names, problem.measured, numbers, deviation, strict=True)
        self.compared = [Compared(problem.name, "", n, float(real), float(sim), float(d)) for n, real, sim, d in rows]
        self.correlations = {
            a: {b: float(spread[i, j] / sd[i] / sd[j]) for j, b in enumerate(keys)} for i, a in enumerate(keys)
        }
        self.best = best
