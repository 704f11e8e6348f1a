"""Rendered sequences on the grid of the lab's sensor, and their scores against a recording."""

import json
from pathlib import Path

import cv2
import numpy as np
import pecs

from .disk import Disk

WIDTH, HEIGHT = 1280, 720
DISK_CENTRE_PX, DISK_RADIUS_PX = (956.8, 360.9), 303.0  # as found in R_360_L, and where the scene puts it


def onto_sensor(folder: Path, fnumber: float | None = None) -> Path:
    """A folder whose stack has the sensor's own pixels: light between a coarser stack's pixels is linear, and one band
    stands for all, with the same photocurrent. fnumber: for a stack of radiance."""
    chip = pecs.Chip("imx636")
    info = json.loads((folder / "stack/stack.json").read_text())
    band = info["bands"][len(info["bands"]) // 2]
    (ampere,) = chip.amperes_per_unit([band])
    fnumber = {"fnumber": fnumber} if fnumber else {}
    fine = folder / "onto_sensor"
    fine_info = info | {"width": WIDTH, "height": HEIGHT, "bands": [band], "lens": None, "quantity": "irradiance"}
    fine_info["pixel_pitch_m"] = info["pixel_pitch_m"] * info["width"] / WIDTH
    with pecs.StackReader(folder / "stack") as reader, pecs.StackWriter(fine / "stack", fine_info) as writer:
        for i in range(len(info["times_ns"])):
            if not writer.has_frame(i):
                light = chip.photocurrent(reader, i, **fnumber) / np.float32(ampere)
                grown = cv2.resize(light, (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
                writer.write_frame(i, np.ascontiguousarray(grown[None]))
    return fine


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
