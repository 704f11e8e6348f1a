"""LPIPS: perceptual distance of two pictures from the features of a classification network (Zhang, Isola, Efros,
Shechtman and Wang, CVPR 2018, eq. 1), with the network of the package lpips.

Its weights do not ship: the file is what `torch.save(lpips.LPIPS(net="alex").state_dict(), FILE)` writes, or net="vgg".
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional as F

from .._errors import bad_input, existing, optional_module
from .._files import sha256
from .tensors import load_tensors

SMALLEST = 1e-10  # features of a smaller norm count as 0
LEAST_PX = {"alex": 31, "vgg": 16}  # side of the smallest picture


class Lpips:
    """lpips(a, b) -> [N]: distances of pictures [N, 1, H, W], 0 ... 1, grey as three equal colours.

    Pictures have `least_px` or more. Raises PecsNotFoundError for no file, PecsInputError for another network.
    """

    def __init__(self, path: Path, device: str = "cpu"):
        package = optional_module("lpips", "lpips", "LPIPS", "lpips")
        self.sha256 = sha256(existing(path, "weights of LPIPS"))
        wanted = "a state dict of lpips.LPIPS, as torch.save writes it"
        values = load_tensors(path, wanted)
        try:
            self.kind = "vgg" if "net.slice1.2.weight" in values else "alex"
            self._net = package.LPIPS(net=self.kind, pretrained=False, pnet_rand=True, verbose=False)
            self._net.load_state_dict(values)
        except Exception as e:  # PyTorch raises many types
            raise bad_input(path, "file", " ".join(str(e).split()) or type(e).__name__, wanted) from None
        for name, value in values.items():
            if not torch.isfinite(value).all():
                raise bad_input(path, name, "values that are not finite", "finite weights")
        self.least_px = LEAST_PX[self.kind]
        self._net.to(device).requires_grad_(False)

    def __call__(self, a: Tensor, b: Tensor) -> Tensor:
        """Normalises features itself: the gradient of the package's `normalize_tensor` is NaN where all are 0."""
        scaled = [self._net.scaling_layer((2 * picture - 1).expand(-1, 3, -1, -1)) for picture in (a, b)]
        total = a.new_zeros(len(a))
        for layer, x, y in zip(self._net.lins, *map(self._net.net, scaled), strict=True):
            apart = (F.normalize(x, dim=1, eps=SMALLEST) - F.normalize(y, dim=1, eps=SMALLEST)) ** 2
            total = total + layer.model(apart).mean((1, 2, 3))
        return total
