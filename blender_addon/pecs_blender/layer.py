# SPDX-License-Identifier: GPL-3.0-or-later
"""What all layers have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from .output import Output


class Layer(ABC):
    """A picture for each instant (`at` is "instant") or for each interval between neighbouring instants ("interval").
    name, channels, unit: as stack.json lists them."""

    name: str
    channels: tuple[str, ...]
    unit: str
    at: str

    @abstractmethod
    def render(self, *t_s: float) -> np.ndarray:
        """[channels, height, width] of the instant t_s, to which the scene has been moved; or of the interval between
        two times, over which this method moves the scene."""

    def is_written(self, output: Output, index: int) -> bool:
        return output.has_layer(self.name, index)

    def write(self, output: Output, index: int, *t_s: float) -> None:
        output.write_layer(self.name, index, self.render(*t_s))

    def finish(self, output: Output) -> None:  # noqa: B027 (most layers have nothing to do)
        """Called when all frames of this process are written."""

    @classmethod
    def entry(cls) -> dict[str, Any]:
        """The layer in stack.json."""
        files = f"{cls.name}_%06d.exr"
        return {"name": cls.name, "files": files, "channels": list(cls.channels), "unit": cls.unit, "at": cls.at}
