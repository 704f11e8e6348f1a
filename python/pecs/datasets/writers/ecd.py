"""Event Camera Dataset (Mueggler et al., IJRR 2017), E2VID's text, TUM poses, EuRoC IMU: one folder for each event
camera.

    SEQUENCE[_CAMERA]/
      events.txt        t_s x y p, six decimals: microseconds exactly
      e2vid.txt         the same under a first line `W H`: what E2VID's run_reconstruction.py takes
      images.txt        t_s images/frame_NNNNNNNN.png (middle of the exposure); images/frame_NNNNNNNN.png, grey
      groundtruth.txt   TUM: t_s px py pz qx qy qz qw of world_from_camera
      calib.txt         fx fy cx cy k1 k2 p1 p2 k3 (more coefficients where the lens has them)
      imu.txt           t_s ax ay az gx gy gz;  imu0/data.csv the same as EuRoC's; both in the
                        IMU's axes; imu0/sensor.yaml: T_BS, rig_from_imu
      depth/NNNNNNNN.npy f4 [H, W] m: z on the camera's own, distorted pixels; depth.txt: t_s depth/NNNNNNNN.npy

Pictures are those of an RGB camera with the same pixels (a beam splitter), as in a DAVIS.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._files import write_json
from ..._poses import position_quaternion, write_euroc_imu
from ..files import npy_bytes, read_picture
from ..sequence import Camera, Sequence, frames_of, rig_from_imu
from ._files import BLOCK, grey, write_events, write_lines, write_png
from ._shared import NO_FRAMES, Report, event_cameras, four


def write(sequences: list[Sequence], folder: Path) -> Report:
    """No options."""
    report = Report({"flow, normals, masks, boxes, causes, objects": "the format has no place for them"})
    for sequence in sequences:
        for name, camera in event_cameras(sequence):
            at = folder / name
            at.mkdir()
            _write_events(at, camera, sequence, report)
            _write_frames(at, sequence, camera, report)
            _write_poses(at, camera)
            _write_imu(at, sequence, report)
            if camera.has_truth and "depth" in camera.truth.layers:
                _write_depth(at, camera)
                report.count(sequence.name, depth=len(camera.truth))
    return report


def _write_events(folder: Path, camera: Camera, sequence: Sequence, report: Report) -> None:
    with camera.event_file() as events:
        with (folder / "events.txt").open("w") as file:
            for block in events.blocks(BLOCK):
                rows = zip(*(block[c].tolist() for c in "txyp"), strict=True)
                file.writelines(f"{t // 1_000_000}.{t % 1_000_000:06d} {x} {y} {p}\n" for t, x, y, p in rows)
        write_events(folder / "e2vid.txt", camera, events, "e2vid")
        report.count(sequence.name, events=len(events))


def _write_frames(folder: Path, sequence: Sequence, camera: Camera, report: Report) -> None:
    frames = frames_of(sequence, camera)
    if not frames:
        report.leave_out(f"pictures of camera {camera.name}", NO_FRAMES, sequence.name)
        return
    lines = []
    for i, frame in enumerate(frames):
        name = f"images/frame_{i:08d}.png"
        write_png(folder / name, grey(read_picture(frame.path)))
        lines.append(f"{frame.middle_us * 1e-6:.6f} {name}")
    write_lines(folder / "images.txt", lines)
    report.count(sequence.name, pictures=len(frames))


def _write_poses(folder: Path, camera: Camera) -> None:
    t_us, poses = camera.poses()
    positions, quaternions = position_quaternion(poses)
    rows = np.column_stack([positions, quaternions])
    write_lines(folder / "groundtruth.txt", [f"{t * 1e-6:.9f} {_row(row)}" for t, row in zip(t_us, rows, strict=True)])
    write_lines(folder / "calib.txt", [_row([*four(camera.K), *camera.distortion])])


def _row(values: NDArray[np.float64] | list[Any]) -> str:
    return " ".join(repr(float(v)) for v in values)


def _write_imu(folder: Path, sequence: Sequence, report: Report) -> None:
    samples = sequence.imu()
    if samples is None:
        report.leave_out("imu.txt, imu0/data.csv", "the sequence has no IMU", sequence.name)
        return
    rows = np.column_stack([samples["accel"], samples["gyro"]])
    write_lines(
        folder / "imu.txt", [f"{t * 1e-6:.9f} {_row(row)}" for t, row in zip(samples["t_us"], rows, strict=True)]
    )
    (folder / "imu0").mkdir()
    t_ns = np.rint(samples["t_us"] * 1e3).astype(np.int64)
    write_euroc_imu(folder / "imu0" / "data.csv", t_ns, samples["gyro"], samples["accel"])
    noise: dict[str, Any] = sequence.info["imu"].get("noise", {})
    placed = {"T_BS": {"cols": 4, "rows": 4, "data": rig_from_imu(sequence).ravel().tolist()}}
    write_json(folder / "imu0" / "sensor.yaml", {"sensor_type": "imu"} | placed | noise)


def _write_depth(folder: Path, camera: Camera) -> None:
    (folder / "depth").mkdir()
    lines = []
    for i, t in enumerate(camera.truth.times_us):
        name = f"depth/{i:08d}.npy"
        (folder / name).write_bytes(npy_bytes(camera.truth.depth(i)[1]))
        lines.append(f"{t * 1e-6:.6f} {name}")
    write_lines(folder / "depth.txt", lines)
