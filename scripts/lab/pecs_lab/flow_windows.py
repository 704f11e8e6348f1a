"""Windows of events with their optical flow: of sequences of a data set, and of the lab's turning disk."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import pecs
from pecs.datasets.sequence import Camera

from . import sequences
from .disk import Disk
from .real_disk import disk_of

BINS = 5


def grid_of(events: np.ndarray, shape: tuple[int, int], begin_us: float, end_us: float) -> np.ndarray:
    return pecs.voxel_grid(events, shape[1], shape[0], BINS, begin_us, end_us, normalise=True)


class Flows:
    """True flows of a camera, read once: px from instant i to i + length."""

    def __init__(self, camera: Camera):
        self.camera, self.times_us = camera, camera.truth.times_us
        self.name = camera.folder.parent.name  # of the sequence
        self.shape = camera.height, camera.width
        self._known: dict[tuple[int, int], np.ndarray] = {}

    def __call__(self, i: int, length: int) -> np.ndarray:
        """[2, H, W]; NaN unknown."""
        if (i, length) not in self._known:
            flow = self.camera.truth.flow(i, i + length)
            self._known[i, length] = np.moveaxis(flow, -1, 0).astype(np.float16)
        return self._known[i, length].astype(np.float32)


@dataclass(frozen=True)
class Window:
    """Events of [begin_us, end_us) and the displacement [2, H, W] over it of what each pixel sees at its begin, px."""

    name: str
    events: np.ndarray
    begin_us: float
    end_us: float
    flow: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        return self.flow.shape[1:]

    @cached_property
    def has_events(self) -> np.ndarray:
        """[H, W], pixels with an event and a known flow."""
        out = np.zeros(self.shape, bool)
        out[self.events["y"], self.events["x"]] = True
        return out & self.known

    @cached_property
    def known(self) -> np.ndarray:
        return np.isfinite(self.flow).all(0)


class View:
    """The events that a sensor made of a camera's light."""

    def __init__(self, flows: Flows, events: Path):
        self.flow, self.shape, self.intervals = flows, flows.shape, len(flows.times_us) - 1
        self.events = np.asarray(pecs.read(events, "dsec"))
        self._first = np.searchsorted(self.events["t"], flows.times_us)

    def grid(self, i: int, length: int) -> np.ndarray:
        return grid_of(self._cut(i, length), self.shape, *self.flow.times_us[[i, i + length]])

    def _cut(self, i: int, length: int) -> np.ndarray:
        return self.events[self._first[i] : self._first[i + length]]

    def windows(self, first: int, length: int, step: int) -> list[Window]:
        """From instant `first` on, `step` instants apart."""
        out = []
        for i in range(first, self.intervals - length + 1, step):
            begin, end = self.flow.times_us[[i, i + length]]
            out.append(Window(self.flow.name, self._cut(i, length), begin, end, self.flow(i, length)))
        return out


def coarse_disk(name: str, factor: int) -> Disk:
    """On a grid whose pixels are factor x factor of the sensor's."""
    disk = disk_of(sequences.load(name))
    return replace(disk, centre_px=tuple(c / factor for c in disk.centre_px), radius_px=disk.radius_px / factor)


def rotation(disk: Disk, shape: tuple[int, int], seconds: float) -> np.ndarray:
    """Displacement [2, H, W] of the disk's points in that time, px; NaN beyond its rim."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    angle, radius = disk.polar(x, y)
    before, after = np.radians(angle), np.radians(angle + disk.speed_deg_s * seconds)
    moved = radius * np.stack([np.cos(after) - np.cos(before), np.sin(before) - np.sin(after)])
    return np.where(radius <= disk.radius_px, moved, np.nan).astype(np.float32)


def real_windows(recording: Path, plan: dict) -> list[Window]:
    """plan: "real" of scripts/studies/flow.json. All events of factor x factor pixels are those of one; cut to the
    disk's box."""
    factor, window_us = plan["coarser"], plan["window_us"]
    sequence = sequences.load(plan["sequence"])
    left, top, right, bottom = (v // factor for v in sequence.render["moving_px"])
    disk = coarse_disk(plan["sequence"], factor).moved(-left, -top)
    events = np.asarray(pecs.read(recording)).copy()
    x, y = events["x"].astype(int) // factor - left, events["y"].astype(int) // factor - top
    inside = (x >= 0) & (x < right - left) & (y >= 0) & (y < bottom - top)
    events = events[inside]
    events["x"], events["y"] = x[inside], y[inside]
    flow = rotation(disk, (bottom - top, right - left), window_us * 1e-6)
    starts = np.arange(plan["begin_us"], plan["end_us"] - window_us + 1, plan["step_us"])
    bounds = [np.searchsorted(events["t"], [t, t + window_us]) for t in starts]
    return [
        Window(plan["sequence"], events[a:b], float(t), float(t + window_us), flow)
        for t, (a, b) in zip(starts, bounds, strict=True)
    ]


def disk_speed(recording: Path, plan: dict) -> tuple[float, float]:
    """Speed of the recording's disk by its events alone, deg/s: that with which the events' polarities, turned back by
    it, have most of the disk's pattern (the harmonic of its sectors). Then the speed that it has."""
    disk = coarse_disk(plan["sequence"], 1)
    events = np.asarray(pecs.read(recording))
    angle, radius = disk.polar(events["x"].astype(float), events["y"].astype(float))
    on = (radius < 0.95 * disk.radius_px) & (radius > 0.1 * disk.radius_px)
    turn = np.radians(angle[on]) * disk.sectors / 2
    seconds, polarity = events["t"][on] * 1e-6 * np.radians(1) * disk.sectors / 2, np.where(events["p"][on] > 0, 1, -1)
    tried = np.arange(-4000, 4001, 20)
    power = [abs(np.sum(polarity * np.exp(1j * (turn - speed * seconds)))) for speed in tried]
    return float(tried[int(np.argmax(power))]), disk.speed_deg_s


def sharpness(window: Window, sign: float) -> float:
    """Variance of the image of events (ON 1, OFF -1) that are carried back to the window's begin along sign times the
    flow, over that of the events as they are. Events of pixels without a known flow do not count."""
    events = window.events[window.known[window.events["y"], window.events["x"]]]
    late = sign * (events["t"] - window.begin_us) / (window.end_us - window.begin_us)
    x, y, polarity = events["x"].astype(float), events["y"].astype(float), np.where(events["p"] > 0, 1.0, -1.0)
    dx, dy = window.flow[:, events["y"], events["x"]]
    carried = _variance(x - late * dx, y - late * dy, polarity, window.shape)
    return carried / _variance(x, y, polarity, window.shape)


def _variance(x: np.ndarray, y: np.ndarray, polarity: np.ndarray, shape: tuple[int, int]) -> float:
    """Of the image to which each event adds its polarity, shared by the four pixels about it; with a Gaussian of 1 px,
    so that whole positions have no advantage."""
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    image = np.zeros(shape)
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - (x - x0)) * np.abs(1 - dy - (y - y0)) * polarity
            inside = (x0 + dx >= 0) & (x0 + dx < shape[1]) & (y0 + dy >= 0) & (y0 + dy < shape[0])
            np.add.at(image, ((y0 + dy)[inside], (x0 + dx)[inside]), weight[inside])
    return float(cv2.GaussianBlur(image, (0, 0), 1.0).var())
