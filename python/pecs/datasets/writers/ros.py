"""ROS bags (pecs.ros) with the topics of ESIM, one bag for each sequence. Event cameras come first: cam0, cam1, ...;
an RGB camera with the pixels of an event camera has no number.

    SEQUENCE/              metadata.yaml and SEQUENCE.mcap (storage "mcap") or SEQUENCE.db3 ("sqlite3");
    SEQUENCE.bag           storage "ros1"
      /camN/events         dvs_msgs/EventArray or event_camera_msgs/EventPacket
      /camN/image_raw      sensor_msgs/Image rgb8, at the middle of the exposure
      /camN/exposure       std_msgs/Int32: of a DAVIS's image [us], as its driver has it
      /camN/camera_info    sensor_msgs/CameraInfo: plumb_bob or rational_polynomial; R and P of the rectified picture,
                           with -fx baseline in P of the right camera of a stereo pair
      /camN/pose           geometry_msgs/PoseStamped: world_from_camera; x right, y down, z forward
      /camN/depthmap       sensor_msgs/Image 32FC1: z [m] on the distorted pixels, as in the native files
      /camN/optic_flow     esim_msgs/OpticFlow: velocity [px/s] up to the next instant of the truth, NaN unknown
      /imu                 sensor_msgs/Imu in the IMU's axes, without an orientation

frame_id is the camera's name, "world" or "imu".
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import ros
from ..._errors import UsageError
from ..._poses import position_quaternion
from ..files import read_picture
from ..sequence import Camera, Frame, Sequence, frames_of, rect_from_rect, same_pixels
from ._files import BLOCK
from ._shared import Report, event_cameras

Message = tuple[int, str, str, bytes]  # time [ns], topic, type, content


def write(sequences: list[Sequence], folder: Path, storage: str = "mcap", messages: str | None = None) -> Report:
    """storage: "mcap", "sqlite3" or "ros1". messages: "dvs_msgs" or "event_camera_msgs"; by default the first for
    "ros1", otherwise the second."""
    if storage not in ros.STORAGES:
        raise UsageError(f"ros: storage: got {storage}, wanted {', '.join(ros.STORAGES)}")
    messages = messages or ("dvs_msgs" if storage == "ros1" else "event_camera_msgs")
    ros.check_messages("ros", messages)
    report = Report({"normals, masks, boxes, causes, objects": "ROS has no messages for them"})
    for sequence in sequences:
        name = f"{sequence.name}.bag" if storage == "ros1" else sequence.name
        with ros.Bag(folder / name, storage) as bag:
            streams = [_imu(bag, sequence, report)]
            for i, camera in enumerate(_cameras(sequence)):
                streams += _streams(bag, f"/cam{i}", sequence, camera, messages, report)
            for t_ns, topic, kind, data in heapq.merge(*streams, key=lambda message: message[0]):
                bag.write(topic, kind, t_ns, data)
                report.count(sequence.name, **{topic.rpartition("/")[2]: 1})
    return report


def _cameras(sequence: Sequence) -> list[Camera]:
    events = [camera for _, camera in event_cameras(sequence)]
    return events + [c for c in sequence.of_kind("rgb") if not any(same_pixels(c, e) for e in events)]


def _streams(
    bag: ros.Bag, at: str, sequence: Sequence, camera: Camera, messages: str, report: Report
) -> list[Iterator[Message]]:
    frames = frames_of(sequence, camera)
    streams = [_images(bag, at, sequence, camera, frames), _poses(bag, at, camera)]
    if camera.kind == "events":
        ros.check_size(camera.events_path, camera.width, camera.height, messages)
        streams.append(_events(bag, at, camera, messages))
    if not frames:
        report.leave_out(
            f"image_raw of camera {camera.name}", "it takes no frames, and no RGB camera has its pixels", sequence.name
        )
    if camera.has_truth and "depth" in camera.truth.layers:
        streams.append(_depth(bag, at, camera))
    if camera.has_truth and "motion" in camera.truth.layers:
        streams.append(_flow(bag, at, camera))
    return streams


def _ns(t_us: float) -> int:
    return int(np.rint(t_us * 1000))


def _message(bag: ros.Bag, at: str, t_us: float, frame: str, kind: str, **fields: Any) -> Message:
    message = bag.message(kind, header=bag.header(_ns(t_us), frame), **fields)
    return _ns(t_us), at, kind, bag.serialized(message)


def _events(bag: ros.Bag, at: str, camera: Camera, messages: str) -> Iterator[Message]:
    with camera.event_file() as events:
        found = bag.event_messages(events.blocks(BLOCK), camera.width, camera.height, messages, camera.name)
        for t_ns, data in found:
            yield t_ns, f"{at}/events", ros.MESSAGES[messages][0], data


def _image(bag: ros.Bag, at: str, t_us: float, frame: str, encoding: str, picture: NDArray[Any]) -> Message:
    rows = np.ascontiguousarray(picture).view(np.uint8).reshape(len(picture), -1)
    fields = {"height": len(rows), "width": picture.shape[1], "encoding": encoding, "is_bigendian": 0}
    return _message(bag, at, t_us, frame, "sensor_msgs/msg/Image", **fields, step=rows.shape[1], data=rows.ravel())


def _images(bag: ros.Bag, at: str, sequence: Sequence, camera: Camera, frames: list[Frame]) -> Iterator[Message]:
    """Pictures and, for each or once, the camera's model."""
    for t_us in [frame.middle_us for frame in frames] or [0.0]:
        yield _camera_info(bag, f"{at}/camera_info", t_us, sequence, camera)
        for frame in frames:
            if frame.middle_us == t_us:
                picture, grey = read_picture(frame.path), bool(camera.kind == "events" and camera.frames())
                picture, encoding = (picture[..., :1], "mono8") if grey else (picture, "rgb8")  # of a DAVIS's driver
                yield _image(bag, f"{at}/image_raw", t_us, camera.name, encoding, picture)
                if grey:
                    exposure = bag.message("std_msgs/msg/Int32", data=frame.end_us - frame.start_us)
                    yield _ns(t_us), f"{at}/exposure", "std_msgs/msg/Int32", bag.serialized(exposure)


