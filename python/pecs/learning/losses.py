"""Losses of the training. Pictures are [N, 1, H, W], 0 … 1."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from .limits import SSIM_WINDOW

WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)  # per scale (Wang, Simoncelli, Bovik 2003)
C1, C2 = 0.01**2, 0.03**2
WINDOW, SIGMA = SSIM_WINDOW, 1.5  # pixels (Wang et al. 2004)
OCCLUDED = 50.0  # alpha of the temporal loss: decay of its weight with the change of the picture (Rebecq et al. 2019)


def _blurred(x: Tensor) -> Tensor:
    at = torch.arange(WINDOW, dtype=x.dtype, device=x.device) - WINDOW // 2
    kernel = torch.exp(-(at**2) / (2 * SIGMA**2))
    kernel = kernel / kernel.sum()
    return F.conv2d(F.conv2d(x, kernel.view(1, 1, -1, 1)), kernel.view(1, 1, 1, -1))


def ms_ssim(a: Tensor, b: Tensor) -> Tensor:
    """Mean over pictures of MS-SSIM (Wang, Simoncelli, Bovik 2003) at those of its five scales whose pictures are at
    least as large as the window; their weights sum to 1."""
    smaller = min(a.shape[-2:])
    scales = [i for i in range(len(WEIGHTS)) if smaller >> i >= WINDOW] or [0]
    weights = torch.tensor([WEIGHTS[i] for i in scales], dtype=a.dtype, device=a.device)
    product = torch.ones(len(a), dtype=a.dtype, device=a.device)
    for i, weight in zip(scales, weights / weights.sum(), strict=True):
        mean_a, mean_b = _blurred(a), _blurred(b)
        variance_a, variance_b = _blurred(a * a) - mean_a**2, _blurred(b * b) - mean_b**2
        covariance = _blurred(a * b) - mean_a * mean_b
        value = (2 * covariance + C2) / (variance_a + variance_b + C2)
        if i == scales[-1]:
            value = value * (2 * mean_a * mean_b + C1) / (mean_a**2 + mean_b**2 + C1)
        product = product * value.mean((1, 2, 3)).clamp(min=1e-6) ** weight
        a, b = F.avg_pool2d(a, 2), F.avg_pool2d(b, 2)
    return product.mean()


def warped(picture: Tensor, flow_px: Tensor) -> tuple[Tensor, Tensor]:
    """The picture warped by flow [N, 2, H, W], and a mask [N, 1, H, W] of finite flow that ends inside the picture."""
    height, width = picture.shape[-2:]
    y, x = torch.meshgrid(
        torch.arange(height, device=picture.device), torch.arange(width, device=picture.device), indexing="ij"
    )
    at_x, at_y = x + flow_px[:, 0], y + flow_px[:, 1]
    known = torch.isfinite(at_x) & (at_x >= 0) & (at_x <= width - 1) & (at_y >= 0) & (at_y <= height - 1)
    grid = torch.stack([2 * at_x / (width - 1) - 1, 2 * at_y / (height - 1) - 1], -1)
    grid = torch.where(known[..., None], grid, torch.zeros_like(grid))
    return F.grid_sample(picture, grid.to(picture.dtype), align_corners=True), known[:, None]


def temporal(now: Tensor, before: Tensor, truth: Tensor, truth_before: Tensor, flow_back_px: Tensor) -> Tensor:
    """Difference between a picture and the previous one, warped by the flow from this one back to it. The weight is
    lower where the true pictures differ, too (Rebecq et al., TPAMI 2019, eq. 5-6)."""
    came, known = warped(before, flow_back_px)
    truly, _ = warped(truth_before, flow_back_px)
    weight = torch.exp(-OCCLUDED * (truth - truly) ** 2) * known
    return (weight * (now - came).abs()).sum() / known.sum().clamp(min=1)
