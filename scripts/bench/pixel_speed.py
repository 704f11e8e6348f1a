"""The sensor beside other programs on the same frames in memory, by turns: medians of CPU times, and of their ratios.
JSON.

    python scripts/bench/pixel_speed.py [--esim CHECKOUT] [--icns CHECKOUT] [--build build/release] [--passes 5]

--esim: ideal pixels (`bench_pixel_speed`) beside a checkout of github.com/uzh-rpg/rpg_vid2e. Ours sorts its events and
hands them on 64 frames at a time, as to a file; esim does not sort, and keeps them. A run of ours has three passes,
warm except the first (`cold`). Threads are compared by the wall's clock, so on a quiet machine.
--icns: a pixel with all its noise beside neuromorphicsystems/IEBCS at b478243, before its C++ (cpp/simu.h) was removed,
with its own; one thread. Programs are compiled here (g++, OpenCV, Eigen, Boost).
"""

import json
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import scenes
from pecs_lab.measure import answer, command
from pecs_lab.peers import DRIVERS, build_esim

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


def noisy_s(frames: np.ndarray, t_us: np.ndarray) -> tuple[float, int]:
    """CPU seconds from frames to sorted events, and how many."""
    with pecs.Sensor(frames.shape[2], frames.shape[1], "imx636", threads=1, photocurrent_a=2e-14) as sensor:
        start, count = time.process_time(), 0
        for i in range(0, len(t_us), 64):
            count += len(sensor.push(frames[i : i + 64], t_us[i : i + 64], last=i + 64 >= len(t_us)))
        return time.process_time() - start, count


def noisy(checkout: Path, passes: int, folder: Path) -> dict:
    driver, raw, out = (folder / n for n in ("icns", "frames.f32", "out.f64"))
    source = DRIVERS / "icns_driver.cpp"
    answer("g++", "-std=c++17", "-O3", "-march=native", "-o", driver, source, f"-I{checkout}/cpp")
    report = {}
    for scene, (width, height, count) in SIZES.items():
        frames, t_us = scenes.frames(scene, count)
        (frames * 255).tofile(raw)
        numbers = [width, height, count, 1000, 0.25, 0.29, 0.04, 100, 30, 100, 300, 0.02]
        peer, mine = [], []
        for _ in range(passes):
            peer.append(float(answer(driver, raw, *numbers, out)))
            mine.append(noisy_s(frames, t_us))
        seconds = [s for s, _ in mine]
        report[scene] = {
            "icns_s": statistics.median(peer),
            "icns_events": out.stat().st_size // EVENT_BYTES,
            "pecs_s": statistics.median(seconds),
            "events": mine[0][1],
            "times_icns": ratio(peer, seconds),
        }
    return report


def main(
    *, esim: Path | None = None, icns: Path | None = None, build: Path = ROOT / "build/release", passes: int = 5
) -> dict:
    report = {}
    with tempfile.TemporaryDirectory() as folder:
        if esim:
            report["ideal"] = ideal(build / "bin/bench_pixel_speed", esim, passes, Path(folder))
        if icns:
            report["noisy"] = noisy(icns, passes, Path(folder))
    return report


if __name__ == "__main__":
    command(main)
