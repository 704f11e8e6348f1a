"""Recordings of a camera for a fit: read, checked against what was shown, and cut at the switches of the light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError
from ..events import Events, read
from . import stimulus

REGION_PX = 64  # side of the default region
SKIPPED = 0.1  # share at the start of a recording in still light: cameras need time after they are switched on
BIN_US = 500.0  # of the rates in which switches are found
SCREEN_BIN_US = 2000.0  # the same for a screen, which takes a refresh to change
FLASHED_US = 6e4  # behind an edge of a flash: its events
MOST_LEVELS, MOST_RATIO = 64, 1e7  # 140 dB: more than any pixel's range
MIN_CYCLES = 4  # complete ones, of which the first is not used
MOST_NOISE_HZ = 20.0  # per pixel in still light
SAME_US, TOGETHER = 2000.0, 3.0  # largest variance / mean of numbers of events in such times; pairs of a pixel: 2
OPPOSITE = 0.2  # largest share of events against the direction of a switch
FLICKER_HZ, FLICKERS, CHANCE = (40.0, 1200.0), 0.1, 25.0  # searched; least share of events that follow it, and power
UNSTEADY = 5.0  # largest ratio of rates within a recording in still light; noise itself falls for seconds
IN_ROWS = 0.5  # largest share of the variance of first events that lies between rows
Place = tuple[int, int, int, int]  # x, y, width, height of a region


@dataclass(frozen=True)
class Steps:
    """A recording of a light that switches through `levels`, relative to level 1, again and again. `edges_us`: times of
    the switches on the recording's clock [us], beginning with the one to `levels[0]` (default: found in the events)."""

    file: str | Path
    levels: tuple[float, ...]
    edges_us: Sequence[float] | None = None


@dataclass(frozen=True)
class Still:
    """A recording of constant light. `level`: light relative to level 1; 0 with the cap on."""

    file: str | Path
    level: float


@dataclass(frozen=True)
class Stimulus:
    """A recording of a screen that plays the page of `pecs stimulus`."""

    file: str | Path


@dataclass(frozen=True)
class Flash:
    """A recording of a bright lamp that switches on and off before the whole sensor."""

    file: str | Path


@dataclass(frozen=True)
class Disk:
    """A recording of a turning disk of equal black and white sectors, whose rim is in view. `contrast`: light of white
    sectors / light of black ones (12: the printed disk of scenes/rotating_disk)."""

    file: str | Path
    contrast: float = 12.0


@dataclass(frozen=True)
class Screen:
    """The screen as the flashes of a recording of Stimulus show it: its refresh rate [Hz], None if they do not come
    at multiples of a period; time from the first to the last tenth of the events when a flash begins [s]; delay [s]
    from the left to the right edge of the region, and from its upper to its lower edge."""

    refresh_hz: float | None
    change_s: float
    across_s: tuple[float, float]

    def __str__(self) -> str:
        refresh = "unknown" if self.refresh_hz is None else f"{self.refresh_hz:.1f} Hz"
        x, y = (1e3 * v for v in self.across_s)
        change = f"changes within {1e3 * self.change_s:.1f} ms"
        return f"refresh {refresh}, {change}, {x:+.1f} ms to the right, {y:+.1f} ms down"


@dataclass(frozen=True)
class StepEvents:
    """A recording of Steps or of ramps, cut at the switches: switch c leads to levels[c % len(levels)]."""

    name: str
    levels: tuple[float, ...]
    pixel: NDArray[np.int64]  # of each event, within the region
    t_us: NDArray[np.float64]
    on: NDArray[np.bool_]
    pixels: int
    edges_us: NDArray[np.float64]  # of the switches, and the end of the last one; early by at most a few bins if found
    lengths_us: NDArray[np.float64]  # of the light at each level
    exact: bool  # the times of the switches are known
    ramps_us: NDArray[np.float64] | None = None  # durations of ramps, each in the middle of lengths_us; None: steps
    place: Place | None = None  # the region; None: simulated

    def without(self, hot: NDArray[np.bool_]) -> StepEvents:
        number, keep = np.cumsum(~hot) - 1, ~hot[self.pixel]
        pixel, t_us, on = number[self.pixel[keep]], self.t_us[keep], self.on[keep]
        return replace(self, pixel=pixel, t_us=t_us, on=on, pixels=int((~hot).sum()))


