"""First-event latency of a chip before a lamp that is switched on and off, and NIST's measurement. JSON.

    python scripts/bench/latency.py [--chip imx636] [--measured latency_cam1.json --camera CAM1]

pecs_lab/over_light.py has the measurement. Without --measured: medians of the first camera at factory biases. With it:
also least and largest delays, and medians at other biases.
"""

import json
from pathlib import Path

import numpy as np
from pecs_lab.measure import command
from pecs_lab.over_light import MEDIANS_US, delays_us, over_regions

BIASES = ((-64, -26), (-42, -17), (-21, -9), (0, 0), (35, 47), (70, 95))  # of the tables: diff_on, diff_off
FACTORY = BIASES.index((0, 0))


def tables(path: Path, camera: str, name: str, setting: int = FACTORY) -> dict[str, list[float]]:
    every = json.loads(path.read_text())["tables"]
    rows = {s: every[f"{camera}/nolens/{s}/{name.upper()}"] for s in ("median", "min", "max")}
    cell = {s: [[v for v in row[setting] if v is not None] for row in rows[s]] for s in rows}
    return {s: [float(np.median(v)) if v else float("nan") for v in cell[s]] for s in rows}


def main(*, chip: str = "imx636", measured: Path | None = None, camera: str = "CAM1") -> dict:
    report = {}

    def beside(name: str, delays: np.ndarray, setting: int = FACTORY) -> tuple[dict, dict, dict]:
        ours = over_regions(delays)
        theirs = tables(measured, camera, name, setting) if measured else {"median": MEDIANS_US[name]}
        return ours, theirs, {s: [round(a / b, 2) for a, b in zip(ours[s], v, strict=True)] for s, v in theirs.items()}

    for name, delays in delays_us(chip).items():
        report[name] = dict(zip(("simulated", "measured", "ratio"), beside(name, delays), strict=True))
    for setting, (on, off) in enumerate(BIASES if measured else ()):
        for name, delays in delays_us(chip, biases={"diff_on": on, "diff_off": off}).items():
            ratio = beside(name, delays, setting)[2]["median"]
            report[name].setdefault("ratio of medians at diff_on, diff_off", {})[f"{on}, {off}"] = ratio
    return report


if __name__ == "__main__":
    command(main)
