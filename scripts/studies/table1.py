#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Table 1 of the paper: five pixel models on the same rendered frames of each sequence, against the recording where
there is one, else against `pecs`. Stacks come from scripts/tools/sequences.py.

    scripts/studies/table1.py -o out/sequences [--real R_360_L=FILE ...]

Writes table1.json and table1.md into the folder. They list published numbers, and ours in the paper's arithmetic
and in shared normalisation (docs/reference/metrics.md), with 95 % intervals. On the disk, delays behind the edge too:
the earth mover's distance of `pecs compare --disk`, in degrees. A stack coarser than the sensor is compared with the
recording's pixels at its pixels' centres, in the sensor's coordinates. Default recording:
../shared/data/real/R_360_L.hdf5 if there.
"""

import argparse
import json
import sys
from pathlib import Path

import pecs
from pecs_lab import sequences
from pecs_lab.report import table
from pecs_lab.sensor_grid import WIDTH, onto_sensor, scores

ROOT = Path(__file__).resolve().parents[2]


def sensed(sequence, folder: Path, info: dict, model: str):
    """Events on the stack's grid; time as in the recording, where there is one."""
    parameters = {}
    if model == "icns":  # its photoreceptor follows the light
        parameters["white_lux"] = sequence.parameters["illuminance_lux"]
    output, periodic = folder / f"{model}.raw", info["period_ns"] is not None
    window = sequence.sense if periodic else {"chip": sequence.sense["chip"]}  # a part of a period is not looped
    pecs.sense(folder / "stack", output, model=model, parameters=parameters, **window)
    events = pecs.read(output)
    events["t"] += sequence.sense.get("start_us", 0) if periodic else 0  # a window's events count from its start
    return events


def on_the_sensor(events, factor: int):
    """Events of a grid `factor` times coarser, each at the pixel that decimating a recording keeps."""
    events = events.copy()
    for axis in "xy":
        events[axis] = events[axis] * factor + factor // 2
    return events


def decimated(events, factor: int):
    """A recording's pixels at the coarse grid's, in the sensor's coordinates."""
    kept = (events["x"] % factor == factor // 2) & (events["y"] % factor == factor // 2)
    return events[kept]


def rows_of(name: str, folder: Path, real: Path | None) -> list[dict]:
    sequence = sequences.load(name)
    info = json.loads((folder / "stack/stack.json").read_text())
    factor = WIDTH // info["width"]
    streams = {m: on_the_sensor(sensed(sequence, folder, info, m), factor) for m in sequence.published["chamfer"]}
    reference = decimated(pecs.read(real), factor) if real else streams["pecs"]
    rows = []
    for model, events in streams.items():
        row = {"sequence": name, "against": "recording" if real else "pecs", "model": model, "coarser": factor}
        row |= {"events": len(events), "events_reference": len(reference)}
        row |= {f"{metric}_published": sequence.published[metric][model] for metric in ("chamfer", "gaussian")}
        if real or model != "pecs":
            print(f"{name}: {model}", file=sys.stderr, flush=True)
            row |= scores(sequence, reference, events)
        rows.append(row)
    return rows


def cell(row: dict, key: str) -> str:
    value, interval = row.get(key), row.get(f"{key}_interval")
    if value is None:
        return "–"
    return f"{value:.3g}" + (f" ({interval[0]:.3g} … {interval[1]:.3g})" if interval else "")


COLUMNS = (
    ("sequence", "sequence"),
    ("against", "against"),
    ("model", "model"),
    ("events", "events"),
    ("chamfer_published", "Chamfer: published"),
    ("chamfer_paper", "paper's arithmetic"),
    ("chamfer_shared", "shared"),
    ("gaussian_published", "Gaussian: published"),
    ("gaussian_paper", "paper's arithmetic"),
    ("gaussian_shared", "shared"),
    ("delay_on_deg", "delays ON, °"),
    ("delay_off_deg", "OFF, °"),
)


def cells(row: dict) -> list[str]:
    return [str(row[key]) if isinstance(row.get(key), (str, int)) else cell(row, key) for key, _ in COLUMNS]


def write(rows: list[dict], folder: Path) -> None:
    (folder / "table1.json").write_text(json.dumps(rows, indent=1))
    shown = table([title for _, title in COLUMNS], map(cells, rows))
    (folder / "table1.md").write_text(shown + "\n")
    print(shown)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/sequences"), help="of scripts/tools/sequences.py"
    )
    parser.add_argument("--real", action="append", default=[], metavar="NAME=FILE", help="a sequence's recording")
    parser.add_argument(
        "--onto-sensor",
        action="store_true",
        help="interpolate a coarser stack's light to the sensor's own pixels, so that all events of a recording count",
    )
    args = parser.parse_args()
    real = dict(text.split("=", 1) for text in args.real)
    shared = ROOT.parent / "shared/data/real/R_360_L.hdf5"
    if shared.is_file():
        real.setdefault("R_360_L", shared)
    done = [name for name in sequences.names() if (args.output / name / "stack/stack.json").is_file()]
    if not done:
        sys.exit(f"table1.py: {args.output}: got no stacks, wanted those of scripts/tools/sequences.py")
    rows = []
    for name in done:
        folder = args.output / name
        rows += rows_of(name, onto_sensor(folder) if args.onto_sensor else folder, real.get(name))
    write(rows, args.output)


if __name__ == "__main__":
    main()
