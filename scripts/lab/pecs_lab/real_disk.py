"""A recording of the lab's turning disk as footage: its events on a coarser grid, with the aligned scene's render at
the same instants, cut to the disk."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pecs
from pecs.datasets.rgb import srgb
from pecs.learning.clips import WHITE_PERCENTILE
from pecs.learning.footage import Footage

from . import sequences
from .disk import Disk, edges
from .video_scores import picture_scores

CENTRE_PX, RADIUS_PX = (956.76, 361.68), 303.0  # of R_360_L, by `pecs align detect`
PLANNED = ("--fps", "--frames", "--bands", "--samples")


def disk_of(sequence: sequences.Sequence) -> Disk:
    p = sequence.parameters
    return Disk(CENTRE_PX, RADIUS_PX, 6 * p["rpm"], p["phase_deg"], p["sectors"])


def rendered(name: str, folder: Path, plan: dict) -> Path:
    """The aligned scene's stack at the plan's instants, by the Blender of .venv."""
    sequence, root = sequences.load(name), sequences.ROOT
    if not (folder / "stack/stack.json").exists():
        options = [
            w for w in sequences.render_arguments(sequence, plan["coarser"], None) if w.split("=")[0] not in PLANNED
        ]
        options += [f"--fps={plan['fps']}", f"--frames={plan['first_frame']}:{plan['first_frame'] + plan['frames']}"]
        options += [f"--bands={plan['bands']}", f"--samples={plan['samples']}"]
        environment = os.environ | {"PYTHONPATH": f"{root / 'python'}{os.pathsep}{root / 'blender_addon'}"}
        python = root / ".venv/bin/python"
        command = [python, "-m", "pecs_blender", "render", sequence.scene, "-o", folder / "stack", *options]
        subprocess.run(list(map(str, command)), env=environment, check=True, stdout=sys.stderr)
    return folder / "stack"


def _box(sequence: sequences.Sequence, factor: int) -> tuple[int, ...]:
    """left, top, right, bottom of the disk on the coarse grid."""
    return tuple(v // factor for v in sequence.render["moving_px"])


def photocurrent(folder: Path, plan: dict) -> np.ndarray:
    """Of the disk's pixels at the plan's instants, A [n, H, W]."""
    sequence = sequences.load(plan["sequence"])
    left, top, right, bottom = _box(sequence, plan["coarser"])
    stack = rendered(plan["sequence"], folder, plan)
    with pecs.Chip(sequence.sense["chip"]) as chip:
        return chip.photocurrent(stack, range(plan["frames"]))[:, top:bottom, left:right]


def load(real: Path, folder: Path, plan: dict) -> tuple[Footage, Disk]:
    """plan: "real" of scripts/studies/reconstruction.json."""
    sequence, factor = sequences.load(plan["sequence"]), plan["coarser"]
    left, top, right, bottom = _box(sequence, factor)
    light = photocurrent(folder, plan)
    pictures = srgb(light / np.percentile(light, WHITE_PERCENTILE))
    times_us = (plan["first_frame"] + np.arange(plan["frames"])) * 1e6 / plan["fps"]

    events = pecs.read(real)
    kept = events[(events["x"] % factor == factor // 2) & (events["y"] % factor == factor // 2)].copy()
    x, y = kept["x"].astype(int) // factor - left, kept["y"].astype(int) // factor - top
    inside = (x >= 0) & (x < right - left) & (y >= 0) & (y < bottom - top)
    cut = np.asarray(kept[inside])
    cut["x"], cut["y"] = x[inside], y[inside]
    return Footage(plan["sequence"], cut, times_us, pictures), disk_of(sequence).coarser(factor).moved(-left, -top)


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
