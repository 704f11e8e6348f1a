"""LPIPS: how different two pictures look, by the features of a network that names things (Zhang, Isola, Efros,
Shechtman and Wang, CVPR 2018, eq. 1).

Its weights are others' and do not ship. One file has them all: torchvision's state dict of alexnet or vgg16
(`features.0.weight`, ...), and in it the linear layers of the package lpips, version 0.1 (`lin0.model.1.weight`, ...).
Whoever has that package writes it by `torch.save(lpips.LPIPS(net="alex").state_dict(), FILE)`; the names that it gives
(`net.slice1.0.weight`, ...) are read, too.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from .._errors import bad_input, existing

# Of a picture in -1 ... 1, red, green, blue: what ImageNet's mean and standard deviation become there.
MEAN, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
SMALLEST = 1e-10  # length of features that are taken as 0
_NAMES = re.compile(r"(?:features|net\.slice\d+)\.(\d+)\.(weight|bias)")


@dataclass(frozen=True)
class _Trunk:
    """stages: convolutions up to each layer that is compared: index in torchvision's `features`, channels, kernel."""

    name: str
    stages: tuple[tuple[tuple[int, int, int], ...], ...]
    pooled: tuple[bool, ...]  # which stages begin with max pooling, by 2
    pool: int  # width of its kernel
    first: tuple[int, int]  # stride and padding of the first convolution; the others keep the size
    least_px: int  # side of the smallest picture


ALEXNET = _Trunk(
    "AlexNet",
    (((0, 64, 11),), ((3, 192, 5),), ((6, 384, 3),), ((8, 256, 3),), ((10, 256, 3),)),
    (False, True, True, False, False),
    3,
    (4, 2),
    31,
)
VGG16 = _Trunk(
    "VGG16",
    (
        ((0, 64, 3), (2, 64, 3)),
        ((5, 128, 3), (7, 128, 3)),
        ((10, 256, 3), (12, 256, 3), (14, 256, 3)),
        ((17, 512, 3), (19, 512, 3), (21, 512, 3)),
        ((24, 512, 3), (26, 512, 3), (28, 512, 3)),
    ),
    (False, True, True, True, True),
    2,
    (1, 1),
    16,
)


class Lpips:
    """lpips(a, b) -> [N]: distances of pictures [N, 1, H, W], 0 ... 1, grey as three equal colours.

    Pictures have `least_px` or more. Raises PecsNotFoundError for no file, PecsInputError for another network.
    """

    def __init__(self, path: Path, device: str = "cpu"):
        found = _tensors(path)
        self.trunk = VGG16 if found.get("0.weight", torch.empty(0)).shape[-1:] == (3,) else ALEXNET
        self.least_px = self.trunk.least_px
        self.sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
        wanted: dict[str, tuple[int, ...]] = {}
        inside = 3
        for number, stage in enumerate(self.trunk.stages):
            for index, channels, kernel in stage:
                wanted |= {f"{index}.weight": (channels, inside, kernel, kernel), f"{index}.bias": (channels,)}
                inside = channels
            wanted[f"lin{number}"] = (1, inside, 1, 1)
        for name, shape in wanted.items():
            if name not in found or tuple(found[name].shape) != shape:
                got = tuple(found[name].shape) if name in found else "nothing"
                place = name if name.startswith("lin") else f"features.{name}"
                raise bad_input(path, place, got, f"{list(shape)} of {self.trunk.name} with LPIPS' linear layers")
            if not torch.isfinite(found[name]).all():
                raise bad_input(path, name, "values that are not finite", "finite weights")
        self._weights = {name: found[name].float().to(device) for name in wanted}
        self._mean, self._scale = (torch.tensor(v, device=device).view(1, 3, 1, 1) for v in (MEAN, SCALE))

    def __call__(self, a: Tensor, b: Tensor) -> Tensor:
        total = a.new_zeros(len(a))
        for number, (x, y) in enumerate(zip(self._features(a), self._features(b), strict=True)):
            apart = (F.normalize(x, dim=1, eps=SMALLEST) - F.normalize(y, dim=1, eps=SMALLEST)) ** 2
            total = total + F.conv2d(apart, self._weights[f"lin{number}"]).mean((1, 2, 3))
        return total

    def _features(self, picture: Tensor) -> list[Tensor]:
        x, out = (2 * picture - 1 - self._mean) / self._scale, []
        for stage, pooled in zip(self.trunk.stages, self.trunk.pooled, strict=True):
            if pooled:
                x = F.max_pool2d(x, self.trunk.pool, 2)
            for index, _, kernel in stage:
                stride, padding = (1, kernel // 2) if index else self.trunk.first
                x = torch.relu(
                    F.conv2d(x, self._weights[f"{index}.weight"], self._weights[f"{index}.bias"], stride, padding)
                )
            out.append(x)
        return out


def _tensors(path: Path) -> dict[str, Tensor]:
    """Weights and biases by the index in `features`, and lin0 ..."""
    existing(path, "weights of LPIPS")
    wanted = "a state dict, as torch.save writes it"
    try:
        values: Any = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as e:  # of many kinds
        raise bad_input(path, "file", (str(e).splitlines() or [type(e).__name__])[0], wanted) from None
    if not isinstance(values, dict) or not all(isinstance(v, Tensor) for v in values.values()):
        raise bad_input(path, "file", type(values).__name__, wanted)
    out = {}
    for name, value in values.items():
        if match := _NAMES.fullmatch(name):
            out[f"{match[1]}.{match[2]}"] = value
        elif match := re.fullmatch(r"(lin\d)\.model\.1\.weight", name):
            out[match[1]] = value
    return out
