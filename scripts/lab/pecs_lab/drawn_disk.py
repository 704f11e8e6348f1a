"""Turning disks, drawn instead of rendered: they can turn for as long as photoreceptors need to settle."""

import math
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pecs
from pecs.datasets.rgb import srgb
from pecs.learning.clips import WHITE_PERCENTILE, Recording

from .disk import Disk

SUPERSAMPLES = 4  # each way
BATCH = 64  # pictures that are drawn at once


@dataclass(frozen=True)
class Drawn:
    """white, black: photocurrent of the disk's sectors, A [H, W]."""

    disk: Disk
    white: np.ndarray
    black: np.ndarray

    @cached_property
    def _behind_deg(self) -> np.ndarray:
        """Of each sample, behind the first leading edge at time 0."""
        n, (height, width) = SUPERSAMPLES, self.white.shape
        y, x = (np.mgrid[: n * height, : n * width].astype(np.float32) + 0.5) / n
        angle = np.degrees(np.arctan2(self.disk.centre_px[1] - y, x - self.disk.centre_px[0]))
        return np.sign(self.disk.speed_deg_s) * (self.disk.on_edge_deg - angle)

    def light(self, t_us: float) -> np.ndarray:
        """Photocurrent, A [H, W]."""
        n, (height, width) = SUPERSAMPLES, self.white.shape
        behind = self._behind_deg + abs(self.disk.speed_deg_s) * t_us * 1e-6
        share = (np.floor(behind * (self.disk.sectors / 360)) % 2 == 0).reshape(height, n, width, n).mean((1, 3))
        return self.black + share * (self.white - self.black)


def sensed(
    what: Drawn, times_us: np.ndarray, chip: str, *, gain: float = 1.0, fast: bool = False, warm_up_us: float,
    step_us: float, seed: int = 1,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Events up to the last of times_us, and the light that the photoreceptors follow at each of them, A [n, H, W].

    times_us: multiples of step_us apart. gain: times the light; what is followed is divided by it. warm_up_us: before
    time 0. fast: photoreceptors without delay, and no noise.
    """
    times = times_us[-1] - step_us * np.arange(np.ceil((times_us[-1] + warm_up_us) / step_us), -1, -1)
    with pecs.Chip(chip) as profile:
        corner_hz_per_a, dark_a = 1e18 if fast else profile.corner_hz_per_a, profile.dark_current_a
    height, width = what.white.shape
    overrides = {"corner_hz_per_a": corner_hz_per_a} | ({"amplifier_cutoff_hz": 0} if fast else {})
    options = {"overrides": overrides, "noise": not fast, "readout": "ideal", "photocurrent_a": 1.0, "seed": seed}
    sensor = pecs.Sensor(width, height, chip, **options)
    found, followed, slow = [], [], None
    for k in range(0, len(times), BATCH):
        part = times[k : k + BATCH]
        light = gain * np.stack([what.light(t) for t in part])
        found.append(sensor.push(light.astype(np.float32), part - times[0] + 1))
        for t, current in zip(part, light + dark_a, strict=True):
            # 1 / u follows 1 / I with the corner a I, a = 2 pi corner_hz_per_a (docs/reference/sensor.md).
            kept = 0 if slow is None else np.exp(-2e-6 * np.pi * corner_hz_per_a * current * step_us)
            slow = 1 / current + kept * ((0 if slow is None else slow) - 1 / current)
            if np.abs(times_us - t).min() < step_us / 2:
                followed.append((1 / slow - dark_a) / gain)
    events = np.asarray(np.concatenate([*found, sensor.finish()]))
    events["t"] += round(times[0] - 1)
    return events[events["t"] >= 0], np.array(followed)


def shown(light: np.ndarray) -> np.ndarray:
    """8 bit, as networks are shown the light of a recording."""
    return srgb(light / np.percentile(light, WHITE_PERCENTILE))


class Turning(Recording):
    """What a chip sees of a disk that fills the picture, with pictures and flow; drawn at random.

    how: ranges of sectors, deg_per_window, contrast, and corner_hz, of the photoreceptor in white (light changes by up
    to a factor of e across the picture); side_px, windows, fps, warm_up_us, step_us. fast: as of `sensed`.
    """

    def __init__(self, how: dict, chip: str, seed: int, fast: bool = False):
        rng, side = np.random.Generator(np.random.Philox(key=[seed, 0])), how["side_px"]
        self.camera = SimpleNamespace(name=f"disk {seed}", width=side, height=side)
        self.times_us = np.arange(how["windows"] + 1) * 1e6 / how["fps"]
        speed = _between(rng, how["deg_per_window"]) * how["fps"] * rng.choice([-1, 1])
        centre = side / 2 + rng.uniform(-0.25, 0.25, 2) * side
        disk = Disk(tuple(centre), math.inf, speed, rng.uniform(0, 360), int(rng.choice(how["sectors"])))
        y, x = (np.mgrid[:side, :side] + 0.5) / side - 0.5
        way, slope = rng.uniform(0, 2 * math.pi), rng.uniform(0, 1)
        corner_hz = _between(rng, how["corner_hz"]) * np.exp(slope * (x * math.cos(way) + y * math.sin(way)))
        with pecs.Chip(chip) as profile:
            white = corner_hz / profile.corner_hz_per_a
        what = Drawn(disk, white, white / rng.uniform(*how["contrast"]))
        timing = {"warm_up_us": how["warm_up_us"], "step_us": how["step_us"]}
        events, _ = sensed(what, self.times_us, chip, **timing, fast=fast, seed=1 + seed)
        self.__dict__["pictures"] = shown(np.stack([what.light(t) for t in self.times_us]))
        turn = math.radians(speed / how["fps"])  # counter-clockwise on screen, where y is down
        down, right = (np.mgrid[:side, :side] + 0.5) - centre[::-1, None, None]
        before = right * math.cos(turn) - down * math.sin(turn), right * math.sin(turn) + down * math.cos(turn)
        back = np.stack([before[0] - right, before[1] - down]).astype(np.float16)
        self._flows = dict.fromkeys(range(how["windows"]), back)
        self._set(events)


def _between(rng: np.random.Generator, ends: list[float]) -> float:
    return math.exp(rng.uniform(*np.log(ends)))
