"""Clips for training: the network's planes of consecutive windows, and the pictures at their ends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from .._errors import PecsInputError, bad_input
from ..chip import Chip
from ..datasets.sequence import Camera
from ..datasets.sequence import Sequence as SetSequence
from ..light import Light
from ..representations import voxel_grid
from .limits import Augmentation, ClipConfig
from .reconstruct import compressed, late_us

BLACK, WHITE = 1.0, 99.0  # percentiles of a recording's light
WINDOW_US = (10_000, 40_000)  # lengths of windows, one for each clip


class Source(Protocol):
    """events, sorted by t, and pictures [n, H, W] (8 bit, linear in light) at times_us [n], evenly spaced; corner_hz of
    the photoreceptors in the mean light, None if they have none."""

    @property
    def events(self) -> NDArray[Any]: ...
    @property
    def times_us(self) -> NDArray[Any]: ...
    @property
    def pictures(self) -> NDArray[np.uint8]: ...
    @property
    def corner_hz(self) -> float | None: ...


def eight_bit(light: NDArray[Any]) -> NDArray[np.uint8]:
    """Pictures that are linear in light: the percentiles BLACK and WHITE of all values are 0 and 255."""
    low, high = np.percentile(light, (BLACK, WHITE))
    scaled = np.clip((light - low) / max(float(high - low), 1e-30), 0, 1)
    return np.round(255 * scaled).astype(np.uint8)


class Recording:
    """One event camera of a sequence. Its pictures, one for each shortest window, stay in memory after their first use,
    because reading them takes as long as training."""

    def __init__(self, camera: Camera, duration_us: int):
        if not (camera.folder / "stack" / "stack.json").is_file():
            raise bad_input(camera.folder / "stack", "light", None, "the stack (in the recipe: keep.light)")
        self.camera, self.events = camera, camera.events()
        self.times_us = np.arange(0, duration_us + 1, WINDOW_US[0])

    @cached_property
    def _seen(self) -> tuple[NDArray[np.uint8], float | None]:
        """Pictures of the pixels' photocurrent; the corner in its mean."""
        folder = self.camera.folder
        own = folder / "chip.json"  # the profile that the recipe names
        chip = own if own.is_file() else str(self.camera.info["chip"])
        with Chip(chip) as profile, Light(folder / "stack", profile, threads=1) as light:
            planes = np.stack([light.at(t)[0] for t in self.times_us])
            slow = self.camera.info.get("model", "pecs") == "pecs"
            return eight_bit(planes), float(planes.mean()) * profile.corner_hz_per_a or None if slow else None

    @property
    def pictures(self) -> NDArray[np.uint8]:
        return self._seen[0]

    @property
    def corner_hz(self) -> float | None:
        return self._seen[1]


def recordings(sequences: Iterable[SetSequence]) -> list[Recording]:
    found = [Recording(camera, one.duration_us) for one in sequences for camera in one.of_kind("events")]
    if not found:
        raise PecsInputError("clips: got no event camera, wanted sequences with one")
    return found


