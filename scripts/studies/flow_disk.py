"""Is the flow of the recorded disk wrong for the recording's sake? The networks of flow.py on a drawn disk of the same
geometry, speed and contrast, seen by the pixels of imx636 in the recording's light, and in more.

    .venv-datasets/bin/python scripts/studies/flow_disk.py out/flow [--only SIMULATOR]

Needs the networks of flow.py. Prints a table: means over seeds.
"""

import argparse
from pathlib import Path

import flow
import numpy as np
import pecs
import torch
from pecs_lab import report
from pecs_lab.comparison import mean_scores
from pecs_lab.drawn_disk import Drawn, sensed
from pecs_lab.flow_windows import Window, coarse_disk, rotation

REAL = flow.PLAN["real"]
CHIP, CORNER_HZ, CONTRAST, WALL = "imx636", 6.0, 12.0, 0.3  # corner on white; wall: of white
FINE = 4  # the sensor's pixels are FINE x FINE of the recording's, and those of a window four times that
SIDE, LEFT, TOP = 156, 161, 12  # of the picture, in such pixels
GAINS = (1.0, 10.0, 100.0)  # times the light
UP_TO_US, WARM_UP_US, STEP_US = 60_000, 400_000, 500


class OnWall:
    """A drawn disk before a plain wall."""

    def __init__(self, what: Drawn):
        self.white, self._what = what.white, what
        y, x = np.mgrid[: what.white.shape[0], : what.white.shape[1]]
        self._inside = what.disk.polar(x, y)[1] <= what.disk.radius_px

    def light(self, t_us: float) -> np.ndarray:
        return np.where(self._inside, self._what.light(t_us), WALL * self.white)


def windows(gain: float) -> list[Window]:
    """As those of the recording."""
    with pecs.Chip(CHIP) as chip:
        white = np.full((SIDE, SIDE), CORNER_HZ / chip.corner_hz_per_a)
    disk = coarse_disk(REAL["sequence"], FINE).moved(-LEFT, -TOP)
    times = np.arange(0.0, UP_TO_US + 1, 4 * STEP_US)
    what = OnWall(Drawn(disk, white, white / CONTRAST))
    events = sensed(what, times, CHIP, gain=gain, warm_up_us=WARM_UP_US, step_us=STEP_US)[0].copy()
    times_coarser = REAL["coarser"] // FINE
    events["x"] //= times_coarser
    events["y"] //= times_coarser
    coarse = coarse_disk(REAL["sequence"], REAL["coarser"]).moved(-LEFT / times_coarser, -TOP / times_coarser)
    true = rotation(coarse, (SIDE // times_coarser, SIDE // times_coarser), REAL["window_us"] * 1e-6)
    out = []
    for start in range(2 * REAL["step_us"], UP_TO_US - REAL["window_us"] + 1, REAL["step_us"]):
        end = start + REAL["window_us"]
        first, last = np.searchsorted(events["t"], [start, end])
        out.append(Window("drawn", events[first:last], float(start), float(end), true))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder of flow.py's results")
    parser.add_argument("--only", help="simulators, a list (default: all)")
    args = parser.parse_args()
    names = args.only.split(",") if args.only else list(flow.simulators())
    torch.set_num_threads(1)
    tests = {gain: windows(gain) for gain in GAINS}
    lines = []
    for name in [*names, "farneback"]:
        row = [f"`{name}`"]
        for some in tests.values():
            methods = [flow.method_of(args.root, name, s) for s in (flow.PLAN["seeds"] if name in names else [0])]
            found = mean_scores([flow.scores(w, method(w)) for method in methods for w in some])
            row += [f"{found['relative']:.2f}", f"{found['gain']:.2f}"]
        lines.append(row)
    heads = [f"{gain:g} x light: {what}" for gain in GAINS for what in ("relative error", "gain")]
    print(report.table(["trained on", *heads], lines))


if __name__ == "__main__":
    main()