@dataclass(frozen=True)
class StillEvents:
    """A recording of Still: events of each pixel of the region."""

    name: str
    level: float
    on: NDArray[np.int64]
    off: NDArray[np.int64]
    seconds: float

    @property
    def pixels(self) -> int:
        return len(self.on)

    def without(self, hot: NDArray[np.bool_]) -> StillEvents:
        return replace(self, on=self.on[~hot], off=self.off[~hot])


def _refuse(file: str | Path, got: str, wanted: str) -> PecsInputError:
    return PecsInputError(f"{file}: got {got}, wanted {wanted}")


def region_of(width: int, height: int) -> Place:
    """The default region, in the centre."""
    w, h = min(width, REGION_PX), min(height, REGION_PX)
    return (width - w) // 2, (height - h) // 2, w, h


def events_of(file: str | Path) -> Events:
    """One or more."""
    events = read(file, late="sort")
    if not len(events):
        raise _refuse(file, "no events", "a recording")
    return events


def _load(file: str | Path, region: Sequence[int] | None, least: int = 0) -> tuple[Events, Events, Place]:
    """All events, those of the region, which are `least` or more, and the region."""
    events = events_of(file)
    width, height = events.width or int(events["x"].max()) + 1, events.height or int(events["y"].max()) + 1
    x, y, w, h = region or region_of(width, height)
    if x < 0 or y < 0 or w < 1 or h < 1 or x + w > width or y + h > height:
        raise _refuse(file, f"region {x},{y},{w},{h}", f"a region within {width}x{height} pixels")
    if w * h < 100:
        raise _refuse(file, f"{w * h} pixels", "a region of at least 100 pixels")
    inside = (events["x"] >= x) & (events["x"] < x + w) & (events["y"] >= y) & (events["y"] < y + h)
    if (count := int(inside.sum())) < least:
        raise _refuse(file, f"{count} events in the region {x},{y},{w},{h}", f"{least} or more")
    return events, events[inside], (x, y, w, h)


def _pixels(events: Events, region: Place) -> NDArray[np.int64]:
    x, y, w, _ = region
    pixel: NDArray[np.int64] = (events["y"].astype(np.int64) - y) * w + (events["x"].astype(np.int64) - x)
    return pixel


def load_still(of: Still, region: Sequence[int] | None = None) -> StillEvents:
    """Raises PecsInputError for light that is not still."""
    if not np.isfinite(of.level) or of.level < 0:
        raise _refuse(of.file, f"level {of.level:g}", "a number from 0 on")
    everything, events, place = _load(of.file, region)
    return _still_events(of, events, place, float(everything["t"][0]), float(everything["t"][-1]))


def load_still_everywhere(of: Still) -> tuple[StillEvents, Place]:
    """Counts of all events, and the smallest region that contains them: x, y, width, height."""
    events = events_of(of.file)
    (left, right), (top, bottom) = ((int(events[k].min()), int(events[k].max())) for k in "xy")
    place = left, top, right - left + 1, bottom - top + 1
    return _still_events(of, events, place, float(events["t"][0]), float(events["t"][-1])), place


def _still_events(of: Still, events: Events, place: Place, first: float, last: float) -> StillEvents:
    file = of.file
    begin = first + SKIPPED * (last - first)
    seconds = (last - begin) * 1e-6
    if seconds < 0.5:
        raise _refuse(file, f"{(last - first) * 1e-6:.2g} s", "a recording of at least 1 s")
    kept = events[(events["t"] >= begin) & (events["t"] <= last)]
    pixel, pixels = _pixels(kept, place), place[2] * place[3]
    _check_flicker(file, kept["t"], begin, last)
    _check_steady(file, kept, pixel, pixels, begin, last)
    _check_motion(file, kept, pixels, last - begin)
    counts = [np.bincount(pixel[kept["p"] == p], minlength=pixels) for p in (1, 0)]
    return StillEvents(Path(file).name, of.level, *counts, seconds)


