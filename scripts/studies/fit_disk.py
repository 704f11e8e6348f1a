#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Chips before a turning disk: hidden ones that `pecs fit --disk` should find, and a profile beside a recording.

    scripts/studies/fit_disk.py [--chips 10] [--first-seed 100] [-o fit_disk.json]
    scripts/studies/fit_disk.py --recording R_360_L.hdf5 [--chip imx636] [--contrast 12] [--step 150]
        [--simulation OUT.raw]

Without --recording, chips, light and disks are drawn (RANGES; 4 to 12 sectors, either direction), recorded by the
sensor with all noise, and fitted from the stock profile. Printed are, for each value, how often its 95 % interval has
the truth, and the median of the relative error. Two minutes a chip on two cores.

With --recording only the light of the disk's regions is estimated, each from its number of events. Model and recording
are compared as by `pecs compare --disk` (docs/reference/metrics.md), background beside the disk included.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import pecs
from fit_hidden import one, summary
from pecs.fit import Disk as Recording
from pecs_lab import computed_disk
from pecs_lab.disk import Disk
from pecs_lab.report import table

SIZE, RADIUS_PX, DURATION_US = {"width": 160, "height": 128}, 50.0, 4e5
STEP_US = 100.0
# Low and high, drawn evenly in the logarithm.
PERIOD_US, CONTRAST = (4e4, 1.2e5), (8.0, 20.0)
SLOWNESS = 1.0, 1.8  # the corner in white, times the period / ON threshold: about 1.5 in R_360_L
LIGHT_RATIO = 1.5  # over the disk


def record(folder: Path, values: dict, light_a: float, seed: int, suffix: str = "raw") -> list[Recording]:
    rng = np.random.default_rng([seed, 1])

    def between(pair: tuple[float, float]) -> float:
        return float(np.exp(rng.uniform(*np.log(pair))))

    sectors, period_us, contrast = 2 * int(rng.integers(2, 7)), between(PERIOD_US), between(CONTRAST)
    speed = 720e6 / sectors / period_us * float(rng.choice((-1, 1)))
    centre = SIZE["width"] / 2 + rng.uniform(-2, 2), SIZE["height"] / 2 + rng.uniform(-2, 2)
    disk = Disk(centre, RADIUS_PX + computed_disk.STILL_PX, speed, float(rng.uniform(0, 360)), sectors)
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None]
    shape = np.exp(np.log(LIGHT_RATIO) / 2 * np.cos(around + rng.uniform(0, 2 * np.pi))) * np.ones(4)
    corner_hz = between(SLOWNESS) * values["contrast_threshold_on"] / period_us * 1e6 * shape
    seen = SIZE | {"duration_us": DURATION_US, "step_us": STEP_US, "margin_px": computed_disk.MARGIN_PX}
    events = computed_disk.simulate("imx636", values, disk, corner_hz, contrast, **seen, seed=seed)
    path = folder / f"disk.{suffix}"
    pecs.write(path, events, **SIZE)
    return [Recording(path, contrast)]


def compared(
    recording: str, chip: str, contrast: float, seed: int = 1, step_us: float = 150.0, simulation: Path | None = None
) -> dict:
    disk, events, duration_us = computed_disk.examine(recording)
    size = {"width": events.width, "height": events.height}
    corner_hz = computed_disk.corner_map(recording, chip, contrast)
    timing = {"duration_us": duration_us, "step_us": step_us}
    found = computed_disk.simulate(chip, {}, disk, corner_hz, contrast, **size, **timing, seed=seed)
    if simulation:
        pecs.write(simulation, found, **size)
    options = size | {"split_half": False, "origin": "zero"}
    paper = pecs.compare(events, found, normalisation="paper", disk=disk.detected, **options)
    eq16 = pecs.compare(events, found, normalisation="eq16", **options)
    delays = paper["delays"]

    def by_polarity(key: str) -> dict:
        return {p: delays[p][key] for p in ("on", "off")}

    def background_hz(of: np.ndarray) -> list[float]:
        yy, xx = np.mgrid[: size["height"], : size["width"]].astype(float)
        seconds = (disk.polar(xx, yy)[1] > disk.radius_px + 34).sum() * duration_us * 1e-6
        quiet = disk.polar(of["x"].astype(float), of["y"].astype(float))[1] > disk.radius_px + 34
        return [float((quiet & (of["p"] == p)).sum() / seconds) for p in (1, 0)]

    return {
        "chip": chip,
        "contrast": contrast,
        "corner_hz": dict(zip(("min", "median", "max"), np.percentile(corner_hz, (0, 50, 100)).tolist(), strict=True)),
        "events": {"real": len(events), "simulated": len(found)},
        "events_per_edge": by_polarity("events_per_edge"),
        "delay_overlap": by_polarity("overlap"),
        "earth_mover_deg": by_polarity("earth_mover_deg"),
        "pair_sd_deg": {"real": delays["pair_sd_deg"]["real"], "simulated": delays["pair_sd_deg"]["sim"]},
        "background_hz": {"real": background_hz(events), "simulated": background_hz(found)},
        "paper": {k: paper[k] for k in ("chamfer", "gaussian")},
        "eq16": {k: eq16[k] for k in ("chamfer", "gaussian")},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--chips", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--pixels", type=int, default=1024, help="as of pecs fit")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--recording", help="compare a profile with this recording")
    parser.add_argument("--chip", default="imx636")
    parser.add_argument("--contrast", type=float, default=Recording.contrast, help="white / black of the disk")
    parser.add_argument("--step", type=float, default=150.0, help="us between the simulated frames")
    parser.add_argument("--simulation", type=Path, help="the simulated events")
    args = parser.parse_args()
    if args.recording:
        found = compared(args.recording, args.chip, args.contrast, step_us=args.step, simulation=args.simulation)
        print(json.dumps(found, indent=1))
        return
    chips: list[dict] = []
    for seed in range(args.first_seed, args.first_seed + args.chips):
        chips.append(one(seed, record, args.pixels))
        print(json.dumps(chips[-1], default=float), flush=True)
        args.output.write_text(json.dumps({"chips": chips}, indent=1, default=float) + "\n")
    print(table(["value", "fitted", "truth in the 95 % interval", "median relative error"], summary(chips)))


if __name__ == "__main__":
    main()
