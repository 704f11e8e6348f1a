"""Event times of the ideal pixel from 1 kHz frames against the truth, the same scene sampled at 100 kHz: errors [us] in
the smooth and the sharp part of the disk, recall, precision, bias, and whether events clump at frame times. JSON.

    python scripts/bench/pixel_accuracy.py [--frames 60] [--fps 1000] [--esim CHECKOUT]

--esim: a checkout of github.com/uzh-rpg/rpg_vid2e, measured beside.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import scenes
from pecs_lab.peers import build_esim, run_esim

THRESHOLD = 0.2
GROUP_US = 1e8  # longer than any sequence: keeps pixels and polarities apart on one axis


def truth(light, end_us: float, fps: float = 1e5) -> np.ndarray:
    """[n, 3]: pixel, t_us, polarity; thresholds crossed by ln I, straight between samples."""
    step_us = 1e6 / fps
    last = np.log(light(0.0)).ravel()
    reference, found = last.copy(), []
    for i in range(1, round(end_us / step_us) + 1):
        now = np.log(light(i * step_us * 1e-6)).ravel()
        while True:
            off = now - reference
            hit = np.flatnonzero(np.abs(off) >= THRESHOLD)
            if not len(hit):
                break
            sign = np.sign(off[hit])
            reference[hit] += sign * THRESHOLD
            part = (reference[hit] - last[hit]) / (now[hit] - last[hit])
            found.append(np.column_stack([hit, (i - 1 + part) * step_us, sign > 0]))
        last = now
    return np.concatenate(found)


def nearest(of: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Signed distance [us] of each event to the nearest of its pixel and polarity."""

    def axis(e):
        return (e[:, 0] * 2 + e[:, 2]) * GROUP_US + e[:, 1]

    a, b = axis(of), np.sort(axis(among))
    k = np.clip(np.searchsorted(b, a), 1, len(b) - 1)
    left, right = a - b[k - 1], a - b[k]
    return np.where(np.abs(left) < np.abs(right), left, right)


def score(events: np.ndarray, true: np.ndarray, smooth: np.ndarray, frame_us: float) -> dict:
    out = {"events": len(events), "true_events": len(true)}
    error = nearest(events, true)
    out["precision"] = float(np.mean(np.abs(error) < frame_us))
    out["recall"] = float(np.mean(np.abs(nearest(true, events)) < frame_us))
    good = np.abs(error) < frame_us
    part = smooth[events[:, 0].astype(int)]
    for name, where in (("smooth", good & part), ("edges", good & ~part)):
        size = np.abs(error[where])
        out[name] = {
            "median_us": float(np.median(size)),
            "p95_us": float(np.quantile(size, 0.95)),
            "bias_us": float(np.mean(error[where])),
        }
    # Phase within the frame: 1 in every twentieth if nothing clumps; the truth's own beside it.
    for name, e in (("clumping", events), ("true_clumping", true)):
        counts, _ = np.histogram(e[:, 1] % frame_us, bins=20, range=(0, frame_us))
        out[name] = float(counts.max() / counts.mean())
    return out


def esim(checkout: Path, frames: np.ndarray, t_us: np.ndarray) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        driver = Path(folder) / "esim"
        build_esim(checkout, driver)
        rows, _ = run_esim(driver, frames, (t_us[1] - t_us[0]) * 1e-6, (THRESHOLD, THRESHOLD), 0, 1e-9)
    t, x, y, p = rows.T
    return np.column_stack([y * frames.shape[2] + x, t, p])


def measure(count: int, fps: float, size: tuple[int, int], peer: Path | None = None) -> dict:
    """size: width, height of the disk scene."""
    light, t_us = scenes.disk(*size), np.arange(count) * 1e6 / fps
    frames = np.stack([light(t * 1e-6).astype(np.float32) for t in t_us])
    height, width = frames.shape[1:]
    y, x = np.mgrid[0:height, 0:width]
    smooth = (np.hypot(x - (width - 1) / 2, y - (height - 1) / 2) >= scenes.DISK_SECTORS_PX).ravel()
    frame_us = 1e6 / fps
    true = truth(light, t_us[-1])
    events = pecs.simulate(frames, t_us, chip="ideal")
    ours = np.column_stack([events["y"].astype(int) * width + events["x"], events["t"], events["p"]])
    report = {"frames": count, "fps": fps, "pecs": score(ours, true, smooth, frame_us)}
    if peer:
        # Its first interval is wrong (docs/reference/models.md): compare without.
        theirs = esim(peer, frames, t_us)
        report["esim"] = score(theirs[theirs[:, 1] > frame_us], true[true[:, 1] > frame_us], smooth, frame_us)
    return report


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--fps", type=float, default=1000)
    parser.add_argument("--esim", type=Path)
    args = parser.parse_args()
    report = measure(args.frames, args.fps, (346, 260), args.esim)
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
