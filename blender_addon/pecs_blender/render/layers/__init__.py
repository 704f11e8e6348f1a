# SPDX-License-Identifier: GPL-3.0-or-later
"""What a stack holds of each instant (docs/reference/exr_stack.md), one file each. To add one: a class with the
protocol Layer, a line in KINDS, its name in options.py."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..output import Output
from .depth import Depth
from .light import Light
from .motion import Motion
from .normal import Normal
from .objects import Objects


class Layer(Protocol):
    name: str
    channels: tuple[str, ...]
    unit: str
    at: str  # "instant" or "interval"

    def render(self, *t_s: float) -> np.ndarray:
        """[channels, height, width] of the instant t_s, at which the scene stands; or of the interval between two,
        from one to the other of which this moves the scene."""


def write(layer: Layer, output: Output, index: int, *t_s: float) -> None:
    """Renders it, and what is known beside it."""
    values = layer.render(*t_s)
    if isinstance(layer, Objects):
        output.write_objects(index, layer.described)
    output.write_layer(layer.name, index, values)


KINDS = {kind.name: kind for kind in (Depth, Normal, Motion, Objects)}  # beside the light; each is made of a Look


def entry(layer: Layer) -> dict:
    """Of stack.json."""
    files = f"{layer.name}_%06d.exr"
    return {"name": layer.name, "files": files, "channels": list(layer.channels), "unit": layer.unit, "at": layer.at}


__all__ = ["KINDS", "Layer", "Light", "entry", "write"]
