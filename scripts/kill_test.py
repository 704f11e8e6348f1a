"""kill -9 at twenty random moments of a render, then to the end: the stack must be that of an unbroken run.

.venv/bin/python scripts/kill_test.py [KILLS]
"""

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
JOB = [
    "--bands",
    "6",
    "--fps",
    "1000",
    "--frames",
    "150",
    "--width",
    "96",
    "--samples",
    "2",
    "--colour-tolerance-px",
    "1",
]


def start(output):
    scene = str(ROOT / "scenes" / "rotating_disk")
    words = [sys.executable, "-m", "pecs_blender", "render", scene, "-o", str(output), *JOB]
    return subprocess.Popen(words, stderr=subprocess.DEVNULL)


def main(kills: int) -> int:
    with tempfile.TemporaryDirectory() as folder:
        whole, broken = Path(folder) / "whole", Path(folder) / "broken"
        began = time.monotonic()
        if start(whole).wait() != 0:
            sys.exit("the unbroken run failed")
        longest_s = 2.5 + (time.monotonic() - began) / kills  # about one run in all, starts included
        rng, killed, left = random.Random(1), 0, []
        for _ in range(kills):
            process = start(broken)
            try:
                process.wait(rng.uniform(0, longest_s))
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                process.wait()
                killed += 1
            left.append(len(list(broken.glob("frame_*.exr"))))
        if start(broken).wait() != 0:
            sys.exit("the last run failed")
        names = sorted(p.name for p in whole.iterdir())
        same = names == sorted(p.name for p in broken.iterdir()) and all(
            (whole / name).read_bytes() == (broken / name).read_bytes() for name in names
        )
        print(f"killed {killed} times of {kills}, frames after each: {left}; {len(names)} files, same: {same}")
        return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 20))