def _check_flicker(file: str | Path, times: NDArray[Any], begin: float, end: float) -> None:
    """No frequency that many events follow: dimmed lamps and screens are pulsed."""
    seconds = (end - begin) * 1e-6
    counts = np.histogram(times, max(1, int(seconds * 4 * FLICKER_HZ[1])), (begin, end))[0]
    low, high = (round(hz * seconds) for hz in FLICKER_HZ)
    lines = np.abs(np.fft.rfft(counts))[low : high + 1]
    peak, total = float(lines.max(initial=0)), max(1, len(times))
    if peak**2 / total > CHANCE and 2 * peak / total > FLICKERS:
        hz = (low + int(lines.argmax())) / seconds
        share = 100 * min(1.0, 2 * peak / total)
        got = f"events that come with {hz:.1f} Hz ({share:.0f} % of them)"
        raise _refuse(file, got, "still light (a dimmed screen or lamp is pulsed: set it to full brightness)")


def _check_steady(
    file: str | Path, events: Events, pixel: NDArray[np.int64], pixels: int, begin: float, end: float
) -> None:
    """Typical pixels fire seldom, each for itself, and at the same rate at all times."""
    counts = np.bincount(pixel, minlength=pixels)
    rate_hz = float(np.median(counts)) / (end - begin) * 1e6
    if rate_hz > MOST_NOISE_HZ:
        got = f"{rate_hz:.3g} events per pixel and second"
        raise _refuse(file, got, f"at most {MOST_NOISE_HZ:g} in still light (the camera moves, or the lamp flickers)")
    typical = counts <= np.quantile(counts, 0.99) + 5  # a hot pixel may blink
    times = events["t"][typical[pixel]]
    in_bins = np.histogram(times, max(2, int((end - begin) / SAME_US)), (begin, end))[0]
    dispersion = float(np.mean(np.diff(in_bins) ** 2) / 2 / max(in_bins.mean(), 1e-9))
    if len(times) > 100 and dispersion > TOGETHER:
        got = (
            f"numbers of events in {SAME_US / 1e3:g} ms with {dispersion:.1f} times the variance of independent pixels"
        )
        raise _refuse(file, got, "still light (the lamp flickers, or the camera moves)")
    in_eighths = np.histogram(times, 8, (begin, end))[0].astype(float)
    low, high = in_eighths.min(), in_eighths.max()
    if high > UNSTEADY * (low + 6 * np.sqrt(low + 1)):
        span = (end - begin) * 1e-6 / 8 * pixels
        raise _refuse(
            file,
            f"{low / span:.3g} to {high / span:.3g} events per pixel and second in eighths of the recording",
            "still light (the light changes, or the camera moves)",
        )


def _check_motion(file: str | Path, events: Events, pixels: int, length_us: float) -> None:
    """Noise of neighbours is independent: few events of one polarity come within 2 ms at adjacent pixels of a row."""
    near, window_us = 0, 2000.0
    for p in (0, 1):
        of = events[events["p"] == p]
        order = np.lexsort((of["t"], of["y"]))
        t, x, y = (of[k][order].astype(np.int64) for k in "txy")
        for shift in (1, 2, 3):
            if len(t) > shift:
                close = (y[shift:] == y[:-shift]) & (t[shift:] - t[:-shift] < window_us)
                near += int((close & (np.abs(x[shift:] - x[:-shift]) == 1)).sum())
    # Pairs of adjacent pixels, each with Poisson events of half the mean rate per polarity.
    per_pixel = len(events) / pixels / 2
    expected = 2 * pixels * per_pixel**2 * 2 * window_us / length_us
    if near > 5 * expected + 0.1 * len(events) + 20:
        raise _refuse(
            file,
            f"{near} pairs of events at neighbouring pixels within 2 ms where independent pixels have {expected:.0f}",
            "still light (the camera or something in view moves, or the lamp flickers)",
        )


