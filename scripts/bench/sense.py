"""`pecs sense` beside OpenEXR alone on the same files with the same threads: frames per second and peak memory, JSON.

python scripts/bench/sense.py [--build build/release] [--frames 60] [--passes 5] [--threads 2]
"""

import argparse
import json
import os
import statistics
import subprocess
import tempfile
from pathlib import Path

from pecs_lab.measure import measured


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=Path, default=Path("build/release"))
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--passes", type=int, default=5)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--chip", default="imx636")
    parser.add_argument("--size", default="1280x720")
    args = parser.parse_args()
    exr, pecs = (str(args.build / "bin" / name) for name in ("bench_exr_stack", "pecs"))
    with tempfile.TemporaryDirectory() as folder:
        stack, out = f"{folder}/stack", f"{folder}/out.raw"
        subprocess.run([exr, "make", stack, str(args.frames), *args.size.split("x")], check=True)
        alone, ours, memory = [], [], []
        for _ in range(args.passes):
            read = subprocess.run([exr, "read", stack, str(args.threads)], check=True, capture_output=True, text=True)
            alone.append(json.loads(read.stdout)["fps"])
            command = [pecs, "sense", stack, "-o", out, "--quiet", "--threads", str(args.threads), "--chip", args.chip]
            run = measured(command)
            assert run.exit == 0, run.errors
            ours.append(args.frames / run.seconds)
            memory.append(run.peak_mb)
        events = json.loads(Path(out + ".run.json").read_text())["results"]["events"]
    report = {
        "size": args.size,
        "bands": 6,
        "frames": args.frames,
        "threads": args.threads,
        "passes": args.passes,
        "chip": args.chip,
        "events": events,
        "openexr_alone_fps": statistics.median(alone),
        "sense_fps": statistics.median(ours),
        "ratio": statistics.median(a / b for a, b in zip(ours, alone, strict=True)),
        "peak_mb": max(memory),
    }
    print(json.dumps(report))


if __name__ == "__main__":
    main()
