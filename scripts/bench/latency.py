"""First-event latency of a chip before a lamp that is switched on and off, beside NIST's measurement. JSON.

    python scripts/bench/latency.py [--chip imx636] [--measured latency_cam1.json --camera CAM1]

pecs_lab/over_light.py has the measurement. Without --measured: medians of the first camera at factory biases. With it:
also least and largest delays, and medians at other biases.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import pecs
from pecs_lab.over_light import MEDIANS_US, first_delays_us, nist_fa, over_regions, square_wave

BIASES = ((-64, -26), (-42, -17), (-21, -9), (0, 0), (35, 47), (70, 95))  # of the tables: diff_on, diff_off
FACTORY = BIASES.index((0, 0))


def simulated(chip: str, seed: int = 1, biases: dict[str, int] | None = None) -> dict[str, np.ndarray]:
    """[irradiance, pixel, cycle]: delay of the first event, us."""
    frames, t_us = square_wave(nist_fa(chip))
    events = pecs.simulate(frames, t_us, chip, photocurrent_a=1e-15, seed=seed, readout="ideal", biases=biases or {})
    return first_delays_us(events)


def measured(path: Path, camera: str, name: str, setting: int = FACTORY) -> dict[str, list[float]]:
    tables = json.loads(path.read_text())["tables"]
    rows = {s: tables[f"{camera}/nolens/{s}/{name.upper()}"] for s in ("median", "min", "max")}
    cell = {s: [[v for v in row[setting] if v is not None] for row in rows[s]] for s in rows}
    return {s: [float(np.median(v)) if v else float("nan") for v in cell[s]] for s in rows}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--chip", default="imx636")
    parser.add_argument("--measured", type=Path, help="decoded tables of NIST's figures")
    parser.add_argument("--camera", default="CAM1", help="of --measured")
    args = parser.parse_args()
    report = {}
    for name, delays in simulated(args.chip).items():
        ours = over_regions(delays)
        theirs = measured(args.measured, args.camera, name) if args.measured else {"median": MEDIANS_US[name]}
        ratio = {s: [round(a / b, 2) for a, b in zip(ours[s], v, strict=True)] for s, v in theirs.items()}
        report[name] = {"simulated": ours, "measured": theirs, "ratio": ratio}
    for setting, (on, off) in enumerate(BIASES if args.measured else ()):
        for name, delays in simulated(args.chip, biases={"diff_on": on, "diff_off": off}).items():
            ours, theirs = (
                of["median"] for of in (over_regions(delays), measured(args.measured, args.camera, name, setting))
            )
            ratio = [round(a / b, 2) for a, b in zip(ours, theirs, strict=True)]
            report[name].setdefault("ratio of medians at diff_on, diff_off", {})[f"{on}, {off}"] = ratio
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