def _camera_info(bag: ros.Bag, at: str, t_us: float, sequence: Sequence, camera: Camera) -> Message:
    model = "plumb_bob" if len(camera.distortion) <= 5 else "rational_polynomial"
    d = np.zeros(max(5 if model == "plumb_bob" else 8, len(camera.distortion)))
    d[: len(camera.distortion)] = camera.distortion
    lefts = [left for left, right in sequence.stereo_pairs(camera.kind) if right is camera]
    P = camera.K_rect @ np.column_stack([np.eye(3), -rect_from_rect(lefts[0], camera)[:3, 3] if lefts else np.zeros(3)])
    matrices = {"d": d, "k": camera.K.ravel(), "r": camera.R_rect.ravel(), "p": P.ravel()}
    if bag.ros1:
        matrices = {name.upper(): value for name, value in matrices.items()}
    kind = "sensor_msgs/msg/RegionOfInterest"
    roi = bag.message(kind, x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    fields = {"height": camera.height, "width": camera.width, "distortion_model": model}
    more = {"binning_x": 0, "binning_y": 0, "roi": roi}
    return _message(bag, at, t_us, camera.name, "sensor_msgs/msg/CameraInfo", **fields, **matrices, **more)


def _poses(bag: ros.Bag, at: str, camera: Camera) -> Iterator[Message]:
    t_us, poses = camera.poses()
    for t, place, q in zip(t_us, *position_quaternion(poses), strict=True):
        position = bag.message("geometry_msgs/msg/Point", *place.tolist())
        orientation = bag.message("geometry_msgs/msg/Quaternion", *q.tolist())
        pose = bag.message("geometry_msgs/msg/Pose", position, orientation)
        yield _message(bag, f"{at}/pose", t, "world", "geometry_msgs/msg/PoseStamped", pose=pose)


def _depth(bag: ros.Bag, at: str, camera: Camera) -> Iterator[Message]:
    for i, t in enumerate(camera.truth.times_us):
        z_m = camera.truth.depth(i)[1].astype("<f4")
        yield _image(bag, f"{at}/depthmap", t, camera.name, "32FC1", z_m)


def _flow(bag: ros.Bag, at: str, camera: Camera) -> Iterator[Message]:
    times = camera.truth.times_us
    for i, (t, end) in enumerate(zip(times, times[1:], strict=False)):
        x, y = (
            np.asarray(v, np.float32).ravel() for v in np.moveaxis(camera.truth.flow(i), -1, 0) / ((end - t) * 1e-6)
        )
        fields = {"height": camera.height, "width": camera.width, "flow_x": x, "flow_y": y}
        yield _message(bag, f"{at}/optic_flow", t, camera.name, "esim_msgs/msg/OpticFlow", **fields)


def _imu(bag: ros.Bag, sequence: Sequence, report: Report) -> Iterator[Message]:
    samples = sequence.imu()
    if samples is None:
        report.leave_out("imu", "the sequence has no IMU", sequence.name)
        return iter(())
    return (_imu_message(bag, sample) for sample in samples)


def _imu_message(bag: ros.Bag, sample: NDArray[Any]) -> Message:
    def vector(values: NDArray[Any]) -> Any:
        return bag.message("geometry_msgs/msg/Vector3", *values.tolist())

    unknown = np.array([-1.0, *[0.0] * 8])  # REP 145: no orientation
    fields = {"orientation": bag.message("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)}
    fields |= {"orientation_covariance": unknown, "angular_velocity": vector(sample["gyro"])}
    fields |= {"angular_velocity_covariance": np.zeros(9), "linear_acceleration": vector(sample["accel"])}
    fields |= {"linear_acceleration_covariance": np.zeros(9)}
    return _message(bag, "/imu", float(sample["t_us"]), "imu", "sensor_msgs/msg/Imu", **fields)
