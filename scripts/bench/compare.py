"""Speed of pecs.compare and of scipy's KD-tree doing the same distances on the same cores; prints JSON.

    python scripts/bench/compare.py [--events 350000] [--passes 3]

Two draws of a disk of four sectors that turns, 1280x720.
"""

import os

import numpy as np
import pecs
from pecs_lab.measure import command, median_s
from scipy.spatial import cKDTree

WIDTH, HEIGHT = 1280, 720


def disk(count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    events = np.zeros(count, pecs.EVENT_DTYPE)
    events["t"] = np.sort(random.integers(0, 54_000, count))
    radius = 300 * np.sqrt(random.random(count))
    delay_deg = random.triangular(20, 55, 90, count)  # behind the edge of its sector
    sector = random.integers(0, 4, count)
    angle = np.radians(90 * sector + events["t"] * 2098e-6 - delay_deg)
    events["x"] = 640 + radius * np.cos(angle)
    events["y"] = 360 - radius * np.sin(angle)
    events["p"] = sector % 2
    return events


def scipy_chamfer(a: np.ndarray, b: np.ndarray) -> float:
    def points(e: np.ndarray) -> np.ndarray:
        columns = [(e[k].astype(float) - e[k].min()) / (int(e[k].max()) - int(e[k].min()) + 1e-6) for k in "xypt"]
        return np.stack(columns, axis=1) * [100, 100, 100, 1000]

    a, b = points(a), points(b)
    return cKDTree(b).query(a, workers=-1)[0].mean() + cKDTree(a).query(b, workers=-1)[0].mean()


def main(*, events: int = 350_000, passes: int = 3) -> dict:
    a, b = (disk(events, seed) for seed in (1, 2))

    def ours() -> float:
        return pecs.compare(a, b, width=WIDTH, height=HEIGHT, normalisation="eq16", split_half=False)["chamfer"]

    seconds, value = median_s(ours, passes)
    scipy_s, reference = median_s(lambda: scipy_chamfer(a, b), passes)
    assert abs(value - reference) < 1e-3 * reference, (value, reference)
    found = {"cores": os.cpu_count(), "events": events, "pecs_s": seconds, "chamfer": value}
    return found | {"scipy_s": scipy_s, "speedup": scipy_s / seconds}


if __name__ == "__main__":
    command(main)
