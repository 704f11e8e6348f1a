"""`bench_pixel_speed` beside esim on the same frames in memory, by turns; the median ratio of CPU times. JSON.

    python scripts/bench/pixel_speed.py --esim CHECKOUT [--build build/release] [--passes 5]

CHECKOUT: of github.com/uzh-rpg/rpg_vid2e (compiled here: g++, OpenCV, Eigen, Boost). Ours sorts its
events and hands them on 64 frames at a time, as to a file; esim does not sort, and keeps them. A run of ours has three
passes, warm except the first (`cold`). Threads are compared by the wall's clock, so on a quiet machine.
"""

import argparse
import json
import statistics
import subprocess
import tempfile
from pathlib import Path

from pecs_lab.peers import build_esim

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"disk": (346, 260, 500), "board": (1280, 720, 100)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--esim", type=Path, required=True)
    parser.add_argument("--build", type=Path, default=ROOT / "build/release")
    parser.add_argument("--passes", type=int, default=5)
    args = parser.parse_args()

    def ours(sequence: str, *more: object) -> dict:
        command = [args.build / "bin/bench_pixel_speed", sequence, "--passes", "3", *map(str, more)]
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    report = {}
    with tempfile.TemporaryDirectory() as folder:
        driver, raw, out = (Path(folder) / name for name in ("esim", "frames.f32", "out.f64"))
        build_esim(args.esim, driver)
        for sequence, size in SIZES.items():
            ours(sequence, "--dump", raw)
            runs, peer = [], []
            for _ in range(args.passes):
                command = [driver, raw, *map(str, size), "0.001", "0.2", "0.2", "0", "1e-9", out]
                run = subprocess.run(command, check=True, capture_output=True, text=True)
                peer.append(float(run.stdout))
                runs.append((ours(sequence), ours(sequence, "--threads", 2)))
            one, cold = ([first[key] for first, _ in runs] for key in ("cpu_s", "cold_cpu_s"))
            report[sequence] = {
                "esim_s": statistics.median(peer),
                "pecs_s": statistics.median(one),
                "cold_s": statistics.median(cold),
                "events": runs[0][0]["events"],
                "esim_events": out.stat().st_size // 32,
                "times_esim": statistics.median(p / o for p, o in zip(peer, one, strict=True)),
                "cold_times_esim": statistics.median(p / o for p, o in zip(peer, cold, strict=True)),
                "two_threads_gain": statistics.median(a["seconds"] / b["seconds"] for a, b in runs),
                "two_threads_cpu": statistics.median(b["cpu_s"] / a["cpu_s"] for a, b in runs),
            }
    report["static"] = ours("static", "--passes", args.passes)
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
