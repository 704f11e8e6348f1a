"""Prophesee's automotive sets (gen1, 1 Mpx), as RVT and others read them, one pair of files for each event camera.

    SPLIT/SEQUENCE[_CAMERA]_td.h5     events/{x u2, y u2, t i8 us, p u1}, events/height, events/width    (gen4)
                         _td.dat.h5   the same (gen1); or `_td.dat` with events="dat"
          SEQUENCE[_CAMERA]_bbox.npy  40 bytes a row: t i8 us, x y w h f4 px, class_id u4, track_id u4,
                                      class_confidence f4
    classes.json                      {class: number}

Boxes are in the camera's own, distorted picture, at the instants of the truth: the smallest ones around what is seen.
The camera's name is in the file's where a sequence has several. RVT takes 304x240 (gen1) or 1280x720 (gen4) for granted
where it makes its representation, and labels of gen4 at 30 or 60 Hz; it drops small boxes. The report counts for both
generations how many boxes survive its filters.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import UsageError
from ..._files import write_json
from ..files import npy_bytes
from ..sequence import Camera, Sequence
from ._files import event_columns, hdf5, put, put_events, write_events
from ._shared import Report, boxes, class_numbers, event_cameras, report_unread

_LEFT_OUT = ("pictures, depth, flow, masks, poses, IMU", "causes and objects of events")

BBOX_DTYPE = np.dtype(
    {
        "names": ["t", "x", "y", "w", "h", "class_id", "track_id", "class_confidence"],
        "formats": ["<i8", "<f4", "<f4", "<f4", "<f4", "<u4", "<u4", "<f4"],
        "offsets": [0, 8, 12, 16, 20, 24, 28, 32],
        "itemsize": 40,
    }
)
CLASSES = {
    "gen1": ("car", "pedestrian"),
    "gen4": ("pedestrian", "two wheeler", "car", "truck", "bus", "traffic sign", "traffic light"),
}
# RVT, scripts/genx/preprocess_dataset.py: least diagonal and side in px, width of the picture, classes kept.
_RVT = {"gen1": (30, 10, 304, None), "gen4": (60, 20, 1280, 3)}


def write(sequences: list[Sequence], folder: Path, generation: str = "gen4", events: str = "h5") -> Report:
    """generation: "gen1" or "gen4", whose class numbers and file names are taken; classes of other names get numbers
    behind them. events: "h5", "dat" or "both"."""
    if generation not in CLASSES or events not in ("h5", "dat", "both"):
        raise UsageError(
            f"prophesee: got generation {generation!r}, events {events!r}; "
            "wanted 'gen1' or 'gen4'; 'h5', 'dat' or 'both'"
        )
    report = Report(dict.fromkeys(_LEFT_OUT, "the format has no place for them"))
    numbers = class_numbers(sequences, CLASSES[generation])
    report.more |= {"classes": numbers, "rvt": {"gen1": {"boxes": 0}, "gen4": {"boxes": 0}}}
    write_json(folder / "classes.json", numbers)
    report_unread(report, numbers, _RVT[generation][3] or len(CLASSES[generation]), "RVT")
    for sequence in sequences:
        for name, camera in event_cameras(sequence):
            at = folder / sequence.split / name
            at.parent.mkdir(exist_ok=True)
            count = _write_events(at, camera, generation, events)
            labels = _labels(camera, numbers)
            at.with_name(f"{name}_bbox.npy").write_bytes(npy_bytes(labels))
            report.count(sequence.name, events=count, boxes=len(labels))
            if not camera.has_boxes:
                report.leave_out("boxes", f"camera {camera.name} has no objects.json", sequence.name)
            for key, found in report.more["rvt"].items():
                kept = int(survive_rvt(labels, key, camera, sequence.split == "train").sum())
                found["boxes"] += len(labels)
                found[sequence.split] = found.get(sequence.split, 0) + kept
    return report


def _write_events(at: Path, camera: Camera, generation: str, kinds: str) -> int:
    with camera.event_file() as events:
        if kinds in ("h5", "both"):
            suffix = "_td.h5" if generation == "gen4" else "_td.dat.h5"
            with hdf5(at.with_name(at.name + suffix)) as file:
                put_events(file, events, event_columns("events"))
                put(file, "events/height", np.int64(camera.height))
                put(file, "events/width", np.int64(camera.width))
        if kinds in ("dat", "both"):
            write_events(at.with_name(at.name + "_td.dat"), camera, events, "dat")
        return len(events)


def _labels(camera: Camera, numbers: dict[str, int]) -> NDArray[Any]:
    rows: list[tuple[Any, ...]] = []
    for i, t in enumerate(camera.truth.times_us if camera.has_boxes else []):
        rows += [(int(round(t)), b.x, b.y, b.w, b.h, numbers[b.name], b.track, 1) for b in boxes(camera, i)]
    labels = np.zeros(len(rows), BBOX_DTYPE)  # zeros: the type has padding, whose bytes would be what memory held
    labels[:] = rows
    return labels


def survive_rvt(labels: NDArray[Any], generation: str, camera: Camera, training: bool) -> NDArray[np.bool_]:
    """The boxes that RVT's filters leave: classes, cut to the picture, least size, and for training greatest
    width. `classes` of gen4: the first three."""
    diagonal, side, wide, classes = _RVT[generation]
    x0, x1 = (np.clip(v, 0, camera.width - 1) for v in (labels["x"], labels["x"] + labels["w"]))
    y0, y1 = (np.clip(v, 0, camera.height - 1) for v in (labels["y"], labels["y"] + labels["h"]))
    w, h = x1 - x0, y1 - y0
    keep = (np.minimum(w, h) >= side) & (w**2 + h**2 >= diagonal**2)
    if classes is not None:
        keep &= labels["class_id"] < classes
    return keep & (w <= 9 * wide // 10) if training else keep
