#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Table 1 of the paper: five pixel models on the same rendered frames of each sequence, against the recording where
there is one, else against `pecs`.

    scripts/tools/sequences.py all -o out/sequences --coarser 4 -- --bands 3 --samples 4
    scripts/studies/table1.py out/sequences [--real NAME=FILE ...] [--sensor-grid]

Writes table1.json and table1.md into the folder: published numbers, and those of PECS in the paper's arithmetic and in
shared normalisation (docs/reference/metrics.md), with 95 % intervals; on the disk, also the earth mover's distance of
the delays. A stack coarser than the sensor is compared with the recording's pixels at its pixels' centres, or with
--sensor-grid its light is interpolated to the sensor's pixels, so that all events count. Default recording:
../shared/data/real/R_360_L.hdf5 if there.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pecs
from pecs_lab import sequences
from pecs_lab.disk import Disk
from pecs_lab.measure import command
from pecs_lab.report import cell, table
from pecs_lab.sequences import Sequence

REAL = sequences.ROOT.parent / "shared/data/real/R_360_L.hdf5"
WIDTH, HEIGHT = 1280, 720  # of the sensor
DISK_CENTRE_PX, DISK_RADIUS_PX = (956.8, 360.9), 303.0  # as found in R_360_L, and where the scene puts it
KINDS = {"published": "published", "paper": "paper's arithmetic", "shared": "shared"}
COLUMNS = {f"{m}_{kind}": f"{m.title()}: {title}" for m in ("chamfer", "gaussian") for kind, title in KINDS.items()}
COLUMNS |= {"delay_on_deg": "delays ON, °", "delay_off_deg": "OFF, °"}


def onto_sensor(folder: Path) -> Path:
    """A folder whose stack has the sensor's own pixels: light between a coarser stack's pixels is linear, and one band
    stands for all, with the same photocurrent."""
    chip, fine = pecs.Chip("imx636"), folder / "onto_sensor"
    info = json.loads((folder / "stack/stack.json").read_text())
    band = info["bands"][len(info["bands"]) // 2]
    (ampere,) = chip.amperes_per_unit([band])
    fine_info = info | {"width": WIDTH, "height": HEIGHT, "bands": [band], "lens": None}
    fine_info["pixel_pitch_m"] = info["pixel_pitch_m"] * info["width"] / WIDTH
    with pecs.StackReader(folder / "stack") as reader, pecs.StackWriter(fine / "stack", fine_info) as writer:
        for i in range(len(info["times_ns"])):
            if not writer.has_frame(i):
                light = chip.photocurrent(reader, i) / np.float32(ampere)
                grown = cv2.resize(light, (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
                writer.write_frame(i, np.ascontiguousarray(grown[None]))
    return fine


def scores(sequence: Sequence, reference: np.ndarray, found: np.ndarray) -> dict:
    p, size, disk = sequence.parameters, {"width": WIDTH, "height": HEIGHT}, None
    if "rpm" in p:
        disk = Disk(DISK_CENTRE_PX, DISK_RADIUS_PX, 6 * p["rpm"], p["phase_deg"])
        disk = disk.detected(float(reference["t"].min()))
    paper = pecs.compare(reference, found, normalisation="paper", split_half=False, **size)
    shared = pecs.compare(reference, found, disk=disk, **size)
    row = {"floor": shared["split_half"]}
    for kind, d in (("paper", paper), ("shared", shared)):
        for metric in ("chamfer", "gaussian"):
            row[f"{metric}_{kind}"], row[f"{metric}_{kind}_interval"] = d[metric], d[f"{metric}_interval"]
    if shared["delays"]:
        row |= {f"delay_{p}_deg": shared["delays"][p]["earth_mover_deg"] for p in ("off", "on")}
    return row


def sensed(sequence: Sequence, folder: Path, model: str) -> np.ndarray:
    """Events on the stack's grid; time as in the recording, where there is one."""
    # The photoreceptor of icns follows the light.
    parameters = {"white_lux": sequence.parameters["illuminance_lux"]} if model == "icns" else None
    output = folder / f"{model}.raw"
    periodic = json.loads((folder / "stack/stack.json").read_text())["period_ns"] is not None
    window = sequence.sense if periodic else {"chip": sequence.sense["chip"]}  # a part of a period is not looped
    pecs.sense(folder / "stack", output, model=model, parameters=parameters, **window)
    events = pecs.read(output)
    events["t"] += window.get("start_us", 0)  # a window's events count from its start
    return events


def on_the_sensor(events: np.ndarray, factor: int) -> np.ndarray:
    """Events of a grid `factor` times coarser, each at the pixel that decimating a recording keeps."""
    events = events.copy()
    for axis in "xy":
        events[axis] = events[axis] * factor + factor // 2
    return events


def decimated(events: np.ndarray, factor: int) -> np.ndarray:
    """A recording's pixels at the coarse grid's, in the sensor's coordinates."""
    return events[(events["x"] % factor == factor // 2) & (events["y"] % factor == factor // 2)]


def rows_of(name: str, folder: Path, real: Path | None) -> list[dict]:
    sequence = sequences.load(name)
    factor = WIDTH // json.loads((folder / "stack/stack.json").read_text())["width"]
    streams = {m: on_the_sensor(sensed(sequence, folder, m), factor) for m in sequence.published["chamfer"]}
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


def shown(row: dict, key: str) -> str:
    low_high = row.get(f"{key}_interval")
    return cell(row.get(key)) + (" ({} … {})".format(*map(cell, low_high)) if low_high else "")


def main(folder: Path, *, real: list[str] = (), sensor_grid: bool = False) -> None:
    recordings = ({"R_360_L": REAL} if REAL.is_file() else {}) | dict(text.split("=", 1) for text in real)
    done = [name for name in sequences.names() if (folder / name / "stack/stack.json").is_file()]
    if not done:
        sys.exit(f"table1.py: {folder}: got no stacks, wanted those of scripts/tools/sequences.py")
    rows = []
    for name in done:
        stack = onto_sensor(folder / name) if sensor_grid else folder / name
        rows += rows_of(name, stack, recordings.get(name))
    (folder / "table1.json").write_text(json.dumps(rows, indent=1))
    head = ["sequence", "against", "model", "events"]
    text = table([*head, *COLUMNS.values()], [[*(r[k] for k in head), *(shown(r, k) for k in COLUMNS)] for r in rows])
    (folder / "table1.md").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    command(main)
