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

import numpy as np
import pecs
from pecs_lab import sequences
from pecs_lab.disk import Disk
from pecs_lab.report import table

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 1280, 720
DISK_CENTRE_PX, DISK_RADIUS_PX = (956.8, 360.9), 303.0  # as found in R_360_L, and where the scene puts it


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


def onto_sensor(folder: Path) -> Path:
    """A folder whose stack has the sensor's own pixels: light between a coarser stack's pixels is linear, and one band
    stands for all, with the same photocurrent."""
    import cv2

    chip = pecs.Chip("imx636")
    info = json.loads((folder / "stack/stack.json").read_text())
    band = info["bands"][len(info["bands"]) // 2]
    (ampere,) = chip.amperes_per_unit([band])
    fine = folder / "onto_sensor"
    fine_info = info | {"width": WIDTH, "height": HEIGHT, "bands": [band], "lens": None}
    fine_info["pixel_pitch_m"] = info["pixel_pitch_m"] * info["width"] / WIDTH
    with pecs.StackReader(folder / "stack") as reader, pecs.StackWriter(fine / "stack", fine_info) as writer:
        for i in range(len(info["times_ns"])):
            if not writer.has_frame(i):
                light = chip.photocurrent(reader, i) / np.float32(ampere)
                grown = cv2.resize(light, (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
                writer.write_frame(i, np.ascontiguousarray(grown[None]))
    return fine


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


def disk_of(parameters: dict) -> dict | None:
    """The disk as `pecs align detect --json` prints it, by the sequence's parameters."""
    if "rpm" not in parameters:
        return None
    return Disk(DISK_CENTRE_PX, DISK_RADIUS_PX, 6 * parameters["rpm"], parameters["phase_deg"]).detected


def scores(sequence, reference, found) -> dict:
    row, sizes = {}, {"width": WIDTH, "height": HEIGHT}
    paper = pecs.compare(reference, found, normalisation="paper", split_half=False, **sizes)
    shared = pecs.compare(reference, found, disk=disk_of(sequence.parameters), **sizes)
    for kind, d in (("paper", paper), ("shared", shared)):
        for metric in ("chamfer", "gaussian"):
            row[f"{metric}_{kind}"], row[f"{metric}_{kind}_interval"] = d[metric], d[f"{metric}_interval"]
    row["floor"] = shared["split_half"]
    if shared["delays"]:
        row |= {f"delay_{p}_deg": shared["delays"][p]["earth_mover_deg"] for p in ("off", "on")}
    return row


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
