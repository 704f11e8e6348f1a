#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Renders the lab's sequences (R_360_H, R_360_L, R_60_H, T_1_H, T_1_L, T_0.6_H) and simulates their events:
OUT/NAME/stack and OUT/NAME/events.raw. Stopped, it continues where it was when run again.

    scripts/tools/sequences.py R_360_L -o out/sequences -- --time adaptive     at full size: an hour or two of one core
    scripts/tools/sequences.py R_360_L -o out/sequences            at full size with uniform steps: days on two cores
    scripts/tools/sequences.py all -o out/sequences --coarser 4    a grid four times coarser: minutes each
    scripts/tools/sequences.py T_1_L --coarser 4 --frames 50 -- --samples 2        the first 50 instants alone

A sequence is scenes/SCENE/sequences/NAME.json: parameters of the scene, and how it is rendered and sensed. At every
--coarser an edge moves less than a pixel per frame: the frame rate falls with the grid. What follows -- goes to
`python -m pecs_blender render`.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

from pecs import program
from pecs._arguments import latest
from pecs_lab import sequences

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", help="sequences, or all")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/sequences"))
    parser.add_argument("--coarser", type=int, choices=(1, 2, 4, 8), default=1, help="pixels per pixel, each way")
    parser.add_argument("--frames", type=int, help="only so many instants")
    words = sys.argv[1:]
    end = words.index("--") if "--" in words else len(words)
    args, more = parser.parse_args(words[:end]), words[end + 1 :]

    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'python'}{os.pathsep}{ROOT / 'blender_addon'}"}
    for sequence in map(sequences.load, sequences.names() if args.names == ["all"] else args.names):
        folder = args.output / sequence.name
        folder.mkdir(parents=True, exist_ok=True)
        print(f"{sequence.name}: {folder}", flush=True)
        render = [sys.executable, "-m", "pecs_blender", "render", sequence.scene, "-o", folder / "stack"]
        options = sequences.render_arguments(sequence, args.coarser, args.frames)
        if "adaptive" in more:  # it finds what stands still
            options = [word for word in options if not word.startswith("--moving-px")]
        render = latest([*render, *options, *more])
        sense = [program(), "sense", folder / "stack", "-o", folder / "events.raw"]
        sense += sequences.sense_arguments(sequence, args.frames)
        for command in (render, sense):
            code = subprocess.run(list(map(str, command)), env=environment).returncode
            if code:
                sys.exit(code)


if __name__ == "__main__":
    main()
