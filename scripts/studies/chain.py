#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""What each part of the chain is worth on R_360_L: the rendered sequence with one part left out at a time, scored
against the recording as in table1.py.

    scripts/studies/chain.py -o out/chain [--coarser 4] [--real R_360_L.hdf5]

Renders the sequence five times (whole, without a lens, without diffraction, one band, three bands at single
wavelengths), with uniform steps and 4 samples, and simulates the first with five sensors. Writes chain.json and prints
the table. With --coarser 4, 20 minutes of two cores and 4 GB; each halving takes eight times as long.
"""

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

import pecs
from pecs_lab import sequences
from pecs_lab.report import table
from pecs_lab.sensor_grid import onto_sensor, scores

ROOT = Path(__file__).resolve().parents[2]
NAME = "R_360_L"
NO_DIFFRACTION = (
    "import sys; from pecs.lens import Camera; Camera.diffract = lambda *_, **__: None; "
    "from pecs_blender.cli import main; sys.exit(main(sys.argv[1:]))"
)
PECS = ["-m", "pecs_blender"]
RENDERED = {  # program, options of the render, f-number of a pinhole: the lens's
    "nothing": (PECS, [], None),
    "lens (pinhole)": (PECS, ["--lens", "none"], 18.86),
    "diffraction": (["-c", NO_DIFFRACTION], [], None),
    "bands (one)": (PECS, ["--bands", "1"], None),
    "means over bands (three wavelengths)": (PECS, ["--placement", "gauss"], None),
}
SENSED = {
    "amplifier": {"overrides": {"amplifier_cutoff_hz": 0}},
    "photoreceptor, with its noise": {"overrides": {"corner_hz_per_a": 0, "amplifier_cutoff_hz": 0, "noise_std": 0}},
    "threshold mismatch": {"overrides": {"threshold_mismatch": 0}},
    "noise": {"overrides": {"noise_std": 0, "background_on_hz": 0, "background_off_hz": 0}},
    "readout (ideal)": {"readout": "ideal"},
}


def name_of(label: str) -> str:
    return re.sub(r"\W+", "_", label)


def rendered(label: str, output: Path, coarser: int) -> Path:
    """The folder of a sequence's stack."""
    program, options, fnumber = RENDERED[label]
    folder = output / name_of(label)
    sequence = sequences.load(NAME)
    words = sequences.render_arguments(sequence, coarser, None)
    command = [sys.executable, *program, "render", sequence.scene, *words, "--bands", 3, "--samples", 4, *options]
    print(f"chain.py: {label}", file=sys.stderr, flush=True)
    subprocess.run([*map(str, command), "-o", folder / "stack", "--quiet"], check=True)  # nothing, if it is complete
    return onto_sensor(folder, fnumber)


def simulated(folder: Path, label: str, options: dict):
    sequence, output = sequences.load(NAME), folder / f"{name_of(label)}.raw"
    pecs.sense(folder / "stack", output, **sequence.sense, **options)
    events = pecs.read(output)
    events["t"] += sequence.sense["start_us"]
    return events


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/chain"))
    parser.add_argument("--coarser", type=int, default=4, help="of the sensor's grid (default: 4)")
    parser.add_argument("--real", type=Path, default=ROOT.parent / "shared/data/real/R_360_L.hdf5")
    args = parser.parse_args()
    if not args.real.is_file():
        sys.exit(f"chain.py: {args.real}: got no recording, wanted R_360_L (docs/studies/validation.md)")
    sequence, real, rows = sequences.load(NAME), pecs.read(args.real), []

    def add(label: str, folder: Path, options: dict) -> None:
        found = simulated(folder, label, options)
        rows.append({"left_out": label, "events": len(found)} | scores(sequence, real, found))

    for label in RENDERED:
        add(label, rendered(label, args.output, args.coarser), {})
    for label, options in SENSED.items():
        add(label, rendered("nothing", args.output, args.coarser), options)
    (args.output / "chain.json").write_text(json.dumps({"coarser": args.coarser, "rows": rows}, indent=1))
    keys = ("chamfer_paper", "chamfer_shared", "gaussian_shared", "delay_on_deg", "delay_off_deg")
    titles = ["left out", "events", "Chamfer: paper", "shared", "Gaussian: shared", "delays ON, °", "OFF, °"]
    print(table(titles, [[r["left_out"], f"{r['events']:,}", *(f"{r[k]:.3g}" for k in keys)] for r in rows]))


if __name__ == "__main__":
    main()
