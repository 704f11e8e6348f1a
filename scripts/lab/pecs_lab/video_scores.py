"""Scores of a reconstructed picture against the true one. Needs PyTorch and piq."""

from functools import cache
from pathlib import Path

import numpy as np
import piq
import torch
from pecs.learning.lpips import Lpips

MS_SSIM_WEIGHTS = (0.0448, 0.2856, 0.3001)  # of scales: those that 107 pixels have room for, scaled to sum 1


@cache
def _lpips(path: Path) -> Lpips:
    return Lpips(path)


def picture_scores(picture: np.ndarray, truth: np.ndarray, lpips: Path | None = None) -> dict[str, float]:
    """Both [H, W], 0 ... 1. PSNR in dB; SSIM, MS-SSIM, HaarPSI; LPIPS by weights as `Lpips` reads them."""
    a, b = (torch.from_numpy(np.ascontiguousarray(p, np.float32))[None, None].clamp(0, 1) for p in (picture, truth))
    weights = torch.tensor(MS_SSIM_WEIGHTS) / sum(MS_SSIM_WEIGHTS)
    out = {
        "psnr": float(piq.psnr(a, b)),
        "ssim": float(piq.ssim(a, b, downsample=False)),
        "ms_ssim": float(piq.multi_scale_ssim(a, b, scale_weights=weights)),
        "haarpsi": float(piq.haarpsi(a, b)),
    }
    if lpips:
        with torch.no_grad():
            out["lpips"] = float(_lpips(lpips)(a, b))
    return out
