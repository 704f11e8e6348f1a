"""What the moving frames of a DAVIS show of its thresholds.

Between two frames, a pixel's logarithm of light changes by threshold_on times its ON events minus threshold_off times
its OFF events, on any way of the light. A frame is the mean over its exposure: with E(t) the sum of thresholds of the
events until t, ln frame_2 - ln frame_1 = ln mean exp(E) over exposure 2 - ln mean exp(E) over exposure 1 (Pan et al.,
CVPR 2019, whose c is one threshold). Gauss-Newton steps find both thresholds; the frames' value without light is that
with the best correlation. Between two events the light is taken as linear, so that pixels that turn are not biased."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError
from .davis_recording import DavisEvents

BLOCK_PX = 12  # side of the blocks of pixels of the bootstrap
MOST_PIXELS = 6000  # of the moving frames; of the search for exposures
SEARCH_PIXELS = 1500
SAMPLES = 11  # of an exposure
LONG_GAP_US = 5e4  # between events of a pixel: nothing is said of the light within
BRIGHT, DIM = 0.98, 10 / 255  # of the values of frames: not saturated, and above the value without light
BLACKS = np.arange(-32, 64, 4) / 255  # values without light that are tried; below 0: of frames darkened afterwards
BLACK_STEP, LEAST_BLACK_SD = 2 / 255, 1.5 / 255  # for derivatives; of the value without light
DARKEST = 0.02  # share of values that may be below them
BRIGHTER = 0.4  # share of pixels that are too dim for thresholds: they are slow, and depend on the value without light
CLEAR = 0.3  # ln: a clear change
STEPS, LEAST_PAIRS = (1, 2, 3, 4, 6, 8, 12), 12  # between frames that are compared; of these
LOSS = 0.3  # ln, beyond which a pixel counts less
MOST_STEP = 1.6  # period / median period of frames: no frame is missing between them
LEAST_CORRELATION = 0.5
CLEAR_CORRELATION = 0.85  # for the spread over pixels
FULL_CORRELATION = 0.9  # below it, thresholds are uncertain in either direction
BURST_US = 500.0  # bins of the frame clock
LEAST_RATE = 0.02  # of events between exposures, against those during exposures
ROUNDS = 200  # of the bootstrap
SEEN, SEEN_SD = 1.17, 0.08  # mismatch / its estimate, in ten simulated recordings
SYSTEMATIC = 0.04  # of a threshold: see docs/howto/fit_camera.md#a-davis-with-frames

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Moving:
    """Thresholds [ln], their spread over pixels, each with its standard deviation; `black`: the frames' value without
    light (0 to 1); `correlation` of changes of frames with those of events; `mean_changes`: both, in bins."""

    threshold_on: tuple[float, float]
    threshold_off: tuple[float, float]
    mismatch: tuple[float, float] | None
    black: float
    correlation: float
    pairs: int
    mean_changes: tuple[Floats, Floats]
    unseen: float  # share of the time, between exposures, of which the recording has no events

    @property
    def doubt(self) -> float:
        """Thresholds may be larger or smaller by this factor: errors in the changes of events make slopes too small, at
        most by the square of the correlation (regression of events on frames), a wrong value without light larger."""
        return 1.0 if self.correlation > FULL_CORRELATION else self.correlation**-2


def some_pixels(shape: tuple[int, int], most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels of whole blocks, spread over the sensor, and the block of each."""
    height, width = shape
    y, x = np.divmod(np.arange(height * width), width)
    block = (y // BLOCK_PX) * (-(-width // BLOCK_PX)) + x // BLOCK_PX
    order = np.random.default_rng(1).permutation(int(block.max()) + 1)
    count = np.cumsum(np.bincount(block)[order])
    kept = np.sort(order[: max(1, int(np.searchsorted(count, most, "right")))])
    pixels = np.flatnonzero(np.isin(block, kept))
    return pixels, block[pixels]


class Counts:
    """Numbers of ON and OFF events of some pixels until any time, with the part of the next one that is due."""

    def __init__(self, of: DavisEvents, pixels: NDArray[np.int64], refractory_us: float):
        e = of.events
        number = np.full(of.shape[0] * of.shape[1], -1)
        number[pixels] = np.arange(len(pixels))
        pixel = number[e["y"].astype(np.int64) * of.shape[1] + e["x"]]
        kept = pixel >= 0
        pixel, t_us, on = pixel[kept], e["t"][kept].astype(float), e["p"][kept] == 1
        order = np.lexsort((t_us, pixel))
        self.pixel, self.t_us, self.on = pixel[order], t_us[order], on[order]
        self.start = np.searchsorted(self.pixel, np.arange(len(pixels) + 1))
        # The light also changes while a pixel does not see it: as fast as since the last event of the same direction.
        gap_us = np.diff(self.t_us, prepend=-1e18)
        same = np.r_[False, (self.pixel[1:] == self.pixel[:-1]) & (self.on[1:] == self.on[:-1])]
        unseen = np.where(same, gap_us / np.maximum(gap_us - refractory_us, np.maximum(0.5 * gap_us, 1)), 1.0)
        self.size = np.where(same, np.minimum(unseen, 2.0), 1.0)
        self.total = [np.r_[0.0, np.cumsum(self.size * is_on)] for is_on in (self.on, ~self.on)]
        self.base_us = self.t_us.min(initial=0.0) - 1
        self.scale_us = float(np.ptp(self.t_us)) + 1e7
        self.key = self.pixel * self.scale_us + self.t_us - self.base_us

    def until(self, t_us: float) -> Floats:
        """[2, pixels]"""
        first, behind = self.start[:-1], self.start[1:]
        at = np.clip(t_us - self.base_us, 0, self.scale_us - 1)
        index = np.searchsorted(self.key, np.arange(len(first)) * self.scale_us + at, "right")
        index = np.clip(index, first, behind)
        if not len(self.t_us):
            return np.zeros((2, len(first)))
        after, before = np.minimum(index, len(self.t_us) - 1), np.maximum(index - 1, 0)
        gap_us = self.t_us[after] - self.t_us[before]
        within = (index < behind) & (index > first) & (gap_us < LONG_GAP_US) & (gap_us > 0)
        due = np.where(within, (t_us - self.t_us[before]) / np.maximum(gap_us, 1), 0.0) * self.size[after]
        directions = self.on[after], ~self.on[after]
        both = zip(self.total, directions, strict=True)
        return np.stack([total[index] - total[first] + due * is_due for total, is_due in both])


@dataclass
class Changes:
    """Numbers of events [2, frame, sample, pixel] over the exposures, and the frames [frame, pixel]."""

    counts: Floats
    frames: Floats
    pairs: NDArray[np.int64]  # frames k, compared with frames k + step
    block: NDArray[np.int64]  # of each pixel
    step: int = 1

    @property
    def brightness(self) -> Floats:
        """[pair, pixel]"""
        return np.sqrt(self.frames[self.pairs] * self.frames[self.pairs + self.step])

    def uneven(self, black: float) -> float:
        """ln of the ratio of thresholds in dim and in bright pixels, where the light changes much: 0 with the right
        value without light."""
        thresholds, change, measured, known, weight = self.solve(black, 4)
        clear = known & (np.abs(change) > CLEAR)
        if clear.sum() < 300:
            return np.nan
        low, high = np.quantile(self.brightness[clear], (0.4, 0.6))
        of = []
        for mine in (clear & (self.brightness < low), clear & (self.brightness > high)):
            w = weight * mine
            of.append(float((w * change * measured).sum() / (w * change**2).sum()))
        return float(np.log(max(of[0], 1e-3) / max(of[1], 1e-3)))

    def linear(self, thresholds: Floats) -> tuple[Floats, Floats]:
        """Change of ln light between the frames of each pair, [pair, pixel], and its derivatives [2, pair, pixel]."""
        on, off = self.counts
        middle = on.shape[1] // 2
        reference = self.counts[:, :, middle]
        e = thresholds[0] * (on - reference[0][:, None]) - thresholds[1] * (off - reference[1][:, None])
        weight = np.exp(np.clip(e, -4, 4))
        mean = weight.mean(axis=1)
        weight /= weight.sum(axis=1, keepdims=True)
        level = thresholds[0] * reference[0] - thresholds[1] * reference[1] + np.log(mean)
        slopes = np.stack([(weight * on).sum(axis=1), -(weight * off).sum(axis=1)])
        k, m = self.pairs, self.pairs + self.step
        return level[m] - level[k], slopes[:, m] - slopes[:, k]

    def measured(self, black: float, least: float | None = None) -> tuple[Floats, NDArray[np.bool_]]:
        """Of pixels whose geometric mean of both frames is above `least`."""
        a, b = self.frames[self.pairs], self.frames[self.pairs + self.step]
        known = (np.minimum(a, b) > max(black + DIM, 0.0)) & (np.maximum(a, b) < BRIGHT)
        known &= True if least is None else self.brightness > least
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(known, np.log((b - black) / (a - black)), 0.0), known

    def solve(
        self, black: float, rounds: int = 5, least: float | None = None
    ) -> tuple[Floats, Floats, Floats, NDArray[np.bool_], Floats]:
        """Thresholds; their changes, the measured ones, which are known, and the weights."""
        measured, known = self.measured(black, least)
        thresholds = np.array([0.2, 0.2])
        for _ in range(rounds):
            change, slopes = self.linear(thresholds)
            weight = known / (1 + ((measured - change) / LOSS) ** 2)
            normal = np.einsum("ipx,jpx,px->ij", slopes, slopes, weight)
            if not np.linalg.det(normal) > 0:
                break
            step = np.linalg.solve(normal, np.einsum("ipx,px,px->i", slopes, measured - change, weight))
            thresholds = np.clip(thresholds + step, 0.01, 2.0)
        change, _ = self.linear(thresholds)
        weight = known / (1 + ((measured - change) / LOSS) ** 2)
        return thresholds, change, measured, known, weight

    def correlation(self, black: float, rounds: int = 5, least: float | None = None) -> float:
        _, change, measured, known, _ = self.solve(black, rounds, least)
        if known.sum() < 100 or not change[known].std() > 0:
            return 0.0
        return float(np.corrcoef(change[known], measured[known])[0, 1])


def changes(of: DavisEvents, counts: Counts, pixels: NDArray[np.int64], block: NDArray[np.int64]) -> Changes:
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES if (of.end_us > of.begin_us).any() else np.array([0.5])
    times_us = of.begin_us[:, None] + (of.end_us - of.begin_us)[:, None] * share
    number = np.stack([[counts.until(t) for t in row] for row in times_us])  # [frame, sample, 2, pixel]
    frames = of.frames.reshape(len(of.frames), -1)[:, pixels].astype(float)
    return Changes(number.transpose(2, 0, 1, 3), frames, consecutive(of), block)


def consecutive(of: DavisEvents, step: int = 1, exposed: bool = True) -> NDArray[np.int64]:
    """Frames k with events until frame k + step, its exposure included or not, and no frame missing between them."""
    complete = np.diff(of.begin_us) < MOST_STEP * of.period_us
    first, last = float(of.events["t"][0]), float(of.events["t"][-1])
    end_us = of.end_us if exposed else of.begin_us
    inside = (of.begin_us >= first - 0.1 * of.period_us) & (end_us <= last + 0.1 * of.period_us)
    runs = (
        np.lib.stride_tricks.sliding_window_view(complete, step).all(axis=1) if len(complete) >= step else complete[:0]
    )
    return np.flatnonzero(runs & inside[:-step] & inside[step:])


def find_exposures(of: DavisEvents) -> DavisEvents:
    """Exposures of frames of which only instants are known: those between two bursts on the frame clock, or, without
    bursts, of any begin and length, that explain the changes of frames best."""
    if (of.end_us > of.begin_us).any():
        return of
    pixels, block = some_pixels(of.shape, SEARCH_PIXELS)
    counts, period_us, best = Counts(of, pixels, 0.0), of.period_us, (-1.0, of)
    marks = bursts(of)
    bounds = [(a + m * period_us, b) for a in marks for b in marks for m in (-1, 0, 1)] if marks else []
    coarse = np.arange(-1, 1, 0.125) * period_us
    if not bounds:
        bounds = [(float(a), float(a + length * period_us)) for a in coarse for length in (0.02, 0.2, 0.4, 0.7)]
    for begin, end in bounds:
        for shift in (-period_us, 0.0, period_us) if marks else (0.0,):
            if not 0 < end - begin <= period_us:
                continue
            tried = replace(of, begin_us=of.begin_us + begin + shift, end_us=of.begin_us + end + shift)
            found = changes(tried, counts, pixels, block).correlation(15 / 255, 3) if len(consecutive(tried)) else 0
            best = max(best, (found, tried), key=lambda b: b[0])
    return best[1]


def clock(of: DavisEvents, windows: NDArray[np.int64], zero_us: Floats, bin_us: float = BURST_US) -> Floats:
    """Events [2, bin] of a mean window: ON and OFF, over the time since zero_us of the frames."""
    period_us, t_us = of.period_us, of.events["t"].astype(float)
    out = np.zeros((2, round(period_us / bin_us)))
    edges = np.linspace(0, period_us, out.shape[1] + 1)
    for k in windows:
        inside = slice(*np.searchsorted(t_us, (zero_us[k], zero_us[k] + period_us)))
        for i, p in enumerate((1, 0)):
            out[i] += np.histogram(t_us[inside][of.events["p"][inside] == p] - zero_us[k], edges)[0]
    return out / max(1, len(windows))


def bursts(of: DavisEvents) -> list[float]:
    """Times on the frame clock [us] of bursts of ON or of OFF events in the calmest windows."""
    windows = consecutive(of)
    if not len(windows):
        return []
    t_us = of.events["t"].astype(float)
    number = np.diff(np.searchsorted(t_us, np.stack([of.begin_us[windows], of.begin_us[windows + 1]])), axis=0)[0]
    calm = windows[np.argsort(number)[: max(3, len(windows) // 5)]]
    rate = clock(of, calm, of.begin_us)
    out = []
    for mine, other in (rate, rate[::-1]):
        usual = np.median(mine) + 3 * np.sqrt(np.median(mine)) / np.sqrt(len(calm)) + 1
        k = int(np.argmax(mine - other))
        if mine[k] > 2.5 * usual and mine[k] > 3 * other[k]:
            out.append(k * BURST_US)
    return out


def measure_moving(of: DavisEvents, refractory_us: float) -> Moving:
    """Raises PecsInputError where the events do not follow the frames."""
    pixels, block = some_pixels(of.shape, MOST_PIXELS)
    found = changes(of, Counts(of, pixels, refractory_us), pixels, block)
    if not len(found.pairs):
        raise PecsInputError(f"{of.name}: got no two frames with all events between them, wanted at least one pair")
    # Changes of less than a threshold or two say little: frames are compared with the next but one, and so on, as long
    # as the events explain more of the changes.
    coarse = Changes(found.counts[..., ::4], found.frames[:, ::4], found.pairs, found.block[::4])
    by_step = {step: replace(coarse, pairs=consecutive(of, step), step=step) for step in STEPS}
    by_step = {step: c for step, c in by_step.items() if len(c.pairs) >= min(LEAST_PAIRS, len(coarse.pairs))}
    coarse = max(by_step.values(), key=lambda c: c.correlation(15 / 255, 4))
    found = replace(found, pairs=coarse.pairs, step=coarse.step)
    quarters = [replace(found, counts=found.counts[..., i::4], frames=found.frames[:, i::4]) for i in range(4)]
    of_quarters = [_black(quarter) for quarter in quarters]
    black = float(np.mean(of_quarters))
    least = float(np.quantile(found.brightness, BRIGHTER))
    thresholds, change, measured, known, weight = found.solve(black, least=least)
    correlation = float(np.corrcoef(change[known], measured[known])[0, 1]) if known.sum() > 100 else 0.0
    if not correlation > LEAST_CORRELATION:
        why = f"changes of frames that follow those of events with a correlation of {correlation:.2f}"
        raise PecsInputError(
            f"{of.name}: got {why}, wanted at least {LEAST_CORRELATION:g} (moving texture, sharp frames, their times)"
        )
    _, slopes = found.linear(thresholds)
    lower = found.solve(black - BLACK_STEP, least=least)[0]
    by_black = np.abs(thresholds - lower) / BLACK_STEP * max(float(np.std(of_quarters)) / 2, LEAST_BLACK_SD)
    sd = np.hypot(_bootstrap(found.block, slopes, measured - change, weight), by_black)
    edges = np.quantile(change[known], np.linspace(0.01, 0.99, 21))
    bins = np.clip(np.searchsorted(edges, change[known]) - 1, 0, 19)
    size = np.maximum(np.bincount(bins, minlength=20), 1)
    means = (np.bincount(bins, v[known], minlength=20) / size for v in (change, measured))
    spread = _mismatch(slopes * thresholds[:, None, None], measured, weight, found.block, correlation)
    # Pixels with low thresholds have more events, and count more: E(1/t) / E(1/t^2) is t (1 - 2 spread^2).
    mean = thresholds * (1 + 2 * (spread[0] ** 2 if spread else 0.0))
    on, off = ((float(t), float(np.hypot(s, SYSTEMATIC * t))) for t, s in zip(mean, sd, strict=True))
    return Moving(on, off, spread, black, correlation, len(found.pairs), tuple(means), unseen(of))  # type: ignore[arg-type]


def unseen(of: DavisEvents) -> float:
    """Some recordings have events during exposures alone: the share of the time between these, else 0."""
    gaps_us = of.begin_us[1:] - of.end_us[:-1]
    if not (of.end_us > of.begin_us).all() or not (gaps_us > 0).all():
        return 0.0
    first, behind = (np.searchsorted(of.events["t"], t) for t in (of.begin_us, of.end_us))
    rates = (first[1:] - behind[:-1]).sum() / gaps_us.sum(), (behind - first).sum() / (of.end_us - of.begin_us).sum()
    share = float(gaps_us.sum() / (of.begin_us[-1] - of.begin_us[0]))
    return share if rates[0] < LEAST_RATE * rates[1] else 0.0


def _black(of: Changes) -> float:
    """The frames' value without light: where dim and bright pixels have the same thresholds."""
    darkest = float(np.quantile(of.frames, DARKEST))
    blacks = BLACKS[BLACKS <= max(darkest, DIM)]
    below = np.nan
    for k, black in enumerate(blacks):
        uneven = of.uneven(float(black))
        if uneven > 0:
            return float(np.interp(0.0, [below, uneven], blacks[k - 1 : k + 1])) if k and below < 0 else float(black)
        below = uneven
    return float(blacks[-1])


def _bootstrap(block: NDArray[np.int64], slopes: Floats, misses: Floats, weight: Floats) -> Floats:
    """Standard deviation of the thresholds, by drawing blocks of pixels and pairs of frames."""
    _, block = np.unique(block, return_inverse=True)
    size = int(block.max()) + 1

    def of_blocks(values: Floats) -> Floats:  # [..., pair, block]
        flat = values.reshape(-1, values.shape[-1])
        return np.stack([np.bincount(block, v, minlength=size) for v in flat]).reshape(*values.shape[:-1], size)

    normal = of_blocks(slopes[:, None] * slopes[None] * weight)
    down = of_blocks(slopes * misses * weight)
    random, steps = np.random.default_rng(1), []
    for _ in range(ROUNDS):
        blocks = np.bincount(random.integers(0, size, size), minlength=size).astype(float)
        pairs = np.bincount(random.integers(0, misses.shape[0], misses.shape[0]), minlength=misses.shape[0])
        a, b = (np.einsum("...pb,p,b->...", v, pairs.astype(float), blocks) for v in (normal, down))
        steps.append(np.linalg.lstsq(a, b, rcond=None)[0])
    sd: Floats = np.std(steps, axis=0)
    return sd


def _mismatch(
    parts: Floats, measured: Floats, weight: Floats, block: NDArray[np.int64], correlation: float
) -> tuple[float, float] | None:
    """Relative spread of the thresholds over pixels. Each pixel's two thresholds come from both halves of the
    recording, whose errors are independent: their covariance is the variance over pixels."""
    pairs, halves = measured.shape[0], []
    if pairs < 8 or correlation < CLEAR_CORRELATION:
        return None
    for first in (0, 1):
        own = np.zeros((pairs, 1))
        own[np.arange(pairs) * 2 // pairs == first] = 1
        normal = np.einsum("ipx,jpx,px->xij", parts, parts, weight * own)
        down = np.einsum("ipx,px,px->xi", parts, measured, weight * own)
        least = np.linalg.eigvalsh(normal)[:, 0]
        factor = np.full((len(least), 2), np.nan)
        known = least > 0.3  # (ln)^2: at least some thresholds in both directions
        if known.sum() < 200:
            return None
        factor[known] = np.linalg.solve(normal[known], down[known][..., None])[..., 0]
        halves.append(factor)
    known = np.isfinite(halves[0] + halves[1]).all(axis=1)
    a, b = (np.clip(half[known], 0.3, 2.0) for half in halves)
    _, group = np.unique(block[known], return_inverse=True)
    if len(a) < 200:
        return None

    def spread(some: NDArray[Any]) -> float:
        mine = np.concatenate([(a[some] - a[some].mean(0)) * (b[some] - b[some].mean(0))])
        return float(np.sqrt(max(mine.mean(), 0.0)))

    random, size = np.random.default_rng(1), int(group.max()) + 1
    members = [np.flatnonzero(group == g) for g in range(size)]
    drawn = [spread(np.concatenate([members[g] for g in random.integers(0, size, size)])) for _ in range(60)]
    value = SEEN * spread(np.arange(len(a)))
    return value, float(np.hypot(SEEN * np.std(drawn), SEEN_SD * value))


def refractory_us(of: DavisEvents, most_us: float) -> float:
    """At most the profile's, and at most the shortest gap that a thousandth of the events have."""
    pixel = of.events["y"].astype(np.int64) * of.shape[1] + of.events["x"]
    order = np.argsort(pixel, kind="stable")
    gap = np.diff(of.events["t"][order])[np.diff(pixel[order]) == 0]
    return float(min(most_us, np.quantile(gap, 0.001))) if len(gap) else 0.0
