"""Values of networks and of their training, and their limits: the same for options, a run's config.json and a network's
record."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from .._config import MAX_INTEGER, Fields

T = TypeVar("T")
WARM = 30  # first steps, over which the learning rate rises
SSIM_WINDOW = 11  # pixels (Wang et al. 2004): no clip is smaller
WHOLE = {
    "bins": (1, 256),
    "channels": (1, 1024),
    "levels": (1, 8),
    "windows": (1, 10_000),
    "chunk": (1, 10_000),
    "crop": (SSIM_WINDOW, 8192),
    "steps": (1, 10**9),
    "batch": (1, 4096),
    "decay_steps": (0, 10**9),
    "save_every": (1, 10**9),
    "seed": (0, MAX_INTEGER),
}
NUMBERS = {"learning_rate": (1e-12, 1e3)}  # others: 0 to 1e6


def record(kind: Callable[..., T], fields: Fields, **given: Any) -> T:
    """A dataclass of plain fields from the keys of the same names; `given`: its other fields."""
    values = dict(given)
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        key = field.name
        if key in given:
            continue
        if field.type == "int":
            values[key] = fields.integer(key, None, *WHOLE[key])
        elif field.type == "float":
            values[key] = fields.number(key, None, *NUMBERS.get(key, (0, 1e6)))
        elif field.type == "bool":
            values[key] = fields.flag(key)
        else:
            values[key] = fields.optional(fields.text, key) if "None" in str(field.type) else fields.text(key)
    fields.done()
    return kind(**values)


@dataclasses.dataclass(frozen=True)
class NetworkConfig:
    bins: int = 5  # of a window's events, in time
    channels: int = 24  # of each level
    levels: int = 4  # each has half the resolution of the one before

    @staticmethod
    def read(fields: Fields) -> NetworkConfig:
        """Reads `network` of config.json or of an ONNX file's record."""
        return record(NetworkConfig, fields)


@dataclasses.dataclass(frozen=True)
class Augmentation:
    """Faults of cameras that the simulation of a sequence has not. Each clip draws its own, up to these."""

    flip: bool = True
    noise_hz: float = 5.0  # median of the pixels' rates of noise, which have a long tail
    bursts: float = 0.4  # probability that events of the camera's own frames are there (DAVIS)


@dataclasses.dataclass(frozen=True)
class ClipConfig:
    """chunk: windows that gradients pass through; the state passes through all."""

    windows: int = 72
    chunk: int = 24
    crop: int = 144
    augmentation: Augmentation | None = Augmentation()


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    network: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)
    clips: ClipConfig = dataclasses.field(default_factory=ClipConfig)
    steps: int = 700
    batch: int = 2
    learning_rate: float = 2e-3
    decay_steps: int = 350  # last steps, over which the learning rate falls to 0
    ssim_weight: float = 0.5  # weight of 1 - SSIM, which is added to L1
    correlation_weight: float = 1.0  # weight of 1 - correlation, which is added too
    stretched_weight: float = 1.0  # weight of the MSE of stretched pictures, which is added too
    data: str = ""  # which sequences: another run of other ones does not continue this one
    weights_sha256: str | None = None  # hash of the network whose weights are the first ones
    lpips_sha256: str | None = None  # hash of LPIPS' weights; with them, LPIPS replaces the other losses
    save_every: int = 50
    seed: int = 1

    def rate(self, step: int) -> float:
        """The learning rate of a step, counted from 0."""
        return self.learning_rate * min(1.0, (step + 1) / WARM, (self.steps - step) / (self.decay_steps + 1))

    @staticmethod
    def read(fields: Fields) -> TrainConfig:
        """Reads config.json, or the options as JSON has them."""
        clips = fields.table("clips")
        how = clips.optional(clips.table, "augmentation")
        augmentation = how and record(Augmentation, how)
        clip = record(ClipConfig, clips, augmentation=augmentation)
        network = NetworkConfig.read(fields.table("network"))
        if clip.crop % 2**network.levels:
            raise clips.wrong("crop", f"a multiple of {2**network.levels}, for {network.levels} levels")
        return record(TrainConfig, fields, network=network, clips=clip)


@dataclasses.dataclass(frozen=True)
class ProceduralConfig:
    """size: width and height [px]; model: the pixel model that simulates."""

    count: int = 280
    size: int = 160
    duration_us: int = 3_000_000
    model: str = "pecs"
