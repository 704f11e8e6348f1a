"""How near to the true edge can a reconstruction of R_360_L come? Edges in pictures of the light itself, of what the
pixels' photoreceptors follow of it, and of methods, on the recording and on simulated events of the same disk.

    .venv-datasets/bin/python scripts/studies/reconstruction_edges.py out/reconstruction --real R_360_L.hdf5
        [--weights NETWORK ...] [--train STEPS [--ideal]] [--picture docs/studies/reconstruction_edges.png]

The disk is drawn from the aligned render: its light where it is white and where it is black, pixel by pixel. So it can
turn before the recording begins, and in more light. Writes edges.json and prints tables. Needs what
reconstruction.py --real needs. --train: a network on nothing but drawn disks in such light. --ideal: another one, on
events of the same disks by pixels without delay and noise.
"""

import argparse
import json
import math
from pathlib import Path

import cv2
import numpy as np
import torch
from pecs._files import write_json
from pecs.learning.clips import ClipConfig
from pecs.learning.footage import Footage
from pecs.learning.networks import NetworkConfig
from pecs.learning.reconstruct import WEIGHTS
from pecs.learning.train import TrainConfig
from pecs_lab import real_disk, sequences
from pecs_lab.disk import RADII, Disk, edges
from pecs_lab.drawn_disk import Drawn, Turning, sensed, shown
from pecs_lab.report import table
from pecs_lab.training import learnt, method_of

STUDY = json.loads(Path(__file__).with_name("reconstruction.json").read_text())
PLAN, DISKS = STUDY["real"], STUDY["disks"]
CHIP = sequences.load(PLAN["sequence"]).sense["chip"]
STEP_US = 250.0  # of the drawn disk: half a degree
HALF_TURNS = 12  # before the recording, until the photoreceptors repeat
DELAY_PERCENTILES = (5, 25, 50, 75, 95)
RECORDING, SIMULATED = "the recording", "simulated"
SENSORS = {
    SIMULATED: {},
    f"{SIMULATED}, 10 times the light": {"gain": 10.0},
    f"{SIMULATED}, 100 times the light": {"gain": 100.0},
    f"{SIMULATED}, no delay": {"fast": True},
}


def positions(pictures: list[np.ndarray], footage: Footage, disk: Disk) -> dict[str, float]:
    """Medians over edges; one picture after each window."""
    after = zip(pictures, footage.times_us[1:], strict=True)
    found = [edges(p, disk, t) for k, (p, t) in enumerate(after) if k >= PLAN["skipped_windows"]]
    ahead, width = np.stack(found, 1)
    seen = np.isfinite(ahead)
    if not seen.any():
        return {"edges_found": 0.0}
    degrees = np.degrees(ahead / (RADII * disk.radius_px))
    values = {"error_px": np.abs(ahead), "ahead_px": ahead, "ahead_deg": degrees, "width_px": width}
    return {"edges_found": float(seen.mean())} | {k: float(np.median(v[seen])) for k, v in values.items()}


def delays(events: np.ndarray, disk: Disk) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of ON and OFF events inside the disk: degrees of turn since the edge passed, and radii in its rim's."""
    angle, radius = disk.polar(events["x"], events["y"])
    radius /= disk.radius_px
    inside, out = (radius > RADII[0]) & (radius < RADII[-1]), []
    for polarity, after in ((1, 0.0), (0, disk.period_deg / 2)):
        chosen = inside & (events["p"] == polarity)
        since = disk.past_deg(angle[chosen], events["t"][chosen], disk.on_edge_deg)
        out.append((np.mod(since - after, disk.period_deg), radius[chosen]))
    return out


def without_delay(events: np.ndarray, model: np.ndarray, disk: Disk) -> float:
    """Error of the edges' positions, px, if the median delay of the model's events is taken off: the median over ON and
    OFF and eight rings."""
    rings, errors = np.linspace(RADII[0], RADII[-1], 9), []
    for (ours, our_radius), (theirs, their_radius) in zip(delays(events, disk), delays(model, disk), strict=True):
        for low, high in zip(rings[:-1], rings[1:], strict=True):
            medians = [np.median(d[(r >= low) & (r < high)]) for d, r in ((ours, our_radius), (theirs, their_radius))]
            errors.append(math.radians(abs(medians[0] - medians[1])) * disk.radius_px * (low + high) / 2)
    return float(np.median(errors))


