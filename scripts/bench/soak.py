#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""A long run: --events events through every command that reads them, with the peak memory of each. Memory that grows
with the recording shows as a peak that grows with --events.

    scripts/bench/soak.py [--events 1e9] [--only sense,evt3,info] [-o FOLDER]

Prints JSON: per command, events, seconds, peak memory and output size. Each file is removed after use; the largest
(CSV) takes about 16 bytes per event.
"""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pecs
from pecs import program
from pecs_lab.measure import measured
from pecs_lab.scenes import write_stack

WIDTH, HEIGHT, FRAMES, FRAME_US = 320, 180, 64, 250


def turning_disk() -> np.ndarray:
    """Sectors that turn once in FRAMES frames."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    angle = np.arctan2(y - HEIGHT / 2, x - WIDTH / 2)
    turned = 2 * np.pi * np.arange(FRAMES)[:, None, None] / FRAMES
    return 1e-4 * (1.1 + np.tanh(5 * np.sin(2 * (angle - turned))))


def row_of(name: str, command: list, events: int, output: Path | None = None) -> dict:
    run = measured(command)
    row = {"command": name, "events": events, "exit": run.exit}
    row |= {"seconds": round(run.seconds, 1), "peak_mb": round(run.peak_mb)}
    if output:
        row["mb"] = round(output.stat().st_size / 2**20) if output.exists() else None
    if run.exit:
        row["error"] = run.errors.strip()[-200:]
    print(json.dumps(row), file=sys.stderr, flush=True)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--events", type=float, default=1e9)
    parser.add_argument("--only", default="", help="comma list of commands: sense is always run")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/soak"))
    args = parser.parse_args()
    wanted = set(filter(None, args.only.split(",")))
    folder, pecs_program = args.output, program()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    write_stack(folder / "stack", turning_disk(), FRAME_US, periodic=True)
    loop_us = FRAMES * FRAME_US

    def sense(duration_us: int, output: Path) -> list:
        options = ["--chip", "ideal", "--duration", duration_us, "--quiet"]
        return [pecs_program, "sense", folder / "stack", "-o", output, *options]

    subprocess.run(list(map(str, sense(loop_us, folder / "loop.raw"))), check=True, capture_output=True)
    # Not read into this process: a child's peak memory starts at its parent's.
    per_loop = json.loads((folder / "loop.raw.run.json").read_text())["results"]["events"]
    loops = round(args.events / per_loop)
    events, long = loops * per_loop, folder / "long.raw"
    rows = [row_of("sense", sense(loops * loop_us, long), events, long)]
    window = ["--window", f"{loop_us}us"]
    others = {
        "info": [pecs_program, "info", long],
        "compare": [pecs_program, "compare", long, long, *window],
        "view": [pecs_program, "view", long, "-o", folder / "view.png", "--from", "0us", "--to", f"{loop_us}us"],
    }
    for name, command in others.items():
        if not wanted or name in wanted:
            rows.append(row_of(name, command, events))
    for file_format in pecs.event_formats():
        name = file_format["name"]
        if not file_format["writes"] or wanted and name not in wanted:
            continue
        output = folder / f"out{file_format['extensions'][0]}"
        command = [pecs_program, "convert", long, output, "--format", name, "--quiet"]
        rows.append(row_of(f"convert to {name}", command, events, output))
        rows.append(row_of(f"info on {name}", [pecs_program, "info", output], events))
        output.unlink(missing_ok=True)
    shutil.rmtree(folder)
    print(json.dumps(rows, indent=1))
    sys.exit(any(row["exit"] for row in rows))


if __name__ == "__main__":
    main()