def load_steps(of: Steps, region: Sequence[int] | None = None) -> StepEvents:
    """Raises PecsInputError for switches that are not those of the levels."""
    levels = tuple(map(float, of.levels))
    if len(levels) < 2 or not all(np.isfinite(v) and v > 0 for v in levels):
        raise _refuse(of.file, f"levels {_listed(levels)}", "at least two levels above 0")
    if len(levels) > MOST_LEVELS or max(levels) > MOST_RATIO * min(levels):
        wanted = f"at most {MOST_LEVELS} levels, none above {MOST_RATIO:g} times another"
        raise _refuse(of.file, f"{len(levels)} levels {_listed(levels)}", wanted)
    if any(a == b for a, b in zip(levels, (*levels[1:], levels[0]), strict=True)):
        raise _refuse(of.file, f"levels {_listed(levels)}", "levels that differ from their neighbours")
    _, events, place = _load(of.file, region, 2)
    pixels = place[2] * place[3]
    t_us, on = events["t"].astype(float), events["p"] == 1
    if of.edges_us is None:
        edges, rises = _find_edges(of.file, t_us, on, pixels)
        edges, rises = _in_phase(of.file, levels, edges, rises, t_us, pixels)
    else:
        edges = np.asarray(of.edges_us, float)
        if edges[0] > t_us[-1] or edges[-1] < t_us[0]:
            wanted = f"times within the recording's {t_us[0]:g} to {t_us[-1]:g} us"
            raise _refuse(of.file, f"switches (--edges) from {edges[0]:g} to {edges[-1]:g} us", wanted)
    cycles = (len(edges) - 1) // len(levels)
    if cycles < MIN_CYCLES:
        raise _refuse(of.file, f"{cycles} complete cycles of {len(levels)} levels", f"at least {MIN_CYCLES}")
    edges = edges[: cycles * len(levels) + 1]
    lengths = np.diff(edges).reshape(cycles, len(levels))
    if (np.ptp(lengths, axis=0) > 0.1 * lengths.mean(axis=0) + 2 * BIN_US).any():
        worst = int(np.argmax(np.ptp(lengths, axis=0)))
        low, high = lengths[:, worst].min() / 1e3, lengths[:, worst].max() / 1e3
        raise _refuse(of.file, f"light at level {levels[worst]:g} for {low:.3g} to {high:.3g} ms", "equal lengths")
    exact = of.edges_us is not None
    kept = (t_us >= edges[0]) & (t_us < edges[-1])
    pixel = _pixels(events, place)[kept]
    out = StepEvents(
        Path(of.file).name, levels, pixel, t_us[kept], on[kept], pixels, edges, np.median(lengths, axis=0), exact,
        place=place,
    )  # fmt: skip
    sizes = np.histogram(out.t_us, edges)[0] / pixels
    _check_alike(of.file, levels, [sizes[i :: len(levels)] for i in range(len(levels))])
    _check_steps(of.file, out, place[2])
    return out


