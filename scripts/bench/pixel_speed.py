"""The sensor and another program on the same frames in memory, by turns: medians of CPU times, and of their ratios.
JSON.

    python scripts/bench/pixel_speed.py --esim CHECKOUT [--build build/release] [--passes 5]

Ideal pixels (`bench_pixel_speed`) and those of a checkout of github.com/uzh-rpg/rpg_vid2e, which is compiled here (g++,
OpenCV, Eigen, Boost). Ours sorts its events and hands them on 64 frames at a time, as to a file; esim does not sort,
and keeps them. A run of ours has three passes, warm except the first (`cold`). Threads are compared by the wall's
clock, so on a quiet machine.
"""

import json
import statistics
import tempfile
from pathlib import Path

from pecs_lab.measure import answer, command
from pecs_lab.peers import build_esim

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"disk": (346, 260, 500), "board": (1280, 720, 100)}
EVENT_BYTES = 32  # of a peer


def ratio(a: list[float], b: list[float]) -> float:
    return statistics.median(x / y for x, y in zip(a, b, strict=True))


def ideal(bench: Path, checkout: Path, passes: int, folder: Path) -> dict:
    def ours(sequence: str, *more: object) -> dict:
        return json.loads(answer(bench, sequence, "--passes", 3, *more))

    driver, raw, out = (folder / name for name in ("esim", "frames.f32", "out.f64"))
    build_esim(checkout, driver)
    report = {}
    for sequence, size in SIZES.items():
        ours(sequence, "--dump", raw)
        runs, peer = [], []
        for _ in range(passes):
            peer.append(float(answer(driver, raw, *size, 0.001, 0.2, 0.2, 0, 1e-9, out)))
            runs.append((ours(sequence), ours(sequence, "--threads", 2)))
        one, cold = ([first[key] for first, _ in runs] for key in ("cpu_s", "cold_cpu_s"))
        report[sequence] = {
            "esim_s": statistics.median(peer),
            "pecs_s": statistics.median(one),
            "cold_s": statistics.median(cold),
            "events": runs[0][0]["events"],
            "esim_events": out.stat().st_size // EVENT_BYTES,
            "times_esim": ratio(peer, one),
            "cold_times_esim": ratio(peer, cold),
            "two_threads_gain": statistics.median(a["seconds"] / b["seconds"] for a, b in runs),
            "two_threads_cpu": statistics.median(b["cpu_s"] / a["cpu_s"] for a, b in runs),
        }
    return report | {"static": ours("static", "--passes", passes)}


def main(*, esim: Path, build: Path = ROOT / "build/release", passes: int = 5) -> dict:
    with tempfile.TemporaryDirectory() as folder:
        return ideal(build / "bin/bench_pixel_speed", esim, passes, Path(folder))


if __name__ == "__main__":
    command(main)
