"""COCO (cocodataset.org): instance segmentation, one file for each camera that has truth.

    annotations/SPLIT_CAMERA.json   images, annotations (RLE masks, column by column, as pycocotools writes), categories
    images/CAMERA/SEQUENCE_NNNNNN.png

An image is an instant of the truth: of an RGB camera the picture whose exposure has it in its middle, of an event
camera its events from the instant before to this one (ON blue, OFF orange). Boxes [x, y, w, h] and masks are of what is
seen, on the camera's own, distorted pixels; `iscrowd` is 0. Beside COCO's own keys an annotation has `track_id` (the
object's id, stable over a sequence and its cameras), `amodal_bbox`, `occluded`, `truncated`, and an image `sequence`
and `t_us`. Categories are the classes of all sequences by name, from 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import optional_module
from ..._files import write_json
from ...representations import event_picture
from ..files import read_picture
from ..sequence import Camera, Sequence
from ._files import write_png
from ._shared import Report, boxes, class_numbers, truth_at

_LEFT_OUT = ("depth, flow, normals, poses, IMU", "causes and objects of events")


def write(sequences: list[Sequence], folder: Path) -> Report:
    """No options."""
    report = Report(dict.fromkeys(_LEFT_OUT, "COCO has no place for them"))
    numbers = class_numbers(sequences, first=1)
    report.more["classes"] = numbers
    files: dict[tuple[str, str], dict[str, Any]] = {}
    for sequence in sequences:
        for camera in sequence.cameras.values():
            if not camera.has_boxes:
                report.leave_out(f"camera {camera.name}", "it has no objects.json", sequence.name)
                continue
            empty = {"info": {"description": f"camera {camera.name}"}, "licenses": [], "images": [], "annotations": []}
            coco = files.setdefault((sequence.split, camera.name), empty)
            _add_camera(coco, folder, sequence, camera, numbers, report)
    categories = [{"id": i, "name": name, "supercategory": "object"} for name, i in numbers.items()]
    for (split, name), coco in files.items():
        write_json(folder / "annotations" / f"{split}_{name}.json", coco | {"categories": categories})
    return report


def _pictures(camera: Camera) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Instants and their pictures."""
    times = camera.truth.times_us
    if camera.kind == "events":
        with camera.event_file() as events:
            for i in range(1, len(times)):
                yield i, event_picture(events.between(times[i - 1], times[i]), camera.width, camera.height)
        return
    for frame in camera.frames():
        i = truth_at(camera, frame.middle_us)
        if i is not None:
            yield i, read_picture(frame.path)


def _add_camera(
    coco: dict[str, Any], folder: Path, sequence: Sequence, camera: Camera, numbers: dict[str, int], report: Report
) -> None:
    mask = optional_module("pycocotools.mask", "pycocotools", "writing COCO")
    for i, picture in _pictures(camera):
        image_id = len(coco["images"]) + 1
        name = f"images/{camera.name}/{sequence.name}_{i:06d}.png"
        write_png(folder / name, picture)
        image = {"id": image_id, "file_name": name, "width": camera.width, "height": camera.height}
        coco["images"].append(image | {"sequence": sequence.name, "t_us": float(camera.truth.times_us[i])})
        ids = camera.truth.instances(i)
        for box in boxes(camera, i):
            rle = mask.encode(np.asfortranarray(ids == box.track, np.uint8))
            found = {"id": len(coco["annotations"]) + 1, "image_id": image_id, "category_id": numbers[box.name]}
            found |= {"bbox": [box.x, box.y, box.w, box.h], "area": int(mask.area(rle)), "iscrowd": 0}
            found["segmentation"] = {"size": list(rle["size"]), "counts": rle["counts"].decode()}
            found |= {"track_id": box.track, "amodal_bbox": list(box.amodal)}
            coco["annotations"].append(found | {"occluded": box.occluded, "truncated": box.truncated})
            report.count(sequence.name, annotations=1)
        report.count(sequence.name, images=1)
