"""Event times of the ideal pixel from 1 kHz frames against the truth, the same scene sampled at 100 kHz: errors [us] in
the smooth and the sharp part of a disk, recall, precision, bias, and whether events clump at frame times."""

import numpy as np
import pecs
import pytest
from pecs_lab import scenes

THRESHOLD, FRAMES, FRAME_US, SIZE = 0.2, 12, 1000.0, (150, 130)
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
    # Phase within the frame: 1 in every twentieth if nothing clumps; then the truth's own.
    for name, e in (("clumping", events), ("true_clumping", true)):
        counts, _ = np.histogram(e[:, 1] % frame_us, bins=20, range=(0, frame_us))
        out[name] = float(counts.max() / counts.mean())
    return out


def test_times_against_100_khz():
    light, t_us = scenes.disk(*SIZE), np.arange(FRAMES) * FRAME_US
    frames = np.stack([light(t * 1e-6).astype(np.float32) for t in t_us])
    height, width = frames.shape[1:]
    y, x = np.mgrid[0:height, 0:width]
    smooth = (np.hypot(x - (width - 1) / 2, y - (height - 1) / 2) >= scenes.DISK_SECTORS_PX).ravel()
    events = pecs.simulate(frames, t_us, chip="ideal")
    ours = np.column_stack([events["y"].astype(int) * width + events["x"], events["t"], events["p"]])
    got = score(ours, truth(light, t_us[-1]), smooth, FRAME_US)
    assert got["true_events"] > 10_000
    assert got["recall"] > 0.997 and got["precision"] > 0.997
    assert got["smooth"]["median_us"] < 0.4
    assert got["edges"]["median_us"] < 180
    assert abs(got["smooth"]["bias_us"]) < 0.2
    # Events come at all phases of a frame, as the truth's do.
    assert got["clumping"] == pytest.approx(got["true_clumping"], rel=0.1)