class Clips(torch.utils.data.Dataset[dict[str, torch.Tensor]]):
    """An item: planes [T, bins + 1, h, w] of T windows of equal length, picture [T, 1, h, w] `late_us` before their
    ends (0 … 1).

    Item i is the same in every run and worker: what is random is keyed by (seed, i).
    """

    def __init__(self, sources: Sequence[Source], config: ClipConfig, bins: int, seed: int, length: int):
        self.config, self.bins, self.seed, self.length = config, bins, seed, length
        self.sources, steps = [], 0
        for source in sources:
            n, height, width = source.pictures.shape
            if min(height, width) < config.crop:
                got = f"pictures of {width} x {height}"
                raise PecsInputError(f"clips: got {got}, wanted {config.crop} px each way, or less --crop")
            interval_us = max(_interval_us(source), 1)
            seen = n - 1 - int(late_us(source.corner_hz) // interval_us)  # intervals whose events come before the end
            count = max(0, seen) // max(1, round(WINDOW_US[0] / interval_us))
            steps = max(steps, count)
            if count >= config.windows:
                self.sources.append(source)
        if not self.sources:
            got = f"{steps} windows of {WINDOW_US[0] / 1e3:g} ms in the longest sequence"
            raise PecsInputError(f"clips: got {got}, wanted {config.windows}, or less --windows")

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        if not 0 <= index < self.length:
            raise IndexError(index)
        rng = np.random.Generator(np.random.Philox(key=[self.seed, index]))
        source = self.sources[rng.integers(len(self.sources))]
        count, crop, how = self.config.windows, self.config.crop, self.config.augmentation
        pictures, times_us = source.pictures, source.times_us
        # A window is a number of intervals between pictures.
        interval_us = _interval_us(source)
        short, long = (round(us / interval_us) for us in WINDOW_US)
        late = late_us(source.corner_hz)
        last = len(times_us) - 1 - min(math.ceil(late / interval_us), len(times_us) - 1 - count)
        most = min(max(long, 1), last // count)
        stride = int(rng.integers(min(max(short, 1), most), most + 1))
        first = int(rng.integers(last + 1 - count * stride))
        at = first + stride * np.arange(count + 1)
        y0, x0 = (int(rng.integers(n - crop + 1)) for n in pictures.shape[1:])
        window_us = stride * interval_us
        grid = _grid(source, times_us[at] + late, (x0, y0, crop), self.bins)
        if how:
            _add_faults(grid, window_us * 1e-6, how, rng)
        grid = compressed(grid, window_us)
        shown = pictures[at[1:], y0 : y0 + crop, x0 : x0 + crop][:, None] / np.float32(255)
        if how and how.flip:
            for axis in (-1, -2):
                if rng.random() < 0.5:
                    grid, shown = np.flip(grid, axis), np.flip(shown, axis)
            if rng.random() < 0.5:
                grid, shown = np.swapaxes(grid, -1, -2), np.swapaxes(shown, -1, -2)
        item = {"planes": grid, "picture": shown}
        return {name: torch.from_numpy(np.ascontiguousarray(value, np.float32)) for name, value in item.items()}


def _interval_us(source: Source) -> float:
    return float(source.times_us[-1] - source.times_us[0]) / max(len(source.times_us) - 1, 1)


def _grid(source: Source, ends_us: NDArray[Any], box: tuple[int, int, int], bins: int) -> NDArray[np.float32]:
    """[T, bins, crop, crop] of the windows between `ends_us`; box: x0, y0, crop."""
    x0, y0, crop = box
    cuts, events = np.searchsorted(source.events["t"], ends_us), source.events
    out = np.empty((len(ends_us) - 1, bins, crop, crop), np.float32)
    for k, grid in enumerate(out):
        window = events[cuts[k] : cuts[k + 1]]
        x, y = window["x"].astype(np.int32) - x0, window["y"].astype(np.int32) - y0
        inside = (x >= 0) & (x < crop) & (y >= 0) & (y < crop)
        kept = window[inside]  # a copy
        kept["x"], kept["y"] = x[inside], y[inside]
        voxel_grid(kept, crop, crop, bins, begin_us=float(ends_us[k]), end_us=float(ends_us[k + 1]), out=grid)
    return out


def _add_faults(grid: NDArray[np.float32], window_s: float, how: Augmentation, rng: np.random.Generator) -> None:
    """Noise whose rate differs from pixel to pixel, and bursts of events that come with each frame of the camera."""
    count, bins, *size = grid.shape
    if how.noise_hz:
        median_hz = how.noise_hz * 10 ** rng.uniform(-2, 0)
        rate_hz = np.minimum(median_hz * np.exp(rng.uniform(0, 1.5) * rng.standard_normal(size)), 300)
        share = np.clip(rng.uniform(0.3, 0.7) + 0.15 * rng.standard_normal(size), 0, 1)
        at = np.repeat(np.arange(rate_hz.size), rng.poisson(rate_hz * window_s * count).ravel())
        sign = np.where(rng.random(len(at)) < share.ravel()[at], np.float32(1), np.float32(-1))
        np.add.at(grid.reshape(count * bins, -1), (rng.integers(count * bins, size=len(at)), at), sign)
    if rng.random() < how.bursts:
        period_s, likely = rng.uniform(0.03, 0.15), rng.beta(1, 2, size)
        for sign in (-1, 1, -1 if rng.random() < 0.5 else 1):
            at_s, share = rng.uniform(0, period_s), rng.uniform(0.05, 0.8)
            while at_s < count * window_s:
                cell = int(at_s / window_s * bins)
                hit = rng.random(size) < share * likely
                grid[cell // bins, cell % bins][hit] += sign
                at_s += period_s
