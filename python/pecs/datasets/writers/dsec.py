"""DSEC (Gehrig et al., RA-L 2021; dsec.ifi.uzh.ch), at any size; DSEC's own code assumes 640x480.

    SPLIT/SEQUENCE/
      events/{left,right}/events.h5        events/{x u2, y u2, t u4 us, p u1}, ms_to_idx u8, t_offset i8
      events/{left,right}/rectify_map.h5   rectify_map f4 [H, W, 2]: [y, x] -> (x', y') in the rectified picture
      disparity/timestamps.txt, disparity/event/NNNNNN.png   16 bit, 256 x disparity, 0 unknown; of events/left
      flow/{forward,backward}_timestamps.txt, flow/{forward,backward}/NNNNNN.png   16 bit RGB: R = 128 fx + 2^15,
                                           G = 128 fy + 2^15, B = 1 where known and visible at
                                           both ends; of events/left
      images/timestamps.txt, images/{left,right}/exposure_timestamps.txt, images/{left,right}/rectified/NNNNNN.png
      calibration/cam_to_cam.yaml          cam0 events left, cam1 images left, cam2 images right, cam3 events right

Flow and disparity are in the *rectified* picture of the left events (K_rect, R_rect), as DSEC's are; an image file's
time is the middle of its exposure. `ms_to_idx` goes to the end of the sequence, so that its last window is there, too.
The first disparity is at the sequence's begin: DSEC's loader drops it. One event camera alone is "left".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import PecsInputError, UsageError
from ..._files import write_json
from ..files import read_picture
from ..rectify import Rectifier, Stereo
from ..sequence import Camera, Sequence
from ._files import event_columns, hdf5, put, put_events, write_lines, write_png
from ._shared import Report, four

UNEQUAL_TIMES = "the pictures of the left and right camera have different times"
_ROLES = ("cam0", "cam1", "cam2", "cam3")
_OUTSIDE = {
    "causes and objects of events": "DSEC has no place for them",
    "normals, masks, object poses": "DSEC has no place for them",
    "IMU and poses": "DSEC's lie in ROS bags",
}


def write(sequences: list[Sequence], folder: Path, flow_us: int | None = None) -> Report:
    """flow_us: flow over so long (DSEC's is over 100_000), from one end to the next; over each interval of the truth if
    not given."""
    report = Report(_OUTSIDE)
    for sequence in sequences:
        write_sequence(sequence, folder / sequence.split / sequence.name, report, flow_us)
    return report


def roles(sequence: Sequence) -> dict[str, Camera]:
    """DSEC's cameras: the first stereo pair of events and of pictures, or the first camera alone as the left one.
    Without a camera of pictures, event cameras that take frames are both."""
    out = {}
    for kind, left, right in (("events", "cam0", "cam3"), ("rgb", "cam1", "cam2")):
        pairs, cameras = sequence.stereo_pairs(kind), sequence.of_kind(kind)
        if pairs:
            out[left], out[right] = pairs[0]
        elif cameras:
            out[left] = cameras[0]
    if "cam0" not in out:
        raise PecsInputError(f"{sequence.folder}: got no event camera, wanted one or a stereo pair")
    if "cam1" not in out and out["cam0"].frames():
        out |= {also: out[role] for role, also in (("cam0", "cam1"), ("cam3", "cam2")) if role in out}
    return out


def write_sequence(sequence: Sequence, folder: Path, report: Report, flow_us: int | None) -> None:
    cameras = roles(sequence)
    for camera in sequence.cameras.values():
        if camera not in cameras.values():
            report.leave_out(f"camera {camera.name}", "DSEC has two event cameras and two others", sequence.name)
    for side, role in (("left", "cam0"), ("right", "cam3")):
        if role in cameras:
            count = write_events(folder / "events" / side, cameras[role], sequence.duration_us)
            report.count(sequence.name, **{f"events_{side}": count})
            if cameras[role].frames() and cameras[role] not in (cameras.get("cam1"), cameras.get("cam2")):
                why = "DSEC's pictures are of other cameras"
                report.leave_out(f"frames of camera {cameras[role].name}", why, sequence.name)
    _write_calibration(folder / "calibration" / "cam_to_cam.yaml", cameras)
    _write_images(folder / "images", cameras, sequence, report)
    left = cameras["cam0"]
    if not left.has_truth:
        report.leave_out("flow, disparity", f"camera {left.name} has no truth", sequence.name)
        return
    rectifier = Rectifier(left)
    if "motion" in left.truth.layers:
        _write_flow(folder / "flow", rectifier, flow_pairs(left, flow_us), sequence, report)
    if "cam3" in cameras and "depth" in left.truth.layers:
        _write_disparity(folder / "disparity", rectifier, Stereo(left, cameras["cam3"]), sequence, report)


def write_events(folder: Path, camera: Camera, duration_us: int) -> int:
    with camera.event_file() as events, hdf5(folder / "events.h5") as file:
        wide = len(ms_to_idx := events.ms_to_idx(duration_us)) > (1 << 32) // 1000
        put_events(file, events, event_columns("events", t="<i8" if wide else "<u4"))
        put(file, "ms_to_idx", ms_to_idx)
        put(file, "t_offset", np.int64(0))
        count = len(events)
    with hdf5(folder / "rectify_map.h5") as file:
        put(file, "rectify_map", camera.rectify_map())
    return count


def _write_images(folder: Path, cameras: dict[str, Camera], sequence: Sequence, report: Report) -> None:
    times: list[list[int]] = []
    for side, role in (("left", "cam1"), ("right", "cam2")):
        if role not in cameras:
            continue
        rectifier, frames = Rectifier(cameras[role]), cameras[role].frames()
        for i, frame in enumerate(frames):
            write_png(folder / side / "rectified" / f"{i:06d}.png", rectifier.picture(read_picture(frame.path)))
        lines = [f"{frame.start_us}, {frame.end_us}" for frame in frames]
        header = "# exposure_start_timestamp_us, exposure_end_timestamp_us"
        write_lines(folder / side / "exposure_timestamps.txt", [header, *lines])
        times.append([int(frame.middle_us) for frame in frames])
        report.count(sequence.name, images=len(frames))
    if times[1:] not in ([], times[:1]):
        raise PecsInputError(f"{sequence.folder}: {UNEQUAL_TIMES}")
    if times:
        write_lines(folder / "timestamps.txt", [str(t) for t in times[0]])


def surfaces(camera: Camera, i: int) -> NDArray[np.int64] | None:
    """The masks that tell surfaces apart at an instant, if the truth has objects."""
    return camera.truth.instances(i) if "objects" in camera.truth.layers else None


def flow_picture(flow_px: NDArray[np.float64], visible: NDArray[np.bool_]) -> tuple[NDArray[np.uint16], int]:
    """DSEC's 16 bit picture, RGB, and how many known values do not fit (|f| >= 256 px). visible: pixels [H, W] whose
    point is visible at the flow's end."""
    known = np.isfinite(flow_px).all(-1) & visible
    code = np.rint(np.where(known[..., None], flow_px, 0) * 128) + (1 << 15)
    fits = ((code >= 0) & (code <= 65535)).all(-1)
    out = np.zeros((*known.shape, 3), np.uint16)
    out[..., :2] = np.where((known & fits)[..., None], code, 1 << 15)
    out[..., 2] = known & fits
    return out, int((known & ~fits).sum())


def flow_pairs(camera: Camera, flow_us: int | None) -> list[tuple[int, int]]:
    """Instants of the truth so far apart (to 1 us), each pair beginning where the one before ends."""
    times = camera.truth.times_us
    if flow_us is None:
        return [(i, i + 1) for i in range(len(times) - 1)]
    pairs, i = [], 0
    while times[i] + flow_us <= times[-1] + 1:
        j = int(np.abs(times - times[i] - flow_us).argmin())
        if j <= i or abs(times[j] - times[i] - flow_us) > 1:
            break
        pairs.append((i, j))
        i = j
    if not pairs:
        raise UsageError(
            f"{camera.truth.folder}: flow_us: got {flow_us}, wanted the time between two instants of the truth"
        )
    return pairs


def _write_flow(
    folder: Path, rectifier: Rectifier, pairs: list[tuple[int, int]], sequence: Sequence, report: Report
) -> None:
    camera = rectifier.camera
    times = _whole_us(camera)
    for name in ("forward", "backward"):
        lines = ["# from_timestamp_us, to_timestamp_us"]
        for number, pair in enumerate(pairs):
            start, end = pair if name == "forward" else pair[::-1]
            flow = rectifier.flow(camera.truth.flow(start, end), surfaces(camera, start))
            seen = camera.truth.visible_at(start, end) if "depth" in camera.truth.layers else np.ones(flow.shape[:2])
            picture, too_long = flow_picture(flow, rectifier.sample(seen[..., None].astype(np.float64))[..., 0] > 0.5)
            write_png(folder / name / f"{number:06d}.png", picture)
            lines.append(f"{times[start]}, {times[end]}")
            report.count(sequence.name, flow=1, pixels_of_flow_too_long=too_long)
        write_lines(folder / f"{name}_timestamps.txt", lines)


def disparity_picture(px: NDArray[np.float64]) -> tuple[NDArray[np.uint16], int]:
    """DSEC's 16 bit picture, and how many known values do not fit (below 1/256 px, 256 px and more)."""
    known = np.isfinite(px)
    code = np.rint(np.where(known, px, 0) * 256)
    fits = (code >= 1) & (code <= 65535)
    return np.where(known & fits, code, 0).astype(np.uint16), int((known & ~fits).sum())


def _write_disparity(folder: Path, rectifier: Rectifier, stereo: Stereo, sequence: Sequence, report: Report) -> None:
    camera = rectifier.camera
    for i in range(len(camera.truth)):
        px = rectifier.disparity(camera.truth.depth(i)[1].astype(np.float64), stereo, surfaces(camera, i))
        picture, misfits = disparity_picture(px)
        write_png(folder / "event" / f"{i:06d}.png", picture)
        report.count(sequence.name, disparity=1, pixels_of_disparity_outside=misfits)
    write_lines(folder / "timestamps.txt", [str(t) for t in _whole_us(camera)])


def _whole_us(camera: Camera) -> list[int]:
    return [int(t) for t in np.rint(camera.truth.times_us)]


def _write_calibration(path: Path, cameras: dict[str, Camera]) -> None:
    """cam_to_cam.yaml (as JSON, which is YAML). T_ba takes points of camera a to camera b; R_rectN those of camera N to
    its rectified axes."""
    intrinsics: dict[str, Any] = {}
    extrinsics: dict[str, Any] = {}
    for role, camera in cameras.items():
        common = {"camera_model": "pinhole", "resolution": [camera.width, camera.height]}
        distortion = {"distortion_coeffs": camera.distortion.tolist(), "distortion_model": camera.distortion_model}
        intrinsics[role] = common | distortion | {"camera_matrix": four(camera.K)}
        intrinsics[f"camRect{role[3:]}"] = common | {"camera_matrix": four(camera.K_rect)}
    present = [role for role in _ROLES if role in cameras]
    for a, b in zip(present, present[1:], strict=False):
        b_from_a = np.linalg.inv(cameras[b].rig_from_camera) @ cameras[a].rig_from_camera
        extrinsics[f"T_{b[3:]}{a[3:]}"] = b_from_a.tolist()
    extrinsics |= {f"R_rect{role[3:]}": cameras[role].R_rect.tolist() for role in present}
    content: dict[str, Any] = {"intrinsics": intrinsics, "extrinsics": extrinsics}
    for a, b in (("cam0", "cam3"), ("cam1", "cam2")):
        if a in cameras and b in cameras:
            Q = Stereo(cameras[a], cameras[b]).depth_of_disparity(cameras[a])
            content.setdefault("disparity_to_depth", {})[f"cams_{a[3:]}{b[3:]}"] = Q.tolist()
    write_json(path, content)
