"""A recording of a turning disk of equal black and white sectors, and what the sensor gives before such a disk.

The disk is computed, not rendered: a pixel sees white, then black, for half a period each. The light of each region of
`pecs.delays` is not known and follows from the number of its events, so a chip is constrained by the distributions of
the delays behind ON and OFF edges and by the share of ON events."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._config import parse_json
from .._errors import PecsError, PecsInputError
from .._program import program
from ..events import Events, read
from ..metrics import delays
from .recordings import Disk, StillEvents

GROUPS = (10, 6)  # of pixels, by x and y modulo these, for the jackknife
LEAST_EVENTS = 5000  # behind edges
SHARES = (0.02, 0.06, 0.12, *np.arange(0.2, 0.95, 0.1))  # of the recorded events, between bins that count together
BESIDE_PX = 34.0  # distance from the rim of pixels that count as background
RPM = 3.0, 1e5  # of disks on motors
UNSURE = 0.003  # largest deviation of an edge, relative to the period
NONE = 1e-3  # events per edge, so that logarithms exist
WIDE = np.geomspace(0.05, 200.0, 42)  # corner of the photoreceptor in white, times the period
LIGHT_STEP, MOST_LIGHTS = 0.2, 24  # of the simulated light: largest step in ln, number

Floats = NDArray[np.float64]
Some = NDArray[Any] | None  # numbers of some groups; None: all


@dataclass(frozen=True)
class DiskEvents:
    """A recording of Disk, by groups of pixels, regions of the disk, ON and OFF, and bins of delay."""

    name: str
    file: str
    contrast: float
    sectors: int
    speed_deg_s: float
    white: float  # its share of a period
    count: Floats  # [group, polarity, bin] of events
    region_count: Floats  # [group, region] of events
    passes: Floats  # [region, polarity, bin]: pixels times passing edges
    regions: tuple[int, int]  # around and along the radius
    bins_deg: Floats  # edges of the bins
    beside: StillEvents | None  # pixels beside the disk

    @property
    def period_us(self) -> float:
        return 720e6 / self.sectors / abs(self.speed_deg_s)

    @cached_property
    def background(self) -> Floats:
        """Events per pixel and bin [polarity, 1]."""
        if self.beside is None:
            return np.zeros((2, 1))
        counts = np.array([[self.beside.on.mean()], [self.beside.off.mean()]])
        bin_s: float = (self.bins_deg[1] - self.bins_deg[0]) / abs(self.speed_deg_s)
        return counts / self.beside.seconds * bin_s

    @cached_property
    def cuts(self) -> list[NDArray[np.int64]]:
        """For each polarity the first of the bins of `pecs.delays` that count together, and the end of the last."""
        out = []
        for of in self.count.sum(axis=0):
            shares = np.cumsum(of) / max(of.sum(), 1.0)
            inner = np.searchsorted(shares, SHARES) + 1
            out.append(np.unique(np.concatenate([[0], inner[inner < len(of)], [len(of)]])))
        return out


@dataclass(frozen=True)
class DiskStatistics:
    """The simulated pixel in the steady state of a period, by light."""

    corner_hz: Floats  # of the photoreceptor in white
    per_edge: Floats  # [group, light, polarity, bin] of events

    def mean(self, some: Some = None) -> Floats:
        mean: Floats = (self.per_edge if some is None else self.per_edge[some]).mean(axis=0)
        return mean


def load_disk(of: Disk) -> DiskEvents:
    """Raises PecsError for a recording in which `pecs align detect` finds no disk."""
    if not np.isfinite(of.contrast) or of.contrast <= 1:
        raise PecsInputError(f"{of.file}: got contrast {of.contrast:g}, wanted white / black above 1")
    found, events = _detect(of.file), read(of.file, late="sort")
    events["t"] -= (begin := int(events["t"][0]))
    found["phase_time_us"] -= begin
    duration_us = int(events["t"][-1]) + 1
    group = events["x"] % GROUPS[0] + GROUPS[0] * (events["y"] % GROUPS[1])
    size = {"width": events.width or int(events["x"].max()) + 1, "height": events.height or int(events["y"].max()) + 1}
    parts = [
        delays(events[group == g], disk=found, duration_us=duration_us, **size) for g in range(int(np.prod(GROUPS)))
    ]
    regions, period_deg = parts[0]["regions"], 720 / found["sectors"]
    on_deg, off_deg, speed_deg_s = (float(found[k]["value"]) for k in ("on_edge_deg", "off_edge_deg", "speed_deg_s"))
    white = (on_deg - off_deg) * np.sign(speed_deg_s) % period_deg / period_deg
    passes = np.stack([parts[0][p]["passes"] for p in ("on", "off")], axis=1)
    per_edge = np.array([[part[p]["histogram"] for p in ("on", "off")] for part in parts])
    count = per_edge * passes.sum(axis=0)
    if count.sum() < LEAST_EVENTS:
        raise PecsInputError(f"{of.file}: got {count.sum():.0f} events behind edges, wanted {LEAST_EVENTS}")
    return DiskEvents(
        Path(of.file).name, str(of.file), of.contrast, int(found["sectors"]), speed_deg_s, white,
        count, np.array([part["regions"]["events"] for part in parts]), passes, (regions["around"], regions["along"]),
        np.array(parts[0]["bin_edges_deg"]), _beside(Path(of.file).name, events, found, size, duration_us),
    )  # fmt: skip


def _detect(file: str | Path) -> dict[str, Any]:
    done = subprocess.run([program(), "align", "detect", str(file), "--json"], capture_output=True, text=True)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith("pecs: ")] or [f"pecs: {file}: no disk"]
        raise PecsError(lines[-1].removeprefix("pecs: "), done.returncode)
    found: dict[str, Any] = parse_json(done.stdout, "pecs align disk")
    if not found.get("rim"):
        raise PecsInputError(f"{file}: got a disk without rim, wanted one whose rim is in view")
    rpm = float(found["speed_deg_s"]["value"]) / 6
    if not RPM[0] <= abs(rpm) <= RPM[1]:
        raise PecsInputError(f"{file}: got a disk at {rpm:.3g} rpm, wanted {RPM[0]:g} to {RPM[1]:g} (times in us?)")
    period_deg = 720 / found["sectors"]
    unsure_deg = max(float(found[edge]["deviation"]) for edge in ("on_edge_deg", "off_edge_deg"))
    if found["on_starts_sharply"] or found["off_starts_sharply"] or unsure_deg > UNSURE * period_deg:
        raise PecsInputError(
            f"{file}: got pixels that are done with an edge before the next one arrives, so that the edges are known "
            "within a latency only, wanted a faster disk or dimmer light"
        )
    return found


def _beside(
    name: str, events: Events, found: dict[str, Any], size: dict[str, int], duration_us: int
) -> StillEvents | None:
    """Events of pixels that see no edge."""
    y, x = np.mgrid[: size["height"], : size["width"]] + 0.5
    away = np.hypot(x - found["centre_x"]["value"], y - found["centre_y"]["value"])
    number = np.flatnonzero(away > max(found["rim"]["axis_a_px"], found["rim"]["axis_b_px"]) / 2 + BESIDE_PX)
    if not len(number):
        return None
    pixel = events["y"].astype(np.int64) * size["width"] + events["x"]
    counts = [np.bincount(pixel[events["p"] == p], minlength=away.size)[number] for p in (1, 0)]
    return StillEvents(name, 0.0, *counts, duration_us * 1e-6)


def names(of: DiskEvents) -> list[tuple[str, list[str]]]:
    out = []
    for edge, cuts in zip(("ON edge", "OFF edge"), of.cuts, strict=True):
        ends = of.bins_deg[cuts]
        out.append((edge, [f"ln of events {a:g} to {b:g} deg behind it" for a, b in pairwise(ends)]))
    return out


def _together(of: DiskEvents, per_edge: Floats) -> list[float]:
    """Logarithms of the events of the bins that count together."""
    sums = [np.add.reduceat(h, cuts[:-1]) for h, cuts in zip(per_edge, of.cuts, strict=True)]
    out: list[float] = np.log(np.concatenate(sums) + NONE).tolist()
    return out


def per_edge(of: DiskEvents, some: Some = None) -> Floats:
    """Recorded events per pixel and edge [polarity, bin]."""
    count = of.count if some is None else of.count[some]
    mean: Floats = count.sum(axis=0) / np.maximum(of.passes.sum(axis=0) * len(count) / len(of.count), 1e-9)
    return mean


def measured(of: DiskEvents, some: Some = None) -> list[float]:
    return _together(of, per_edge(of, some))


def light_map(of: DiskEvents, answers: DiskStatistics, some: Some = None, simulated: Some = None) -> Floats:
    """Corner in white that gives each region its number of events."""
    count = of.region_count if some is None else of.region_count[some]
    expected = np.einsum("lpb,rpb->rl", answers.mean(simulated) + of.background, of.passes)
    rising = np.maximum.accumulate(expected, axis=1) + 1e-6 * np.arange(expected.shape[1])
    number, log_corner = count.sum(axis=0) * len(of.region_count) / len(count), np.log(answers.corner_hz)
    out: Floats = np.exp([np.interp(n, r, log_corner) for n, r in zip(number, rising, strict=True)])
    return out


def predicted_per_edge(of: DiskEvents, answers: DiskStatistics, some: Some = None, simulated: Some = None) -> Floats:
    """Simulated events per pixel and edge [polarity, bin] before the recorded disk."""
    log_corner = np.log(answers.corner_hz)
    at = np.interp(np.log(light_map(of, answers, some, simulated)), log_corner, np.arange(len(log_corner)))
    low = np.minimum(at.astype(int), len(log_corner) - 2)
    part, mean = (at - low)[:, None, None], answers.mean(simulated) + of.background
    total = ((1 - part) * mean[low] + part * mean[low + 1]) * of.passes
    out: Floats = total.sum(axis=0) / np.maximum(of.passes.sum(axis=0), 1e-9)
    return out


def predicted(of: DiskEvents, answers: DiskStatistics, some: Some = None, simulated: Some = None) -> list[float]:
    """`some` of the recording's groups, whose events are the light, and `simulated` ones."""
    return _together(of, predicted_per_edge(of, answers, some, simulated))


def lights(of: DiskEvents, answers: DiskStatistics, margin: float) -> Floats:
    """Corners in white that cover those of the regions, and a factor to either side."""
    low, high = np.quantile(light_map(of, answers), (0.02, 0.98))
    number = min(MOST_LIGHTS, 2 + int(np.log(margin**2 * high / low) / LIGHT_STEP))
    return np.geomspace(low / margin, high * margin, number)


@dataclass(frozen=True)
class DiskShape:
    """The disk as a recording of it shows it: number of sectors, black and white together; rpm, positive
    counter-clockwise; number of regions around (counter-clockwise from the left) and along the radius; corner frequency
    of the photoreceptor in white [Hz] of each region."""

    sectors: int
    rpm: float
    regions: tuple[int, int]
    corner_hz: list[float]

    def __str__(self) -> str:
        low, high = np.quantile(self.corner_hz, (0.05, 0.95))
        return (
            f"{self.sectors} sectors, {self.rpm:+.1f} rpm, photoreceptor's corner in white {low:.3g} to {high:.3g} Hz"
        )


def disk_shape(of: DiskEvents, answers: DiskStatistics) -> DiskShape:
    return DiskShape(of.sectors, of.speed_deg_s / 6, of.regions, light_map(of, answers).tolist())
