"""The simulated counterpart of a recording: the sensor before the same light, with values of the profile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..chip import Chip
from ..sensor import LABELS, Sensor
from . import disk
from .recordings import StepEvents, StillEvents

COLUMNS = 64  # of the simulated pixels
CYCLES, RAMP_CYCLES = 4, 3  # the first is not used
STEP_US = 500.0  # between frames
FRAMES = 110_000  # most of a recording
NOISE_S, NOISE_SETTLE_S = 0.6, 0.4  # simulated noise, after its beginning
DARK_S, DARK_SETTLE_S, DARK_STEP_US = 30.0, 10.0, 2000.0  # the same with the cap on, where pixels are slow
BATCH = 512  # frames
# A disk: pixels at each light, relative to those before switches, in rows of DISK_COLUMNS; periods before the counted
# one, and steps of half a period: in all but the last of these, and least and most in the counted one.
DISK_PIXELS, DISK_COLUMNS = 16, 240
DISK_PERIODS, DISK_COARSE, DISK_STEPS, DISK_BATCH = 24, 12, (24, 1000), 64
DISK_STEP_US = 150.0
COARSE, FAR, NEAR = 0.25, 5.0, 1.5  # share of these pixels far from the best values; margins of light, far and near
SLOW_S, SETTLE_S, SLOW_STEP_S = 120.0, 600.0, 2.0  # leak and background: phases of leaks become random
STILL_KEYS = ("leak_rate_hz", "background_on_hz", "background_off_hz")
SLOW_KEYS = (*STILL_KEYS, "contrast_threshold_on", "contrast_threshold_off", "threshold_mismatch")


def _switch_times_us(length_us: float, step_us: float) -> np.ndarray:
    """Times of frames behind a switch: a step takes 1 us."""
    return np.concatenate([[0.0, 1.0], np.arange(1.0 + step_us, length_us - 0.5, step_us)])


def _light(behind_us: np.ndarray, before: float, level: float, length_us: float, ramp_us: float | None) -> np.ndarray:
    if ramp_us is None:
        return np.where(behind_us > 0, level, before)
    done = np.clip((behind_us - (length_us - ramp_us) / 2) / ramp_us, 0, 1)
    return before * (level / before) ** done  # type: ignore[no-any-return]


def _events(sensor: Sensor, light: np.ndarray, t_us: np.ndarray) -> np.ndarray:
    """All events of a sensor whose pixels see the same light [time]."""
    found = []
    for i in range(0, len(t_us), BATCH):
        some = light[i : i + BATCH, None, None].astype(np.float32)
        frames = np.ascontiguousarray(np.broadcast_to(some, (len(some), *sensor.shape)))
        found.append(sensor.push(frames, t_us[i : i + BATCH]))
    return np.concatenate([*found, sensor.finish()])


@dataclass
class Model:
    """`chip` with overrides before the light of recordings, whose level 1 is `light_a` amperes; what was computed for
    the same values before is kept."""

    chip: str | Path
    pixels: int = 1024  # before switches; half of them in still light
    seed: int = 1
    disk_lights: dict[str, tuple[np.ndarray, int]] = field(default_factory=dict)  # file of a disk -> corners, rows
    _known: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def still_pixels(self) -> int:
        return self.pixels // 2

    def focus(self, of: disk.DiskEvents, overrides: Mapping[str, float], share: float = 1.0) -> None:
        """From here on, only the light of the disk's regions is simulated, with a share of the pixels."""
        rows = max(1, round(share * DISK_PIXELS * self.pixels / DISK_COLUMNS))
        answers = self._turn(of, disk.WIDE / of.period_us * 1e6, max(1, rows // 16), overrides)
        self.disk_lights[of.file] = disk.lights(of, answers, NEAR if share == 1 else FAR), rows

    def turning(self, of: disk.DiskEvents, overrides: Mapping[str, float]) -> disk.DiskStatistics:
        if of.file not in self.disk_lights:
            self.focus(of, overrides, COARSE)
        corners_hz, rows = self.disk_lights[of.file]
        moving = {key: v for key, v in overrides.items() if key not in STILL_KEYS}
        key = (of.file, rows, corners_hz.tobytes(), *sorted(moving.items()))
        return self._once(*key, make=lambda: self._turn(of, corners_hz, rows, moving))  # type: ignore[no-any-return]

    def _turn(
        self, of: disk.DiskEvents, corners_hz: np.ndarray, rows: int, values: Mapping[str, float]
    ) -> disk.DiskStatistics:
        """`rows` of pixels at each light, all at the same place of the disk."""
        with Chip(self.chip) as chip:
            kappa = values.get("corner_hz_per_a") or chip.corner_hz_per_a or 1e15
            rows = min(rows, int(chip.info["values"]["height"]["value"]) // len(corners_hz))
        fine = int(np.clip(of.period_us / 2 / DISK_STEP_US, *DISK_STEPS))
        steps = [DISK_COARSE] * 2 * (DISK_PERIODS - 1) + [max(DISK_COARSE, fine // 4)] * 2 + [fine] * 2
        white_fa = np.repeat(1e15 * corners_hz / kappa, rows)[:, None] * np.ones((1, DISK_COLUMNS))
        frames = [white_fa.astype(np.float32), (white_fa / of.contrast).astype(np.float32)]
        fixed = dict.fromkeys((*STILL_KEYS, "hot_pixel_fraction"), 0.0)
        sensor = Sensor(
            DISK_COLUMNS, len(white_fa), str(self.chip), overrides={**values, **fixed}, seed=self.seed,
            photocurrent_a=1e-15, readout="ideal", time_unit="us",
        )  # fmt: skip
        found = []
        with sensor:
            for half, number in enumerate(steps):
                begin = (half // 2 + half % 2 * of.white) * of.period_us
                length_us = (1 - of.white if half % 2 else of.white) * of.period_us
                t_us = np.concatenate([[begin + 1], begin + length_us * np.arange(1, number + 1) / number])
                for i in range(0, len(t_us), DISK_BATCH):
                    some = t_us[i : i + DISK_BATCH]
                    block = np.broadcast_to(frames[half % 2], (len(some), *white_fa.shape))
                    found.append(sensor.push(np.ascontiguousarray(block), some))
            events = np.concatenate([*found, sensor.finish()])
        return disk.DiskStatistics(corners_hz, self._per_edge(of, events, rows, len(corners_hz)))

    def _per_edge(self, of: disk.DiskEvents, events: np.ndarray, rows: int, lights: int) -> np.ndarray:
        """[group, light, polarity, bin]"""
        since_us = events["t"] - DISK_PERIODS * of.period_us
        kept = (since_us >= 0) & (since_us < of.period_us)
        events, bins = events[kept], of.bins_deg
        past = (since_us[kept] / of.period_us - np.where(events["p"] == 1, 0.0, of.white)) * (720 / of.sectors)
        past = np.mod(past - bins[0], 720 / of.sectors) + bins[0]
        groups, number = len(of.count), len(bins) - 1
        bin_ = np.searchsorted(bins, past, "right") - 1
        shown = bin_ < number
        place = (events["x"] % groups, events["y"] // rows, 1 - events["p"], bin_)
        shape = (groups, lights, 2, number)
        index = np.ravel_multi_index([v[shown].astype(np.int64) for v in place], shape)
        count = np.bincount(index, minlength=int(np.prod(shape))).reshape(shape)
        return count / (rows * DISK_COLUMNS / groups)  # type: ignore[no-any-return]

    def _sensor(self, pixels: int, light_a: float, overrides: Mapping[str, float], **more: Any) -> Sensor:
        fixed = {"hot_pixel_fraction": 0.0}
        return Sensor(
            COLUMNS, pixels // COLUMNS, str(self.chip), overrides={**overrides, **fixed}, seed=self.seed,
            photocurrent_a=light_a, readout="ideal", time_unit="us", **more,
        )  # fmt: skip

    def _once(self, *key: Any, make: Any) -> Any:
        if key not in self._known:
            while len(self._known) > 200:
                self._known.pop(next(iter(self._known)))
            self._known[key] = make()
        return self._known[key]

    def switches(self, of: StepEvents, light_a: float, overrides: Mapping[str, float]) -> StepEvents:
        still = dict.fromkeys(STILL_KEYS, 0.0)  # at most a few events in a hundred switches
        values = {**overrides, **still}
        ramps_us = () if of.ramps_us is None else of.ramps_us
        key = (of.levels, *of.lengths_us, *ramps_us, of.exact, light_a, *sorted(values.items()))
        return self._once(*key, make=lambda: self._switch(of, light_a, values))  # type: ignore[no-any-return]

    def _switch(self, of: StepEvents, light_a: float, values: Mapping[str, float]) -> StepEvents:
        k, ramps_us = len(of.levels), of.ramps_us
        cycles, pixels = (CYCLES, self.pixels) if ramps_us is None else (RAMP_CYCLES, self.pixels // 2)
        step_us = max(STEP_US, cycles * float(of.lengths_us.sum()) / FRAMES)
        t_us, light, edges = [np.array([0.0])], [np.array([of.levels[-1]])], [1000.0]
        for c in range(cycles * k):
            j = c % k
            length_us = float(of.lengths_us[j])
            behind = _switch_times_us(length_us, step_us)
            t_us.append(edges[-1] + behind)
            ramp_us = None if ramps_us is None else float(ramps_us[j])
            light.append(_light(behind, of.levels[j - 1], of.levels[j], length_us, ramp_us))
            edges.append(edges[-1] + length_us)
        with self._sensor(pixels, light_a, values) as sensor:
            events = _events(sensor, np.concatenate(light), np.concatenate(t_us))
        events = events[(events["t"] >= edges[0]) & (events["t"] < edges[-1])]
        pixel = events["y"].astype(np.int64) * COLUMNS + events["x"]
        return StepEvents(
            of.name, of.levels, pixel, events["t"].astype(float), events["p"] == 1, pixels, np.array(edges),
            of.lengths_us, of.exact, of.ramps_us,
        )  # fmt: skip

    def still_events(
        self, of: StillEvents, light_a: float, overrides: Mapping[str, float]
    ) -> tuple[StillEvents, StillEvents]:
        """Noise alone, in short; leak and background, for minutes without noise. Their events add up."""
        light = light_a * of.level
        noisy = {k: v for k, v in overrides.items() if not k.startswith(("background", "refractory"))}
        slow = {k: overrides[k] for k in SLOW_KEYS if k in overrides}
        noise = self._once("noise", light, *sorted(noisy.items()), make=lambda: self._noise(light, noisy))
        rest = self._once("slow", of.seconds, *sorted(slow.items()), make=lambda: self._slow(slow, of.seconds))
        return noise, rest

    def _counts(self, events: np.ndarray, begin_s: float, seconds: float, windows: int) -> StillEvents:
        """Windows of time count as further pixels, window by window."""
        pixel = events["y"].astype(np.int64) * COLUMNS + events["x"]
        window = np.floor((events["t"] * 1e-6 - begin_s) / seconds).astype(np.int64)
        inside = (window >= 0) & (window < windows)
        number, on = (pixel * windows + window)[inside], events["p"][inside] == 1
        counts = [np.bincount(number[of], minlength=self.still_pixels * windows) for of in (on, ~on)]
        return StillEvents("", 0.0, *counts, seconds)

    def _noise(self, light_a: float, overrides: Mapping[str, float]) -> StillEvents:
        values = {**overrides, "background_on_hz": 0.0, "background_off_hz": 0.0}
        lit, leaks = light_a > 0, values.get("leak_rate_hz", 0.0) > 0
        seconds, step_us = (NOISE_S, STEP_US) if lit else (DARK_S, DARK_STEP_US)
        settle = np.arange(0, SETTLE_S, SLOW_STEP_S) * 1e6 if leaks and not lit else np.array([0.0])
        begin = settle[-1] + 1e6 * (NOISE_SETTLE_S if lit else DARK_SETTLE_S)
        fine = np.arange(settle[-1] + step_us, begin + seconds * 1e6, step_us)
        level, scale = (1.0, light_a) if lit else (0.0, 1e-15)
        with self._sensor(self.still_pixels, scale, values, labels=True) as sensor:
            found = []
            if leaks and lit:  # pixels begin at a random phase of their leak: in less light by part of a threshold
                phase = np.random.default_rng(self.seed).uniform(0, overrides["contrast_threshold_on"], sensor.shape)
                found, settle = [sensor.push(np.exp(-phase)[None], settle)], settle[1:]
            t_us = np.concatenate([settle, fine])
            events = np.concatenate([*found, _events(sensor, np.full(len(t_us), level), t_us)])
        return self._counts(events[events["label"] == LABELS.index("noise")], begin * 1e-6, seconds, 1)

    def _slow(self, overrides: Mapping[str, float], seconds: float) -> StillEvents:
        windows = max(1, int(SLOW_S / seconds))
        t_us = np.arange(0, SETTLE_S + windows * seconds + SLOW_STEP_S, SLOW_STEP_S) * 1e6
        with self._sensor(self.still_pixels, 1e-12, {**overrides, "noise_std": 0.0}) as sensor:
            events = _events(sensor, np.ones(len(t_us)), t_us)
        return self._counts(events, SETTLE_S, seconds, windows)
