"""The sensor on frames in memory, by the wall's clock and by CPU time of all threads, and this machine's copy
bandwidth: medians of the passes, and the first one (cold). JSON. Events are arrays in the end, as in Python.

    python scripts/bench/pixel_speed.py [disk board static] [--chip ideal] [--threads 1] [--passes 5] [--esim CHECKOUT]

    disk    346x260, 500 frames at 1 kHz: a turning disk of sectors
    board   1280x720, 100 frames at 1 kHz: a moving checkerboard
    static  1280x720, 100 frames

--esim: a checkout of github.com/uzh-rpg/rpg_vid2e, which is compiled here (g++, OpenCV, Eigen, Boost) and runs by turns
on the same frames; use --chip ideal. PECS sorts its events and hands them on 64 frames at a time, as to a file; esim
does not sort, and keeps them. Threads are compared by the wall's clock, so on a quiet machine.
"""

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pecs
from pecs_lab.measure import command
from pecs_lab.peers import build_esim, run_esim

SIZES = {"disk": (346, 260, 500), "board": (1280, 720, 100), "static": (1280, 720, 100)}
DARK, BRIGHT, RIM, SIDE_PX = 90.0, 240.0, 120.0, 60  # fA; side of a square
BATCH = 64  # frames of a push


def plane(name: str, i: int) -> np.ndarray:
    """Light of frame i [fA]; edges are smooth over a pixel."""
    width, height, _ = SIZES[name]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    if name == "disk":
        radius, angle = np.hypot(x - 173, y - 130), np.arctan2(y - 130, x - 173)
        phase, pixels = (angle + 0.0366 * i) * 8 / np.pi, radius * np.pi / 8
    else:
        phase, pixels = (x + (0 if name == "static" else 0.7 * i)) / SIDE_PX, SIDE_PX * (1 - y // SIDE_PX % 2 * 2)
    phase = np.mod(phase, 2)  # dark, then bright
    to_edge = np.where(phase < 1, -np.minimum(phase, 1 - phase), np.minimum(phase - 1, 2 - phase)) * pixels
    light = DARK + (BRIGHT - DARK) * np.clip(to_edge + 0.5, 0, 1)
    return np.where(radius > 126, RIM, light) if name == "disk" else light


def sense(frames: np.ndarray, chip: str, threads: int) -> int:
    """A sensor from its construction to its last event; how many events."""
    height, width = frames.shape[1:]
    options = {"photocurrent_a": 1e-15, "readout": "ideal", "threads": threads}
    with pecs.Sensor(width, height, chip, **options) as sensor:
        starts = range(0, len(frames), BATCH)
        parts = ((frames[i : i + BATCH], 1000.0 * np.arange(i, min(i + BATCH, len(frames)))) for i in starts)
        return sum(len(sensor.push(*part, last=i == starts[-1])) for i, part in zip(starts, parts, strict=True))


def spent(work: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU time of a piece of work, all threads together."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def measured(name: str, chip: str, threads: int, passes: int, esim: Callable[[np.ndarray], float] | None) -> dict:
    frames = np.stack([plane(name, i).astype(np.float32) for i in range(SIZES[name][2])])
    copy, events = frames.copy(), 0
    cold, ours, copies, theirs = spent(lambda: sense(frames, chip, threads)), [], [], []

    def work() -> None:
        nonlocal events
        events = sense(frames, chip, threads)

    for _ in range(passes):
        theirs += [esim(frames)] if esim else []
        copies.append(spent(lambda: np.copyto(copy, frames))[1])
        ours.append(spent(work))
    wall_s, cpu_s = map(statistics.median, zip(*ours, strict=True))
    copy_s = statistics.median(copies)
    found = {"events": events, "seconds": wall_s, "cpu_s": cpu_s, "least_cpu_s": min(cpu for _, cpu in ours)}
    found |= {"cold_s": cold[0], "cold_cpu_s": cold[1], "mpixel_frames_per_s": frames.size / cpu_s * 1e-6}
    found |= {"mevents_per_s": events / cpu_s * 1e-6, "copy_mpixels_per_s": frames.size / copy_s * 1e-6}
    found["of_copy"] = copy_s / cpu_s
    if theirs:
        ratios = [a / b for a, (_, b) in zip(theirs, ours, strict=True)]
        found |= {"esim_s": statistics.median(theirs), "times_esim": statistics.median(ratios)}
    return found


def main(
    sequences: list[str] = tuple(SIZES), *, chip: str = "ideal", threads: int = 1, passes: int = 5,
    esim: Path | None = None,
) -> dict:  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        driver = Path(folder) / "esim"
        if esim:
            build_esim(esim, driver)

        def peer(frames: np.ndarray) -> float:
            return run_esim(driver, frames, 1e-3, (0.2, 0.2), 0, 1e-9)[1]

        how = {"chip": chip, "threads": threads, "passes": passes}
        return how | {name: measured(name, **how, esim=peer if esim else None) for name in sequences}


if __name__ == "__main__":
    command(main)
