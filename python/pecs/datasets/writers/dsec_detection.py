"""DSEC-Detection (Gehrig and Scaramuzza, Nature 2024; github.com/uzh-rpg/dsec-det): DSEC (`dsec.py`), and

    SPLIT/SEQUENCE/
      object_detections/left/tracks.npy   (t u8 us, x y h w f8 px, class_id u1, track_id u4, class_confidence f8)
      images/left/distorted/NNNNNN.png    cam1 in the view of the left events, as things far away lie there
    classes.json                          {class: number}

Boxes are in the left event camera's own, *distorted* picture: the smallest ones around what is seen, x and y of the
upper left edge. Its loader pairs boxes with pictures of equal time: boxes are at the times of the pictures that are
instants of the truth, and without pictures at all instants of the truth. The pictures' parallax is that of dsec-det: a
rotation joins them, so near things are off by focal length x distance of the cameras / depth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..._errors import PecsInputError, optional_module
from ..._files import write_json
from ..files import npy_bytes, read_picture
from ..rectify import Lens
from ..sequence import Camera, Sequence
from . import dsec
from ._files import write_png
from ._shared import Report, boxes, class_numbers, report_unread, truth_at

CLASSES = ("pedestrian", "rider", "car", "bus", "truck", "bicycle", "motorcycle", "train")
TRACKS_DTYPE = np.dtype(
    [("t", "<u8"), *((name, "<f8") for name in "xyhw"), ("class_id", "u1"), ("track_id", "<u4")]
    + [("class_confidence", "<f8")]
)


def write(sequences: list[Sequence], folder: Path, flow_us: int | None = None) -> Report:
    """flow_us: as of `dsec`. Classes of other names than dsec-det's eight get numbers behind them."""
    numbers = class_numbers(sequences, CLASSES)
    if len(numbers) > 256:
        raise PecsInputError(f"dsec_detection: classes: got {len(numbers)}, wanted at most 256")
    report = dsec.write(sequences, folder, flow_us)
    report.more["classes"] = numbers
    write_json(folder / "classes.json", numbers)
    report_unread(report, numbers, len(CLASSES), "dsec-det")
    for sequence in sequences:
        at = folder / sequence.split / sequence.name
        cameras = dsec.roles(sequence)
        _write_tracks(at / "object_detections" / "left" / "tracks.npy", cameras, numbers, sequence, report)
        if "cam1" in cameras:
            _write_distorted(at / "images" / "left" / "distorted", cameras["cam0"], cameras["cam1"])
    return report


def _instants(cameras: dict[str, Camera], sequence: Sequence, report: Report) -> list[int]:
    camera = cameras["cam0"]
    if cameras.get("cam1", camera) is camera:
        return list(range(len(camera.truth)))
    found = [truth_at(camera, frame.middle_us) for frame in cameras["cam1"].frames()]
    if None in found:
        report.leave_out("boxes of some pictures", "the truth has no instant at their time", sequence.name)
    return [i for i in found if i is not None]


def _write_tracks(
    path: Path, cameras: dict[str, Camera], numbers: dict[str, int], sequence: Sequence, report: Report
) -> None:
    camera, rows = cameras["cam0"], []
    if camera.has_boxes:
        for i in _instants(cameras, sequence, report):
            t = int(round(camera.truth.times_us[i]))
            rows += [(t, b.x, b.y, b.h, b.w, numbers[b.name], b.track, 1.0) for b in boxes(camera, i)]
    else:
        report.leave_out("boxes", f"camera {camera.name} has no objects.json", sequence.name)
    path.parent.mkdir(parents=True)
    path.write_bytes(npy_bytes(np.array(rows, TRACKS_DTYPE)))
    report.count(sequence.name, boxes=len(rows))


def _far_map(events: Camera, pictures: Camera) -> NDArray[np.float32]:
    """Place in the other camera's picture [H, W, 2] of what each pixel of the event camera sees far away."""
    lens = Lens(pictures)
    R = (np.linalg.inv(pictures.rig_from_camera) @ events.rig_from_camera)[:3, :3]
    rect = Lens(events).rays() @ (pictures.K_rect @ pictures.R_rect @ R).T
    with np.errstate(divide="ignore", invalid="ignore"):
        rect_px = np.where(rect[..., 2:] > 0, rect[..., :2] / rect[..., 2:], np.nan)
    return np.nan_to_num(lens.from_rect(rect_px), nan=-1e6).astype(np.float32)


def _write_distorted(folder: Path, events: Camera, pictures: Camera) -> None:
    cv2 = optional_module("cv2", "opencv-python-headless", "writing pictures")
    at = _far_map(events, pictures)
    for i, frame in enumerate(pictures.frames()):
        write_png(folder / f"{i:06d}.png", cv2.remap(read_picture(frame.path), at, None, cv2.INTER_CUBIC))
