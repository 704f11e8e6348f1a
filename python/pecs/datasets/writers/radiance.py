"""Radiance fields and splats: pictures with poses (nerfstudio's and instant-ngp's transforms.json) and events of the
same pixels, one folder for each event camera. The scene should stand still.

    SPLIT/SEQUENCE[_CAMERA]/
      transforms.json           w, h, fl_x, fl_y, cx, cy (the first pixel's centre is at 0.5), k1 k2 p1 p2 k3 of OpenCV;
                                frames: file_path, sharp_file_path, transform_matrix (world_from_camera at the middle of
                                the exposure; x right, y up, z backward; metres, the world's z up), time_s, exposure_s
                                [start, end], exposure_matrices (at the ends of the bins of events.npy)
      images/, images_sharp/    NNNNNN.png: with blur and noise; the middle of the exposure without
      events.txt                t [s] x y p, as v2e writes it
      events.npy                f8 [pictures, 4, H * W]: ON minus OFF events in each quarter of an exposure, the content
                                of E2NeRF's events.pt (Qi et al., ICCV 2023; event-preprocessing.py):
                                torch.save(torch.from_numpy(numpy.load("events.npy")), "events.pt")

Pictures are those of an RGB camera with the same pixels (a beam splitter); a camera without one is left out.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._files import write_json
from ..event_file import EventFile
from ..files import npy_bytes
from ..sequence import Camera, Frame, Sequence
from ._files import write_events
from ._shared import Report, with_pictures

BINS = 4  # E2NeRF's b
OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # of camera axes
_STILL_M = 1e-6


def write(sequences: list[Sequence], folder: Path) -> Report:
    """No options."""
    report = Report({"truth, IMU, causes, objects": "radiance fields take pictures, poses and events"})
    for sequence, name, camera, frames in with_pictures("radiance", sequences, report):
        _write_camera(folder / sequence.split / name, sequence, camera, frames, report)
    return report


def _write_camera(folder: Path, sequence: Sequence, camera: Camera, frames: list[Frame], report: Report) -> None:
    for name in ("images", "images_sharp"):
        (folder / name).mkdir(parents=True)
    with camera.event_file() as events:
        write_events(folder / "events.txt", camera, events, "v2e")
        counts = np.stack([_counts(events, camera, frame) for frame in frames])
        (folder / "events.npy").write_bytes(npy_bytes(counts))
        report.count(sequence.name, events=len(events), pictures=len(frames))
    rows = [_frame(folder, camera, i, frame) for i, frame in enumerate(frames)]
    write_json(folder / "transforms.json", _intrinsics(camera) | {"frames": rows})
    if moving := _moving(camera):
        why = f"a radiance field does not explain them: {', '.join(moving)}"
        report.leave_out("motion of objects", why, sequence.name)


def _intrinsics(camera: Camera) -> dict[str, Any]:
    K, names = camera.K, ("k1", "k2", "p1", "p2", "k3")
    found = {"camera_model": "OPENCV", "w": camera.width, "h": camera.height}
    found |= {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5}
    return found | dict(zip(names, camera.distortion.tolist(), strict=False))


def _frame(folder: Path, camera: Camera, index: int, frame: Frame) -> dict[str, Any]:
    name = f"{index:06d}.png"
    shutil.copyfile(frame.path, folder / "images" / name)
    found = {"file_path": f"images/{name}"}
    if frame.sharp_path.exists():
        shutil.copyfile(frame.sharp_path, folder / "images_sharp" / name)
        found["sharp_file_path"] = f"images_sharp/{name}"
    edges = np.linspace(frame.start_us, frame.end_us, BINS + 1)
    poses = camera.poses_at(np.append(edges, frame.middle_us)) @ OPENGL_FROM_OPENCV
    times = {"time_s": frame.middle_us * 1e-6, "exposure_s": [frame.start_us * 1e-6, frame.end_us * 1e-6]}
    return found | times | {"transform_matrix": poses[-1].tolist(), "exposure_matrices": poses[:-1].tolist()}


def _counts(events: EventFile, camera: Camera, frame: Frame) -> NDArray[np.float64]:
    """[BINS, H * W]"""
    pixels, edges = camera.width * camera.height, np.linspace(frame.start_us, frame.end_us, BINS + 1)
    out = np.zeros((BINS, pixels))
    for row, start, end in zip(out, edges, edges[1:], strict=False):
        found = events.between(start, end)
        at = found["y"].astype(np.int64) * camera.width + found["x"]
        row += np.bincount(at, np.where(found["p"] == 1, 1.0, -1.0), pixels)
    return out


def _moving(camera: Camera) -> list[str]:
    """Names of objects that move or deform."""
    if not camera.has_boxes:
        return []
    truth, first = camera.truth, camera.truth.object_poses(0)
    moved = set(truth.deforming)
    for i in range(1, len(truth)):
        moved |= {
            k for k, pose in truth.object_poses(i).items() if k in first and np.abs(pose - first[k]).max() > _STILL_M
        }
    return sorted(o["name"] for o in truth.objects if o["id"] in moved)
