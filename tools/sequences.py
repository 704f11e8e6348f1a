#!/usr/bin/env python3
"""Renders the lab's sequences (R_360_H, R_360_L, R_60_H, T_1_H, T_1_L, T_0.6_H) and simulates their events:
OUT/NAME/stack and OUT/NAME/events.raw. Stopped, it continues where it was when run again.

    tools/sequences.py R_360_L -o out/sequences                at full size: days on two cores
    tools/sequences.py all -o out/sequences --coarser 4        a grid four times coarser: minutes each
    tools/sequences.py T_1_L --coarser 4 --frames 50 -- --samples 2        the first 50 instants alone

A sequence is scenes/SCENE/sequences/NAME.json: parameters of the scene, and how it is rendered and sensed. At every
--coarser an edge moves less than a pixel per frame: the frame rate falls with the grid. What follows -- goes to
`python -m pecs_blender render`.
"""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Sequence:
    name: str
    scene: Path
    parameters: dict
    render: dict
    sense: dict
    published: dict  # Table 1 of the paper


def load(name: str) -> Sequence:
    files = {path.stem: path for path in sorted(ROOT.glob("scenes/*/sequences/*.json"))}
    if name not in files:
        sys.exit(f"sequences.py: got {name}, wanted all or one of {', '.join(files)}")
    text = json.loads(files[name].read_text())
    keys = ("parameters", "render", "sense", "published")
    return Sequence(name, files[name].parents[1], *(text[key] for key in keys))


def names() -> list[str]:
    return sorted(path.stem for path in ROOT.glob("scenes/*/sequences/*.json"))


def render_arguments(sequence: Sequence, coarser: int, frames: int | None) -> list[str]:
    r = dict(sequence.render)
    r["width"], r["height"], r["fps"] = r["width"] // coarser, r["height"] // coarser, r["fps"] / coarser
    if isinstance(r["frames"], int):
        r["frames"] //= coarser
    if "moving_px" in r:
        left, top, right, bottom = r["moving_px"]
        box = left // coarser, top // coarser, -(-right // coarser), -(-bottom // coarser)
        r["moving_px"] = ":".join(map(str, box))
    if frames:
        r["frames"] = frames
    options = [f"--{key.replace('_', '-')}={value}" for key, value in r.items()]
    return options + [f"--set={key}={value}" for key, value in sequence.parameters.items()]


def sense_arguments(sequence: Sequence, frames: int | None) -> list[str]:
    keys = [key for key in sequence.sense if not frames or key == "chip"]  # a part of a period is not looped
    return [f"--{key.replace('_', '-')}={sequence.sense[key]}" for key in keys]


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
    program = ROOT / "build" / "release" / "bin" / "pecs"
    for sequence in map(load, names() if args.names == ["all"] else args.names):
        folder = args.output / sequence.name
        folder.mkdir(parents=True, exist_ok=True)
        print(f"{sequence.name}: {folder}", flush=True)
        render = [sys.executable, "-m", "pecs_blender", "render", sequence.scene, "-o", folder / "stack"]
        render += [*render_arguments(sequence, args.coarser, args.frames), *more]
        sense = [program, "sense", folder / "stack", "-o", folder / "events.raw"]
        sense += sense_arguments(sequence, args.frames)
        for command in (render, sense):
            code = subprocess.run(list(map(str, command)), env=environment).returncode
            if code:
                sys.exit(code)


if __name__ == "__main__":
    main()