def trained(run: Path, steps: int, fast: bool) -> Path:
    if not (run / "network.onnx").exists():
        sources = [Turning(DISKS, CHIP, seed, fast) for seed in range(DISKS["count"])]
        config = TrainConfig(NetworkConfig(channels=8), ClipConfig(20, 64), steps, 2, decay_steps=steps // 3)
        learnt(run, sources, config)
    return run / "network.onnx"


class Measured:
    """rows: positions of edges, by name; events, by sensor; shots: the last pictures, on the recording."""

    def __init__(self, footage: Footage, disk: Disk, light: np.ndarray):
        """light: of the footage, A [n, H, W]."""
        self.footage, self.disk = footage, disk
        what = Drawn(disk, *np.percentile(light, (90, 10), axis=0))
        timing = {"warm_up_us": HALF_TURNS * 180e6 / abs(disk.speed_deg_s), "step_us": STEP_US}
        self.rows: dict[str, dict[str, float]] = {}
        self.shots: dict[str, np.ndarray] = {}
        self.events = {RECORDING: footage.events}
        self.add("the light", list(footage.pictures[1:] / 255))
        for name, how in SENSORS.items():
            self.events[name], followed = sensed(what, footage.times_us, CHIP, **timing, **how)
            self.add(f"photoreceptors, {name}", list(shown(followed)[1:] / 255))

    def add(self, name: str, pictures: list[np.ndarray]) -> None:
        self.rows[name] = positions(pictures, self.footage, self.disk)
        self.shots[name] = pictures[-1]

    def add_method(self, name: str, weights: Path | None) -> None:
        for sensor, events in self.events.items():
            windows = Footage(sensor, events, self.footage.times_us, self.footage.pictures).windows
            method = method_of(weights, self.footage.size)
            self.add(f"{name} on {sensor}", [method(window) for window in windows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder of the study")
    parser.add_argument("--real", type=Path, required=True, help="the recording R_360_L")
    parser.add_argument("--weights", type=Path, nargs="*", default=[WEIGHTS], help="networks (default: what ships)")
    parser.add_argument("--train", type=int, metavar="STEPS", help="a network on drawn disks beside them")
    parser.add_argument("--ideal", action="store_true", help="and one on events without delay and noise")
    parser.add_argument("--picture", type=Path, help="PNG: methods on the recording, what photoreceptors follow, light")
    args = parser.parse_args()
    torch.set_num_threads(1)
    methods: dict[str, Path | None] = {"filter": None} | {path.stem: path for path in args.weights}
    if args.train and args.ideal:
        run = args.root / "runs" / f"disks_ideal_{args.train}"
        methods["trained on disks without delay"] = trained(run, args.train, True)
    if args.train:
        methods["trained on disks"] = trained(args.root / "runs" / f"disks_{args.train}", args.train, False)

    footage, disk = real_disk.load(args.real, args.root / "real", PLAN)
    found = Measured(footage, disk, real_disk.photocurrent(args.root / "real", PLAN))
    for name, weights in methods.items():
        found.add_method(name, weights)
    if args.picture:
        names = [*(f"{name} on {RECORDING}" for name in methods), f"photoreceptors, {SIMULATED}", "the light"]
        line = np.hstack([np.pad(found.shots[name], 2, constant_values=1) for name in names])
        cv2.imwrite(str(args.picture), np.repeat(np.repeat(np.round(255 * line), 2, 0), 2, 1).astype(np.uint8))
    late = {
        name: [np.percentile(d, DELAY_PERCENTILES).tolist() for d, _ in delays(events, disk)]
        for name, events in found.events.items()
    }
    corrected = without_delay(footage.events, found.events[SIMULATED], disk)
    out = {"plan": STUDY, "positions": found.rows, "delays_deg": late, "delay_taken_off_px": corrected}
    write_json(args.root / "edges.json", out)
    keys = list(found.rows["the light"])
    rows = [[name, *(f"{value:.2f}" for value in row.values())] for name, row in found.rows.items()]
    print(table(["pictures", *keys], rows))
    for name, (on, off) in late.items():
        count = len(found.events[name])
        print(f"{name}: {count} events; delays ON {np.round(on, 1)}, OFF {np.round(off, 1)} degrees")
    print(f"the recording's events, delays of {SIMULATED} taken off: {corrected:.2f} px")


if __name__ == "__main__":
    main()
