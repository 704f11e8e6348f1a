"""Clips of data sets for training: the voxel grids of consecutive windows, the pictures at their ends, and the flow."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from .._errors import PecsInputError, bad_input
from ..chip import Chip
from ..datasets.rgb import srgb
from ..datasets.sequence import Camera, Sequence
from ..light import Light
from ..representations import voxel_grid

WHITE_PERCENTILE = 99.0  # percentile of a recording's light that is white


@dataclass(frozen=True)
class Augmentation:
    """Augmentations of Stoffregen et al. (ECCV 2020); 0: none."""

    flip: bool = True
    pause: float = 0.05  # probability of a window without events, which repeats the last picture
    noise: float = 0.1  # standard deviation of noise, relative to that of the voxels that are not 0
    noise_share: float = 0.25  # share of voxels with noise
    hot: float = 0.001  # maximum share of hot pixels


@dataclass(frozen=True)
class ClipConfig:
    windows: int = 10
    crop: int = 64
    bins: int = 5
    augmentation: Augmentation | None = Augmentation()


class Recording:
    """Events of one camera, and pictures at the frames of its ground truth. Pictures and flow are kept in memory after
    their first use (5 bytes per pixel and frame), because reading them takes as long as training."""

    def __init__(self, camera: Camera):
        if not camera.has_truth or "motion" not in camera.truth.layers:
            raise bad_input(camera.folder / "truth", "layers", None, "motion: the flow between pictures")
        if not (camera.folder / "stack" / "stack.json").is_file():
            raise bad_input(camera.folder / "stack", "light", None, "the stack (in the recipe: keep.light)")
        self.camera = camera
        self.times_us = camera.truth.times_us
        self._flows: dict[int, NDArray[np.float16]] = {}
        self._set(camera.events())

    def _set(self, events: NDArray[Any]) -> None:
        self.events = events
        self.first = np.searchsorted(events["t"], self.times_us)

    def with_events(self, events: NDArray[Any]) -> Recording:
        """The same light with the events of another sensor."""
        other = copy.copy(self)
        other.__dict__["pictures"] = self.pictures  # shared: they are read once
        other._set(events)
        return other

    @property
    def windows(self) -> int:
        return len(self.times_us) - 1

    @cached_property
    def pictures(self) -> NDArray[np.uint8]:
        """[n, H, W]: the photocurrent of the pixels, 8 bit with sRGB's curve; white is a percentile of all values."""
        folder = self.camera.folder
        own = folder / "chip.json"  # the profile that the recipe names
        chip = own if own.is_file() else str(self.camera.info["chip"])
        with Chip(chip) as profile, Light(folder / "stack", profile, threads=1) as light:
            values = np.stack([light.at(t)[0] for t in self.times_us])
        return srgb(values / max(float(np.percentile(values, WHITE_PERCENTILE)), 1e-30))

    def flow_back(self, i: int) -> NDArray[np.float16]:
        """[2, H, W] px, as `Truth.flow_back`."""
        if i not in self._flows:
            self._flows[i] = np.moveaxis(self.camera.truth.flow_back(i), -1, 0).astype(np.float16)
        return self._flows[i]

    def window(self, i: int) -> NDArray[Any]:
        events: NDArray[Any] = self.events[self.first[i] : self.first[i + 1]]
        return events


def recordings(sequences: Iterable[Sequence]) -> list[Recording]:
    found = [Recording(camera) for sequence in sequences for camera in sequence.of_kind("events")]
    if not found:
        raise PecsInputError("clips: got no event camera, wanted sequences with one")
    return found


class Clips(torch.utils.data.Dataset[dict[str, torch.Tensor]]):
    """An item: grid [T, bins, h, w], picture [T, 1, h, w] at the windows' ends (0 … 1), before [1, h, w] at the first
    one's begin, flow_back [T, 2, h, w] px from a window's end to its begin (NaN unknown).

    Item i is the same in every run and worker: what is random is keyed by (seed, i).
    """

    def __init__(self, sources: list[Recording], config: ClipConfig, seed: int, length: int):
        self.config, self.seed, self.length = config, seed, length
        self.sources = [s for s in sources if s.windows >= config.windows]
        small = [s.camera.name for s in sources if min(s.camera.width, s.camera.height) < config.crop]
        if small or not self.sources:
            got = f"a picture smaller than that in {small[0]}" if small else "shorter sequences"
            raise PecsInputError(f"clips: got {got}, wanted {config.windows} windows of {config.crop} px")

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        if not 0 <= index < self.length:
            raise IndexError(index)
        rng = np.random.Generator(np.random.Philox(key=[self.seed, index]))
        source = self.sources[rng.integers(len(self.sources))]
        first = int(rng.integers(source.windows - self.config.windows + 1))
        crop, camera = self.config.crop, source.camera
        x0, y0 = (int(rng.integers(n - crop + 1)) for n in (camera.width, camera.height))
        item = self._cut(source, first, np.s_[y0 : y0 + crop, x0 : x0 + crop], rng)
        if self.config.augmentation:
            item = _augmented(item, self.config.augmentation, rng)
        return {name: torch.from_numpy(np.ascontiguousarray(value, np.float32)) for name, value in item.items()}

    def _cut(
        self, source: Recording, first: int, box: tuple[slice, slice], rng: np.random.Generator
    ) -> dict[str, NDArray[Any]]:
        count, chance = self.config.windows, self.config.augmentation.pause if self.config.augmentation else 0.0
        pictures = source.pictures[first : first + count + 1, box[0], box[1]] / 255.0
        grids, shown, flows, at = [], [], [], 0
        for _ in range(count):
            pause = rng.random() < chance
            begin, end = source.times_us[first + at : first + at + 2]
            events = source.window(first + at)
            inside = (events["x"] >= box[1].start) & (events["x"] < box[1].stop)
            inside &= (events["y"] >= box[0].start) & (events["y"] < box[0].stop)
            kept = np.asarray(events[inside & (not pause)]).copy()
            kept["x"] -= box[1].start
            kept["y"] -= box[0].start
            size = self.config.crop, self.config.crop, self.config.bins
            grids.append(voxel_grid(kept, *size, begin_us=begin, end_us=end, normalise=True))
            flow = source.flow_back(first + at)[:, box[0], box[1]]
            flows.append(np.zeros_like(flow) if pause else flow)
            at += not pause
            shown.append(pictures[at])
        return {
            "grid": np.stack(grids),
            "picture": np.stack(shown)[:, None],
            "before": pictures[:1],
            "flow_back": np.stack(flows),
        }


def _augmented(item: dict[str, NDArray[Any]], how: Augmentation, rng: np.random.Generator) -> dict[str, NDArray[Any]]:
    grid, flow = item["grid"], item["flow_back"]
    noisy = rng.random(grid.shape, np.float32) < how.noise_share
    grid = grid + noisy * (how.noise * rng.standard_normal(grid.shape, np.float32))
    hot = rng.random(grid.shape[-2:]) < rng.uniform(0, how.hot)
    item |= {"grid": grid + hot * rng.normal(0, 1, grid.shape[-2:])}
    for axis, sign in ((-1, (-1, 1)), (-2, (1, -1))):
        if how.flip and rng.random() < 0.5:
            item = {name: np.flip(value, axis) for name, value in item.items()}
            item["flow_back"] = item["flow_back"] * np.array(sign, flow.dtype)[:, None, None]
    return item
