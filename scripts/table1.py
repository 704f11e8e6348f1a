#!/usr/bin/env python3
"""Table 1 of the paper: five pixel models on the same rendered frames of each sequence, against the recording where
there is one, else against `pecs`. Stacks come from scripts/sequences.py.

    scripts/table1.py -o out/sequences [--real R_360_L=FILE ...]

Writes table1.json, .csv, .html and .tex into the folder. Published numbers stand beside ours in the paper's arithmetic
and in shared normalisation (docs/metrics.md), with 95 % intervals. On the disk, delays behind the edge too: earth
mover's distance in degrees between the histograms of both streams. A stack coarser than the sensor is compared with the
recording's pixels at its pixels' centres, in the sensor's coordinates. Default recording:
../shared/data/real/R_360_L.hdf5 if there.
"""

import argparse
import csv
import html
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "python")]

import pecs  # noqa: E402
import sequences  # noqa: E402

MODELS = ("pecs", "esim", "voltmeter", "v2e", "icns")
WIDTH, HEIGHT = 1280, 720
DISK_CENTRE_PX, DISK_RADIUS_PX = (956.8, 360.9), 303.0  # as found in R_360_L, and where the scene puts it
BIN_DEG = 2.0


def sensed(sequence, folder: Path, model: str):
    """Events on the stack's grid; time as in the recording, where there is one."""
    output = folder / f"{model}.raw"
    command = [ROOT / "build/release/bin/pecs", "sense", folder / "stack", "-o", output, "--model", model, "--quiet"]
    partial = json.loads((folder / "stack/stack.json").read_text())["period_ns"] is None
    frames = 1 if partial and sequence.render["frames"] == "period" else None
    arguments = sequences.sense_arguments(sequence, frames)
    subprocess.run(list(map(str, [*command, *arguments])), check=True)
    events = pecs.read(output)
    events["t"] += 0 if frames else sequence.sense.get("start_us", 0)  # a window's events count from its start
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


def delays_deg(events, parameters) -> list[np.ndarray]:
    """OFF and ON events on the disk: by how much the edge that caused them is ahead, modulo half a turn."""
    x, y = events["x"] + 0.5 - DISK_CENTRE_PX[0], DISK_CENTRE_PX[1] - events["y"] - 0.5
    radius = np.hypot(x, y)
    on_disk = (radius > 0.2 * DISK_RADIUS_PX) & (radius < 0.97 * DISK_RADIUS_PX)
    edge = parameters["phase_deg"] + parameters["rpm"] * 6e-6 * events["t"]
    behind = edge - np.degrees(np.arctan2(y, x))
    return [(behind[on_disk & (events["p"] == p)] + (90 if p == 0 else 0)) % 180 for p in (0, 1)]


def histogram_distance_deg(a: np.ndarray, b: np.ndarray) -> float | None:
    """Earth mover's distance on the circle of 180 degrees."""
    if not len(a) or not len(b):
        return None
    bins = np.arange(0, 180 + BIN_DEG, BIN_DEG)
    difference = np.cumsum(np.histogram(a, bins)[0] / len(a) - np.histogram(b, bins)[0] / len(b))
    return float(BIN_DEG * np.abs(difference - np.median(difference)).sum())


def scores(sequence, reference, found) -> dict:
    row = {}
    for kind in ("paper", "shared"):
        d = pecs.distance(reference, found, width=WIDTH, height=HEIGHT, normalisation=kind, split_half=kind == "shared")
        for metric in ("chamfer", "gaussian"):
            row[f"{metric}_{kind}"], row[f"{metric}_{kind}_interval"] = d[metric], d[f"{metric}_interval"]
        if kind == "shared":
            row["floor"] = d["split_half"]
    if "rpm" in sequence.parameters:
        pairs = zip(delays_deg(reference, sequence.parameters), delays_deg(found, sequence.parameters), strict=True)
        row["delay_off_deg"], row["delay_on_deg"] = (histogram_distance_deg(*pair) for pair in pairs)
    return row


def rows_of(name: str, folder: Path, real: Path | None) -> list[dict]:
    sequence = sequences.load(name)
    factor = WIDTH // json.loads((folder / "stack/stack.json").read_text())["width"]
    streams = {m: on_the_sensor(sensed(sequence, folder, m), factor) for m in MODELS}
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
    with open(folder / "table1.csv", "w", newline="") as file:
        flat = [
            {k: "/".join(map(str, v)) if isinstance(v, list) else v for k, v in r.items() if k != "floor"} for r in rows
        ]
        writer = csv.DictWriter(file, list(dict.fromkeys(key for row in flat for key in row)))
        writer.writeheader()
        writer.writerows(flat)
    table = [[title for _, title in COLUMNS], *map(cells, rows)]
    body = "".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in line) + "</tr>\n" for line in table)
    style = "table{border-collapse:collapse;font:13px sans-serif}td{border:1px solid #ccc;padding:3px 8px}"
    (folder / "table1.html").write_text(
        f'<!doctype html><meta charset="utf-8"><title>Table 1</title><style>{style}</style><table>\n{body}</table>\n'
    )
    tex = [" & ".join(c.replace("_", "\\_").replace("°", "$^\\circ$") for c in line) + " \\\\" for line in table]
    columns = "lll" + "r" * (len(COLUMNS) - 3)
    lines = [f"\\begin{{tabular}}{{{columns}}}", "\\hline", tex[0], "\\hline", *tex[1:], "\\hline", "\\end{tabular}"]
    (folder / "table1.tex").write_text("\n".join(lines) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/sequences"), help="of scripts/sequences.py")
    parser.add_argument("--real", action="append", default=[], metavar="NAME=FILE", help="a sequence's recording")
    args = parser.parse_args()
    real = dict(text.split("=", 1) for text in args.real)
    shared = ROOT.parent / "shared/data/real/R_360_L.hdf5"
    if shared.is_file():
        real.setdefault("R_360_L", shared)
    done = [name for name in sequences.names() if (args.output / name / "stack/stack.json").is_file()]
    if not done:
        sys.exit(f"table1.py: {args.output}: got no stacks, wanted those of scripts/sequences.py")
    rows = [row for name in done for row in rows_of(name, args.output / name, real.get(name))]
    write(rows, args.output)
    for row in rows:
        print(" | ".join(cells(row)))


if __name__ == "__main__":
    main()
