"""`pecs sense` beside OpenEXR alone on the same files with the same threads: frames per second and peak memory, JSON.

python scripts/bench/sense.py [--build build/release] [--frames 60] [--passes 5] [--threads 2]
"""

import json
import os
import statistics
import tempfile
from pathlib import Path

from pecs_lab.measure import answer, command, measured


def main(
    *, build: Path = Path("build/release"), frames: int = 60, passes: int = 5, threads: int = os.cpu_count() or 1,
    chip: str = "imx636", size: str = "1280x720",
) -> dict:  # fmt: skip
    exr, pecs = (str(build / "bin" / name) for name in ("bench_exr_stack", "pecs"))
    with tempfile.TemporaryDirectory() as folder:
        stack, out = f"{folder}/stack", f"{folder}/out.raw"
        answer(exr, "make", stack, frames, *size.split("x"))
        alone, ours, memory = [], [], []
        for _ in range(passes):
            alone.append(json.loads(answer(exr, "read", stack, threads))["fps"])
            run = measured([pecs, "sense", stack, "-o", out, "--quiet", "--threads", threads, "--chip", chip])
            assert run.exit == 0, run.errors
            ours.append(frames / run.seconds)
            memory.append(run.peak_mb)
        events = json.loads(Path(out + ".run.json").read_text())["results"]["events"]
    return {
        "events": events,
        "openexr_alone_fps": statistics.median(alone),
        "sense_fps": statistics.median(ours),
        "ratio": statistics.median(a / b for a, b in zip(ours, alone, strict=True)),
        "peak_mb": max(memory),
    }


if __name__ == "__main__":
    command(main)
