"""A recording of the lab's turning disk as footage: its events on a coarser grid, with the aligned scene's render at
the same instants, cut to the disk; scores of reconstructed pictures. Needs PyTorch and piq."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pecs
import piq
import torch
from pecs._arguments import latest
from pecs.datasets.rgb import srgb
from pecs.learning.clips import WHITE_PERCENTILE
from pecs.learning.footage import Footage

from . import sequences
from .disk import Disk, edges

MS_SSIM_WEIGHTS = (0.0448, 0.2856, 0.3001)  # of scales: those that 107 pixels have room for, scaled to sum 1


def rendered(name: str, folder: Path, plan: dict) -> Path:
    """The aligned scene's stack at the plan's instants, by the Blender of .venv."""
    sequence, root = sequences.load(name), sequences.ROOT
    if not (folder / "stack/stack.json").exists():
        options = sequences.render_arguments(sequence, plan["coarser"], None)
        options += [f"--fps={plan['fps']}", f"--frames={plan['first_frame']}:{plan['first_frame'] + plan['frames']}"]
        options += [f"--bands={plan['bands']}", f"--samples={plan['samples']}"]
        environment = os.environ | {"PYTHONPATH": f"{root / 'python'}{os.pathsep}{root / 'blender_addon'}"}
        python = root / ".venv/bin/python"
        command = [python, "-m", "pecs_blender", "render", sequence.scene, "-o", folder / "stack", *options]
        subprocess.run(latest(command), env=environment, check=True, stdout=sys.stderr)
    return folder / "stack"


def load(real: Path, folder: Path, plan: dict) -> tuple[Footage, Disk]:
    """plan: "real" of scripts/studies/reconstruction.json."""
    sequence, factor = sequences.load(plan["sequence"]), plan["coarser"]
    left, top, right, bottom = (v // factor for v in sequence.render["moving_px"])
    with pecs.Chip(sequence.sense["chip"]) as chip:
        stack = rendered(plan["sequence"], folder, plan)
        light = chip.photocurrent(stack, range(plan["frames"]))[:, top:bottom, left:right]
    pictures = srgb(light / np.percentile(light, WHITE_PERCENTILE))
    times_us = (plan["first_frame"] + np.arange(plan["frames"])) * 1e6 / plan["fps"]

    events = pecs.read(real)
    kept = events[(events["x"] % factor == factor // 2) & (events["y"] % factor == factor // 2)].copy()
    x, y = kept["x"].astype(int) // factor - left, kept["y"].astype(int) // factor - top
    inside = (x >= 0) & (x < right - left) & (y >= 0) & (y < bottom - top)
    cut = np.asarray(kept[inside])
    cut["x"], cut["y"] = x[inside], y[inside]
    return Footage(plan["sequence"], cut, times_us, pictures), sequence.disk.coarser(factor).moved(-left, -top)


def picture_scores(picture: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Both [H, W], 0 ... 1. PSNR in dB; SSIM, MS-SSIM, HaarPSI."""
    a, b = (torch.from_numpy(np.ascontiguousarray(p, np.float32))[None, None].clamp(0, 1) for p in (picture, truth))
    weights = torch.tensor(MS_SSIM_WEIGHTS) / sum(MS_SSIM_WEIGHTS)
    return {
        "psnr": float(piq.psnr(a, b)),
        "ssim": float(piq.ssim(a, b, downsample=False)),
        "ms_ssim": float(piq.multi_scale_ssim(a, b, scale_weights=weights)),
        "haarpsi": float(piq.haarpsi(a, b)),
    }


def scores(method, footage: Footage, disk: Disk, plan: dict) -> dict[str, float]:
    """Means over the pictures after the first windows, inside the disk; medians of its edges' positions and widths."""
    half = disk.radius_px / np.sqrt(2)
    x, y = disk.centre_px
    box = np.s_[round(y - half) : round(y + half), round(x - half) : round(x + half)]
    rows, found = [], []
    for k, window in enumerate(footage.windows):
        picture = method(window)
        if k >= plan["skipped_windows"]:
            rows.append(picture_scores(picture[box], footage.pictures[k + 1][box] / 255.0))
            found.append(edges(picture, disk, window.end_us))
    ahead, width = np.stack(found, 1)  # [pictures, edges, radii]
    seen = np.isfinite(ahead)
    ahead, width = (v[seen] if seen.any() else np.array([np.nan]) for v in (ahead, width))
    out = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]} | {"edges_found": float(seen.mean())}
    medians = {"edge_error_px": np.abs(ahead), "edge_ahead_px": ahead, "edge_width_px": width}
    return out | {key: float(np.median(values)) for key, values in medians.items()}