def _find_edges(
    file: str | Path, t_us: NDArray[np.float64], on: NDArray[np.bool_], pixels: int, bin_us: float = BIN_US
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Times and directions of bursts in which most pixels fire."""
    count = max(2, int(np.ceil((t_us[-1] - t_us[0]) / bin_us)))
    span = (t_us[0], t_us[0] + count * bin_us)
    signed = np.histogram(t_us[on], count, span)[0] - np.histogram(t_us[~on], count, span)[0]
    least = max(0.02 * pixels, 0.05 * float(np.quantile(np.abs(signed), 0.99)))
    active = np.flatnonzero(np.abs(signed) > least)
    starts, ends = [], []
    for bin_ in active:
        if starts and np.sign(signed[bin_]) == np.sign(signed[starts[-1]]) and bin_ - ends[-1] <= 6:
            ends[-1] = bin_
        else:
            starts.append(bin_)
            ends.append(bin_)
    bursts = [(a, b) for a, b in zip(starts, ends, strict=True) if np.abs(signed[a : b + 1].sum()) > 0.3 * pixels]
    if len(bursts) < 2:
        raise _refuse(
            file, f"{len(bursts)} switches of the light", "a light that switches, seen by all pixels of the region"
        )
    # Bins in which the first pixels fire lie below `least`.
    edges = span[0] + bin_us * (np.array([a for a, _ in bursts]) - 2.0)
    return edges, np.array([signed[a : b + 1].sum() > 0 for a, b in bursts])


def _in_phase(
    file: str | Path,
    levels: tuple[float, ...],
    edges: NDArray[np.float64],
    rises: NDArray[np.bool_],
    t_us: NDArray[np.float64],
    pixels: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """From the first switch to levels[0] on."""
    k = len(levels)
    change = np.log(np.array(levels) / np.roll(levels, 1))  # of the switch to each level
    sizes = np.histogram(t_us, np.append(edges, t_us[-1] + 1))[0] / pixels
    fits = [s for s in range(k) if all(rises[s + i] == (change[i % k] > 0) for i in range(len(rises) - s))]
    fits = [s for s in fits if len(rises) - s >= k]
    words = "".join("+" if rise else "-" for rise in rises[: 3 * k])
    wanted = "".join("+" if c > 0 else "-" for c in change)
    if not fits:
        raise _refuse(
            file, f"switches {words} (up, down)", f"{wanted} again and again, for {k} levels {_listed(levels)}"
        )

    def likeness(s: int) -> float:
        mean = np.array([sizes[s + i : -1 : k].mean() for i in range(k)])
        return -float(np.abs(mean / mean.sum() - np.abs(change) / np.abs(change).sum()).sum())

    shift = max((s for s in fits if len(sizes) - 1 - s >= k), key=likeness, default=fits[0])
    if k > 2 and likeness(shift) < -0.5:
        sizes_of = ", ".join(f"{sizes[shift + i : -1 : k].mean():.1f}" for i in range(k))
        raise _refuse(file, f"{sizes_of} events per pixel", f"numbers in proportion to the steps of {_listed(levels)}")
    return edges[shift:], rises[shift:]


def _check_alike(file: str | Path, levels: tuple[float, ...], sizes: Sequence[NDArray[np.float64]]) -> None:
    """Numbers of events per pixel of the switches to each level."""
    for level, of in zip(levels, sizes, strict=True):
        if len(of) > 2 and np.ptp(of[1:]) > 0.25 * of.mean() + 0.5:
            raise _refuse(
                file,
                f"switches to level {level:g} with {of[1:].min():.1f} to {of[1:].max():.1f} events per pixel",
                f"equal ones (more levels than the {len(levels)} of {_listed(levels)}, or other light that changes)",
            )


def _listed(levels: tuple[float, ...]) -> str:
    return ",".join(f"{level:g}" for level in levels[:8]) + ",…" * (len(levels) > 8)


def _check_directions(file: str | Path, of: StepEvents) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Switch before each event, and whether it goes up."""
    k = len(of.levels)
    switch = np.searchsorted(of.edges_us, of.t_us, "right") - 1
    up = np.array([b > a for a, b in zip((of.levels[-1], *of.levels[:-1]), of.levels, strict=True)])[switch % k]
    against = float((of.on != up).mean())
    if against > OPPOSITE:
        raise _refuse(
            file,
            f"{100 * against:.0f} % of all events against the direction of the switch before them",
            f"at most {100 * OPPOSITE:.0f} % (the camera moves, the lamp flickers, or room light changes)",
        )
    return switch, up


def _check_steps(file: str | Path, of: StepEvents, width: int) -> None:
    k = len(of.levels)
    switch, up = _check_directions(file, of)
    shares = []
    for c in range(k, len(of.edges_us) - 1):
        mine = np.flatnonzero((switch == c) & (of.on == up))
        which, first = np.unique(of.pixel[mine], return_index=True)
        delay, row = of.t_us[mine][first], which // width
        delay = np.minimum(delay, np.quantile(delay, 0.95)) if len(delay) else delay
        rows = np.bincount(row)
        mean = np.bincount(row, delay)[rows > 0] / rows[rows > 0]
        if len(delay) > 100 and np.var(delay) > 4.0:  # of whole us
            shares.append(float(np.average((mean - delay.mean()) ** 2, weights=rows[rows > 0]) / np.var(delay)))
    if shares and np.median(shares) > IN_ROWS:
        raise _refuse(
            file,
            f"first events whose times differ by row ({100 * np.median(shares):.0f} % of their variance)",
            "independent pixels (the readout is saturated: set a smaller region of interest in the camera)",
        )


def load_stimulus(of: Stimulus, region: Sequence[int] | None = None) -> tuple[StepEvents, Screen]:
    """The ramps, and the screen. Still light is only checked: its noise depends on the light before. Raises
    PecsInputError for flashes that are not those of the page."""
    _, events, place = _load(of.file, region, 2)
    t_us, on = events["t"].astype(float), events["p"] == 1
    edges, rises = _find_edges(of.file, t_us, on, place[2] * place[3], SCREEN_BIN_US)
    found = stimulus.sections(edges, rises)
    wanted = list(stimulus.SECTIONS.values())
    if not found:  # pulses hide flashes
        _check_flicker(of.file, t_us, t_us[0], t_us[-1])
    if [f.section for f in found] != wanted:
        raise _refuse(
            of.file,
            f"{len(found)} of {len(wanted)} sections, announced by flashes, among {len(edges)} changes of the light",
            "a screen that plays the page of `pecs stimulus` from its beginning to its end",
        )
    ramps, still = found
    margin_us = 1e6 * stimulus.TOLERANCE_S
    begin, end = still.begin_us + margin_us, still.begin_us + 1e6 * still.section.seconds - margin_us
    _still_events(Still(of.file, still.section.levels[0]), events, place, begin, end)
    flashes = np.concatenate([np.arange(len(edges))[f.flashes] for f in found])
    screen = _screen(edges[flashes], rises[flashes], events, place)
    return _ramps(of.file, ramps.section, events, place, ramps.begin_us), screen


def _screen(edges: NDArray[np.float64], rises: NDArray[np.bool_], events: Events, place: Place) -> Screen:
    """From the events behind the flashes' edges."""
    t_us, on = events["t"].astype(float), events["p"] == 1
    x, y, w, h = place
    where = np.stack([(events["x"] - x + 0.5) / w - 0.5, (events["y"] - y + 0.5) / h - 0.5], axis=1)
    behind, at, middles = [], [], ([], [])
    for edge, rise in zip(edges, rises, strict=True):
        of = (t_us >= edge) & (t_us < edge + FLASHED_US) & (on == rise)
        middle = float(np.median(t_us[of]))
        middles[int(rise)].append(middle)
        if rise:
            behind.append(t_us[of] - t_us[of].mean())
            at.append(where[of] - where[of].mean(axis=0))
    times, places = np.concatenate(behind), np.concatenate(at)
    across = np.linalg.lstsq(places, times, rcond=None)[0]
    first, last = np.quantile(times - places @ across, (0.1, 0.9))
    refresh = stimulus.refresh_hz([np.array(m) for m in middles])
    return Screen(refresh, float(last - first) * 1e-6, (float(across[0]) * 1e-6, float(across[1]) * 1e-6))


def _ramps(file: str | Path, section: stimulus.Section, events: Events, place: Place, begin: float) -> StepEvents:
    k, cycles = len(section.levels), stimulus.CYCLES
    ramps = 1e6 * np.array(section.ramps_s)
    lengths = ramps + 1e6 * stimulus.HOLD_S
    edges = begin + np.concatenate([[0.0], np.cumsum(np.tile(lengths, cycles))])
    kept = events[(events["t"] >= edges[0]) & (events["t"] < edges[-1])]
    out = StepEvents(
        Path(file).name,
        section.levels,
        _pixels(kept, place),
        kept["t"].astype(float),
        kept["p"] == 1,
        place[2] * place[3],
        edges,
        lengths,
        False,
        ramps,
        place,
    )
    _check_directions(file, out)
    sizes = np.histogram(out.t_us, edges)[0] / out.pixels
    _check_alike(file, section.levels, [sizes[i::k] for i in range(k)])
    return out
