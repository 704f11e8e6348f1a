"""First-event latency of a chip before a lamp that is switched on and off, beside NIST's measurement. JSON.

    python scripts/bench/latency.py [--chip imx636] [--measured latency_cam1.json --camera CAM1]

Chassagnol, Blattner, Litorja, Bajcsy, IEEE TIM 74 (2025), doi 10.1109/tim.2025.3623767 (NIST, public domain): a red LED
(680.61 nm) in a square wave against dark, W/m2 at the chip, no lens; per region of 10x10 pixels the median, least and
largest delay of a pixel's first event of one polarity, mean of some triggers. Here 1 Hz, as about five triggers in 5 s.
Behind the edge before, V has stopped anywhere between two thresholds. So has the simulated V: a single step from rest
comes a third earlier in the dimmest light. Without --measured: medians of the first camera at factory biases. With it:
also medians at other biases.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import pecs

IRRADIANCE_W_M2 = (0.006, 0.046, 0.166, 0.277, 0.398)
LAMBDA_NM = 680.61
MEDIANS_US = {"on": (537.1, 93.3, 41.5, 29.8, 26.9), "off": (623.0, 113.8, 48.3, 36.6, 31.7)}  # CAM1, factory biases
BIASES = ((-64, -26), (-42, -17), (-21, -9), (0, 0), (35, 47), (70, 95))  # of the tables: diff_on, diff_off
FACTORY = BIASES.index((0, 0))
REGION, REGIONS, CYCLES, HALF_US, FRAMES = 100, 9, 4, 5e5, 70


def simulated(chip: str, seed: int = 1, biases: dict[str, int] | None = None) -> dict[str, np.ndarray]:
    """[irradiance, pixel, cycle]: delay of the first event, us."""
    profile = pecs.Chip(chip)
    ampere = profile.amperes_per_unit([{"lambda_nm": LAMBDA_NM, "weight_nm": 1.0}])[0]
    pixels = REGION * REGIONS
    behind = np.concatenate([[0, 1], 1 + np.geomspace(2, HALF_US - 10, FRAMES)])
    edges = 1000 + HALF_US * np.arange(2 * CYCLES + 2)
    t_us = np.concatenate([[0.0], *(edge + behind for edge in edges)])
    lit = np.concatenate([[0], *(np.r_[k % 2, np.full(FRAMES + 1, 1 - k % 2)] for k in range(len(edges)))])
    light_fa = 1e15 * ampere * np.outer(lit, IRRADIANCE_W_M2)
    frames = np.repeat(light_fa[:, :, None], pixels, axis=2).astype(np.float32)
    events = pecs.simulate(frames, t_us, chip, photocurrent_a=1e-15, seed=seed, readout="ideal", biases=biases or {})
    pixel = events["y"].astype(int) * pixels + events["x"]
    found = {}
    for polarity, name in ((1, "on"), (0, "off")):
        delays = np.full((len(IRRADIANCE_W_M2) * pixels, CYCLES), np.nan)
        for cycle in range(CYCLES):
            edge = edges[2 * cycle + 2 - (polarity == 0)]
            mine = (events["p"] == polarity) & (events["t"] >= edge) & (events["t"] < edge + HALF_US)
            which, first = np.unique(pixel[mine], return_index=True)  # events are in order of time
            delays[which, cycle] = events["t"][mine][first] - edge - 0.5
        found[name] = delays.reshape(len(IRRADIANCE_W_M2), pixels, CYCLES)
    return found


def over_regions(delays: np.ndarray) -> dict[str, list[float]]:
    regions = delays.reshape(len(delays), REGIONS, REGION, CYCLES)
    of = {"median": np.nanmedian, "min": np.nanmin, "max": np.nanmax}
    return {name: np.round(f(regions, axis=2).mean((1, 2)), 1).tolist() for name, f in of.items()}


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
