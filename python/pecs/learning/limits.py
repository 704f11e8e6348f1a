"""Limits of networks and of their training: the same for options, a run's config.json and a network's record."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from .._config import MAX_INTEGER, Fields

T = TypeVar("T")
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
    def of(fields: Fields) -> NetworkConfig:
        """Reads `network` of config.json or of an ONNX file's record."""
        return record(NetworkConfig, fields)
