"""Could a keyframe do with one pass of its bands? All bands would be rendered at every second keyframe only; in between
one pass of three, and the ratio of the whole light to that pass carried along the motion. A ColorChecker on the
rotating disk, 12 bands in 4 passes; the error of ln(photocurrent) on moving pixels against 128 samples of another seed.

    .venv/bin/python scripts/studies/band_passes.py -o out/band_passes

Prints a table; one CPU minute. Docs: studies/keyframes.md.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pecs
from pecs_lab.report import table

ROOT = Path(__file__).resolve().parents[2]
PASSES, BANDS_PER_PASS = 4, 3


def render(folder: Path, *options) -> dict:
    """What the stack says of itself."""
    command = [sys.executable, "-m", "pecs_blender", "render", ROOT / "scenes/colorchecker_disk", "-o", folder]
    command += ["--quiet", "--lens", "none", "--focal", "25mm", "--width", 96, "--bands", PASSES * BANDS_PER_PASS]
    command += ["--fps", "2kHz", "--frames", 120, "--set", "lamp_spectrum=led_b3", "--time", "adaptive", *options]
    subprocess.run(list(map(str, command)), check=True)
    with pecs.StackReader(folder) as stack:
        return stack.info


def chip_of_pass(folder: Path, lambda_nm: np.ndarray, number: int) -> Path:
    """The chip, blind to all bands but those of one pass."""
    profile = json.loads((ROOT / "sensor/chips/imx636.json").read_text())
    response = profile["relative_qe"]
    nm = np.arange(300.0, 1101.0)
    values = np.interp(nm, response["lambda_nm"], response["value"], left=0, right=0)
    seen = lambda_nm[number * BANDS_PER_PASS : (number + 1) * BANDS_PER_PASS]
    values[(nm < seen[0] - 5) | (nm > seen[-1] + 5)] = 0
    response["lambda_nm"], response["value"] = nm.tolist(), values.tolist()
    path = folder / f"pass{number}.json"
    path.write_text(json.dumps(profile))
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    near = render(folder / "every", "--samples", 4, "--step", 12)
    far_ns = render(folder / "second", "--samples", 4, "--step", 24)["times_ns"]
    render(folder / "reference", "--samples", 128, "--step", 12, "--seed", 77)
    lambda_nm = np.array([band["lambda_nm"] for band in near["bands"]])
    chips = ["imx636", *(chip_of_pass(folder, lambda_nm, i) for i in range(PASSES))]
    between_us = np.array([t for t in near["times_ns"][1:-1] if t not in far_ns]) / 1e3

    def light(name: str) -> np.ndarray:  # [times, whole and passes, height, width]
        with pecs.Light(folder / name, chips, fnumber=2.0) as source:
            return source.at(between_us).astype(np.float64)

    truth, every, far = light("reference"), light("every"), light("second")
    moving = np.ptp(np.log(truth[:, 0]), axis=0) > 0.02
    rows = {"all bands at every keyframe": every[:, 0], "all bands at every second, carried": far[:, 0]}
    for i in range(1, PASSES + 1):
        rows[f"and pass {i} at every one"] = every[:, i] * far[:, 0] / far[:, i]
        rows[f"and pass {i} without noise"] = truth[:, i] * far[:, 0] / far[:, i]
    print(f"{len(between_us)} keyframes between; bands {np.round(lambda_nm)} nm\n")
    for name, estimate in rows.items():
        error = 100 * np.abs(np.log(estimate / truth[:, 0]))[:, moving]
        found = (np.sqrt((error**2).mean()), np.median(error), np.percentile(error, 95))
        rows[name] = [name, *(f"{value:.1f}" for value in found)]
    print(table(("", "RMS %", "median %", "p95 %"), rows.values()))


if __name__ == "__main__":
    main()
