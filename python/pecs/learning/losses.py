"""Losses of the training. Pictures are [N, 1, H, W], 0 … 1."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from .limits import SSIM_WINDOW

SCALES = 3  # each half as fine as the one before
C1, C2 = 0.01**2, 0.03**2
SIGMA = 1.5  # pixels (Wang et al. 2004)
COARSE = 8  # pixels, whose mean large uniform things determine
LEAST_RANGE = 0.1  # of a picture that is stretched


def _blurred(x: Tensor) -> Tensor:
    """By a Gaussian. Pictures are channels here: PyTorch's convolution of one channel takes 20 times as long."""
    at = torch.arange(SSIM_WINDOW, dtype=x.dtype, device=x.device) - SSIM_WINDOW // 2
    kernel = torch.exp(-(at**2) / (2 * SIGMA**2))
    kernel = (kernel / kernel.sum()).expand(len(x), 1, 1, SSIM_WINDOW)
    x = F.conv2d(x.transpose(0, 1), kernel.transpose(2, 3), groups=len(x))
    return F.conv2d(x, kernel, groups=len(kernel)).transpose(0, 1)


def ssim(a: Tensor, b: Tensor) -> Tensor:
    """Mean of SSIM (Wang et al. 2004) over pictures and scales that are at least as large as the window. The product of
    MS-SSIM would have hardly a gradient before a network is trained."""
    values = []
    for _ in range(SCALES):
        mean_a, mean_b = _blurred(a), _blurred(b)
        variance_a, variance_b = _blurred(a * a) - mean_a**2, _blurred(b * b) - mean_b**2
        covariance = _blurred(a * b) - mean_a * mean_b
        above = (2 * mean_a * mean_b + C1) * (2 * covariance + C2)
        values.append((above / ((mean_a**2 + mean_b**2 + C1) * (variance_a + variance_b + C2))).mean())
        a, b = F.avg_pool2d(a, 2), F.avg_pool2d(b, 2)
        if min(a.shape[-2:]) < SSIM_WINDOW:
            break
    return torch.stack(values).mean()


def correlation(a: Tensor, b: Tensor) -> Tensor:
    """Mean over pictures of the correlation of their values, whatever their brightness and contrast."""
    a, b = (x - x.mean((1, 2, 3), keepdim=True) for x in (a, b))
    product, variances = (a * b).mean((1, 2, 3)), (a * a).mean((1, 2, 3)) * (b * b).mean((1, 2, 3))
    return (product / (variances + C1**2).sqrt()).mean()


def l1(a: Tensor, b: Tensor) -> Tensor:
    """Mean difference of pixels, and of means over squares of COARSE pixels."""
    return (a - b).abs().mean() + F.avg_pool2d(a - b, COARSE).abs().mean()


def _stretched(x: Tensor) -> Tensor:
    """Each picture scaled to its 1 to 99 %, those of every fourth pixel."""
    some = x[..., ::2, ::2].flatten(1)
    low, high = (some.kthvalue(1 + round(share * (some.shape[1] - 1))).values for share in (0.01, 0.99))
    low, high = low.view(-1, 1, 1, 1), high.view(-1, 1, 1, 1)
    return ((x - low) / (high - low).clamp_min(LEAST_RANGE)).clamp(0, 1)


def stretched_mse(a: Tensor, b: Tensor) -> Tensor:
    """Mean squared difference of pictures that are stretched as for display."""
    return F.mse_loss(_stretched(a), _stretched(b))
