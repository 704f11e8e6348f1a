# SPDX-License-Identifier: GPL-3.0-or-later
"""Uniform time steps."""

from __future__ import annotations

from typing import Protocol

from ..camera.stage import Stage
from ..output import Layer, Output
from ..scene.timeline import Timeline


class Frames(Protocol):
    """Writes the frames of a stack. warm_up: frames until all caches are full."""

    warm_up: int

    def is_written(self, index: int) -> bool: ...

    def write(self, index: int) -> None: ...


class Uniform:
    """Renders every instant, and the interval after it."""

    warm_up = 0

    def __init__(self, stage: Stage, instants: Timeline, layers: list[Layer], output: Output):
        self._stage, self._instants, self._layers, self._output = stage, instants, layers, output

    def is_written(self, index: int) -> bool:
        return not self._missing(index)

    def write(self, index: int) -> None:
        self._stage.set_time(self._instants.times_ns[index] * 1e-9)
        for layer in self._missing(index):
            layer.write(self._output, index, *times_s(layer, self._instants, index))

    def _missing(self, index: int) -> list[Layer]:
        layers = due(self._layers, self._instants, index)
        return [layer for layer in layers if not layer.is_written(self._output, index)]


def due(layers: list[Layer], instants: Timeline, index: int) -> list[Layer]:
    """Layers of an instant, then those of the interval after it, which move the scene on."""
    here = [layer for layer in layers if layer.at == "instant" or index + 1 < len(instants.bounds_ns)]
    return sorted(here, key=lambda layer: layer.at == "interval")


def times_s(layer: Layer, instants: Timeline, index: int) -> list[float]:
    bounds_s = [t * 1e-9 for t in instants.bounds_ns[index : index + 2]]
    return bounds_s[:1] if layer.at == "instant" else bounds_s
