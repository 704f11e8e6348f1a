"""M3ED (Chaney et al., CVPRW 2023; m3ed.io): HDF5 files of one sequence.

    SPLIT/SEQUENCE_data.h5
      prophesee/{left,right}/{x u2, y u2, t i8 us, p i1}, ms_map_idx u8 (first event of each millisecond)
      ovc/rgb/data u1 [N, H, W, 3], ovc/{left,right}/data u1 [N, H, W, 1] (grey), ovc/ts i8 us,
      ovc/ts_map_prophesee_left_t u8 (first event of the left camera at each picture)
      ovc/imu/{omega f8 [N, 3] rad/s, accel f8 [N, 3] m/s2, ts i8 us}, ovc/imu/calib/T_to_prophesee_left
      CAMERA/calib: camera_model, intrinsics [fx fy cx cy], distortion_model, distortion_coeffs, resolution [W H],
      T_to_prophesee_left [4, 4] (takes points of the camera to the left event camera)
    SPLIT/SEQUENCE_depth_gt.h5
      depth/prophesee/left f4 [N, H, W] m: z along the optical axis on the camera's own, *distorted* pixels, inf nothing
      ts i8 us, ts_map_prophesee_left_t u8, Cn_T_C0 f8 [N, 4, 4] (points of the first instant's camera to that of now)
    SPLIT/SEQUENCE_pose_gt.h5   Cn_T_C0, ts, ts_map_prophesee_left_t alone

The first RGB camera is ovc/rgb, and grey it is ovc/left; its stereo partner, if any, is ovc/right. There is no
LiDAR, so no Ln_T_L0. Compressed by gzip instead of lzf.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import PecsInputError
from ..files import read_picture
from ..sequence import Camera, Sequence, rig_from_imu
from . import dsec
from ._files import event_columns, grey, hdf5, put, put_events, stack
from ._shared import Report, four

_LEFT_OUT = {
    "flow, normals, masks, boxes, object poses": "no place for them",
    "causes and objects of events": "no place for them",
    "LiDAR": "M3ED's own come from its LiDAR and networks",
}


def write(sequences: list[Sequence], folder: Path) -> Report:
    """No options."""
    report = Report(_LEFT_OUT)
    for sequence in sequences:
        cameras = dsec.roles(sequence)
        at = folder / sequence.split / sequence.name
        with hdf5(at.with_name(f"{at.name}_data.h5")) as file:
            for side, role in (("left", "cam0"), ("right", "cam3")):
                if role in cameras:
                    _put_events(file, f"prophesee/{side}", cameras[role], cameras["cam0"], sequence, report)
            _put_pictures(file, cameras, sequence, report)
            _put_imu(file, cameras["cam0"], sequence, report)
        _write_truth(at, cameras["cam0"], sequence, report)
    return report


def _put_events(file: Any, group: str, camera: Camera, left: Camera, sequence: Sequence, report: Report) -> None:
    with camera.event_file() as events:
        put_events(file, events, event_columns(group, p="i1"))
        put(file, f"{group}/ms_map_idx", events.ms_to_idx(sequence.duration_us))
        report.count(sequence.name, events=len(events))
    _put_calibration(file, group, camera, left)


def _put_calibration(file: Any, group: str, camera: Camera, left: Camera) -> None:
    h = f"{group}/calib/"
    D = camera.distortion
    file[h + "camera_model"] = "pinhole"
    file[h + "distortion_model"] = camera.distortion_model
    file[h + "distortion_coeffs"] = D if np.any(D[4:]) else D[:4]  # M3ED's have four
    file[h + "intrinsics"] = np.array(four(camera.K))
    file[h + "resolution"] = np.array([camera.width, camera.height])
    file[h + "T_to_prophesee_left"] = np.linalg.inv(left.rig_from_camera) @ camera.rig_from_camera


def _put_pictures(file: Any, cameras: dict[str, Camera], sequence: Sequence, report: Report) -> None:
    if "cam1" not in cameras:
        report.leave_out("ovc", "the sequence has no pictures", sequence.name)
        return
    for role, names in (("cam1", ("rgb", "left")), ("cam2", ("right",))):
        camera = cameras.get(role)
        if camera is None:
            continue
        frames = camera.frames()
        times = np.array([int(frame.middle_us) for frame in frames], np.int64)
        for name in names:
            shape = camera.height, camera.width, 3 if name == "rgb" else 1
            data = stack(file, f"ovc/{name}/data", len(frames), shape, "u1")
            for i, frame in enumerate(frames):
                picture = read_picture(frame.path)
                data[i] = picture if name == "rgb" else grey(picture)[..., None]
            _put_calibration(file, f"ovc/{name}", camera, cameras["cam0"])
        if role == "cam1":
            put(file, "ovc/ts", times)
            put(file, "ovc/ts_map_prophesee_left_t", _first_events(cameras["cam0"], times))
            report.count(sequence.name, pictures=len(frames))
        elif not np.array_equal(times, file["ovc/ts"][:]):
            raise PecsInputError(f"{sequence.folder}: {dsec.UNEQUAL_TIMES}")


def _first_events(camera: Camera, times_us: NDArray[Any]) -> NDArray[np.uint64]:
    with camera.event_file() as events:
        return np.array([events.index(t) for t in times_us], np.uint64)


def _put_imu(file: Any, left: Camera, sequence: Sequence, report: Report) -> None:
    samples = sequence.imu()
    if samples is None:
        report.leave_out("ovc/imu", "the sequence has no IMU", sequence.name)
        return
    put(file, "ovc/imu/omega", samples["gyro"])
    put(file, "ovc/imu/accel", samples["accel"])
    put(file, "ovc/imu/ts", np.rint(samples["t_us"]).astype(np.int64))
    file["ovc/imu/calib/T_to_prophesee_left"] = np.linalg.inv(left.rig_from_camera) @ rig_from_imu(sequence)
    report.count(sequence.name, imu=len(samples))


def _write_truth(at: Path, camera: Camera, sequence: Sequence, report: Report) -> None:
    if not camera.has_truth or "depth" not in camera.truth.layers:
        report.leave_out("depth_gt, pose_gt", f"camera {camera.name} has no depth", sequence.name)
        return
    truth = camera.truth
    poses = camera.poses_at(truth.times_us)
    for kind in ("depth_gt", "pose_gt"):
        with hdf5(at.with_name(f"{at.name}_{kind}.h5")) as file:
            file.attrs["cam_name"] = "/prophesee/left"
            put(file, "ts", np.rint(truth.times_us).astype(np.int64))
            put(file, "Cn_T_C0", np.linalg.inv(poses) @ poses[0])
            put(file, "ts_map_prophesee_left_t", _first_events(camera, truth.times_us))
            if kind == "depth_gt":
                data = stack(file, "depth/prophesee/left", len(truth), truth.shape, "<f4")
                for i in range(len(truth)):
                    data[i] = truth.depth(i)[1]
    report.count(sequence.name, depth=len(truth))
