"""Time of the live view's sensor for a frame, without a window: `push` (light to events, and each event's time into
the picture that is drawn) on one thread, and the sum over RGBA before it. 24 frames a second of a textured disk that
crosses a textured ground ("busy": eight times as fast, and turning). CPU time of the process (others share the
machine), median and 95 % over the frames, best median of the passes. JSON.

PYTHONPATH=python:blender_addon .venv/bin/python scripts/bench/live_view.py [--passes 5] [--frames 48]
"""

import itertools
import time

import numpy as np
from pecs_blender.ui.live_sensor import QUICK, LiveSensor
from pecs_lab.measure import command

FPS = 24


def pictures(width: int, height: int, count: int, busy: bool) -> np.ndarray:
    """[count, height, width, 4] linear RGBA."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    ground = 0.3 + 0.1 * np.sin(x * 0.2) * np.sin(y * 0.2)
    out = np.ones((count, height, width, 4), np.float32)
    for i in range(count):
        speed = 0.4 if busy else 0.05
        dx, dy = x - width * (0.3 + speed * i / count), y - height / 2
        disk = np.clip(height / 4 - np.hypot(dx, dy), 0, 1)
        spokes = 0.5 + 0.4 * np.tanh(8 * np.sin(6 * np.arctan2(dy, dx) + 0.3 * i * busy))
        out[i, ..., :3] = (ground + disk * (spokes - ground))[..., None]
    return out


def measure(width: int, height: int, chip: str, rgba: np.ndarray) -> dict:
    sensor = LiveSensor(width, height, chip)
    sums, pushes, events = [], [], 0
    for picture in rgba:
        start = time.process_time()
        light = sensor.light(picture)
        middle = time.process_time()
        events += len(sensor.push(light, 1 / FPS))
        pushes.append(1e3 * (time.process_time() - middle))
        sums.append(1e3 * (middle - start))
    sensor.close()
    return {
        "width": width,
        "height": height,
        "chip": chip,
        "events_per_frame": round(events / len(rgba)),
        "push_ms": round(float(np.median(pushes)), 3),
        "push_p95_ms": round(float(np.percentile(pushes, 95)), 3),
        "rgba_sum_ms": round(float(np.median(sums)), 3),
    }


def main(*, passes: int = 5, frames: int = 48) -> dict:
    rows = []
    for (width, height), busy in itertools.product(((346, 260), (1280, 720)), (False, True)):
        rgba = pictures(width, height, frames, busy)
        for chip in (QUICK, "imx636"):
            runs = [measure(width, height, chip, rgba) for _ in range(passes)]
            rows.append({"busy": busy} | min(runs, key=lambda run: run["push_ms"]))
    return {"settings": rows}


if __name__ == "__main__":
    command(main)
