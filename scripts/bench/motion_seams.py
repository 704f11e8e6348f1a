"""Do events know where the keyframes are? Events per event of the reference, over the phase within the interval between
keyframes. What a scene shows changes with time, too; so each scene is rendered with keyframes at ten places, and every
instant of it is met at all phases. Prints JSON; scenes and reference are those of motion.py, taken as they are there.

    .venv/bin/python scripts/bench/motion_seams.py -o out/motion [--samples 4]
"""

import argparse
import json
import os
from pathlib import Path

import motion
import numpy as np
import pecs

SCENES = ("room", "rotating_disk", "board")
PHASES, PLACES, GROUPS = 8, 10, 32


def count(events: np.ndarray, begin_us: float, keyframes_us: np.ndarray) -> np.ndarray:
    """Of groups of pixels, [GROUPS, PHASES]; `begin_us`: the first keyframe in the events' time."""
    t_us = events["t"] - begin_us
    inside = (t_us >= keyframes_us[0]) & (t_us < keyframes_us[-1])
    events, t_us = events[inside], t_us[inside]
    i = np.searchsorted(keyframes_us, t_us, side="right") - 1
    phase = (PHASES * (t_us - keyframes_us[i]) / (keyframes_us[i + 1] - keyframes_us[i])).astype(int)
    group = (events["x"].astype(int) * 7 + events["y"].astype(int) * 13) % GROUPS
    return np.bincount(group * PHASES + phase, minlength=GROUPS * PHASES).reshape(GROUPS, PHASES)


def seams(scene: motion.Scene, output: Path, made: Path, samples: int) -> dict:
    step_us, last = 1e6 / scene.fps, round(scene.seconds * scene.fps) + 1
    options = ("--samples", samples, "--time", "adaptive", "--frames")
    truth = motion.reference_events(scene, output, made)
    found, expected = np.zeros((2, GROUPS, PHASES))
    interval, first = PLACES, 0
    while first < interval:
        folder = output / f"from{first}_{samples}" / scene.name
        motion.render(scene, folder, made, scene.fps, *options, f"{first}:{last}")
        with pecs.StackReader(folder) as stack:
            keyframes_us = np.array(stack.info["times_ns"]) / 1e3
        found += count(motion.events(folder), 0, keyframes_us)
        expected += count(truth, first * step_us, keyframes_us)
        if first == 0:
            interval = round((keyframes_us[1] - keyframes_us[0]) / step_us)
        first += max(1, interval // PLACES)

    def ratio(groups):
        r = found[groups].sum(0) / expected[groups].sum(0)
        return r / r.mean()

    without = np.array([ratio(np.arange(GROUPS) != g) for g in range(GROUPS)])
    deviation = np.sqrt((GROUPS - 1) * without.var(axis=0))  # jackknife
    return {
        "percent": [round(100 * float(r - 1), 2) for r in ratio(slice(None))],
        "by_chance_percent": round(100 * float(deviation.mean()), 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=4)
    args = parser.parse_args()
    made = motion.make_scenes(args.output / "scenes")
    rows = {s.name: seams(s, args.output, made, args.samples) for s in motion.SCENES if s.name in SCENES}
    print(json.dumps({"samples": args.samples, "load": os.getloadavg()[0], "scenes": rows}, indent=1))


if __name__ == "__main__":
    main()
