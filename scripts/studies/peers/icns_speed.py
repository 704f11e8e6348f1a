"""Speed of our pixel with all its noise beside the ICNS C++ program with its own, one thread, CPU time; JSON.

    python scripts/studies/peers/icns_speed.py CHECKOUT [--passes 3]

Frames in memory to events. CHECKOUT: neuromorphicsystems/IEBCS at b478243, before its C++ (cpp/simu.h) was removed;
compiled here. Medians.
"""

import argparse
import json
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import pecs

HERE = Path(__file__).resolve().parent
SEQUENCES = {"disk": 500, "board": 100}


def ours(frames: np.ndarray, t_us: np.ndarray) -> tuple[float, int]:
    """CPU seconds from frames to sorted events, and how many."""
    with pecs.Sensor(frames.shape[2], frames.shape[1], "imx636", threads=1, photocurrent_a=2e-14) as sensor:
        start, count = time.process_time(), 0
        for i in range(0, len(t_us), 64):
            count += len(sensor.push(frames[i : i + 64], t_us[i : i + 64], last=i + 64 >= len(t_us)))
        return time.process_time() - start, count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--passes", type=int, default=3)
    args = parser.parse_args()
    from pecs_lab import scenes

    report = {}
    with tempfile.TemporaryDirectory() as folder:
        driver, raw, out = (Path(folder) / n for n in ("driver", "frames", "out"))
        command = ["g++", "-std=c++17", "-O3", "-march=native", "-o", driver, HERE / "icns_driver.cpp"]
        subprocess.run([*command, f"-I{args.checkout}/cpp"], check=True)
        for scene, count in SEQUENCES.items():
            frames, t_us = scenes.frames(scene, count)
            (frames * 255).tofile(raw)
            numbers = [frames.shape[2], frames.shape[1], count, 1000, 0.25, 0.29, 0.04, 100, 30, 100, 300, 0.02]
            peer, mine = [], []
            for _ in range(args.passes):
                run = subprocess.run([driver, raw, *map(str, numbers), out], check=True, capture_output=True, text=True)
                peer.append(float(run.stdout))
                mine.append(ours(frames, t_us))
            seconds = statistics.median(s for s, _ in mine)
            report[scene] = {
                "icns_s": statistics.median(peer),
                "icns_events": out.stat().st_size // 32,
                "pecs_s": seconds,
                "events": mine[0][1],
                "mpixel_frames_per_s": frames.size / seconds / 1e6,
                "times_icns": statistics.median(p / m for p, (m, _) in zip(peer, mine, strict=True)),
            }
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
