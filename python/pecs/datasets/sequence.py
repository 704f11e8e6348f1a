"""One sequence of a data set on disk (docs/reference/datasets.md), read strictly and lazily.

    sequence = pecs.datasets.Sequence("SET/sequences/0000")
    left = sequence.cameras["left"]
    events, causes = left.events(), left.causes()
    distance_m, z_m = left.truth.depth(0)              # at left.truth.times_us[0]
    flow_px = left.truth.flow(0)                       # from there to times_us[1]

Only sequence.json is read at once; other files are read when they are used. Sequences may be pickled. Axes: a camera
looks along z, x is right and y down; the world has z up; all metres. `a_from_b` [4, 4] takes points of b to a. K and
the rectification have OpenCV's pixels, whose first centre is at (0, 0); boxes have edges, a first pixel from 0 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._config import Fields
from .._errors import bad_input, existing
from .._poses import interpolate, pose_matrix, position_quaternion, read_euroc_imu, read_tum
from ..events import Events, read
from ..sensor import LABELS
from .event_file import EventFile
from .files import read_array, read_object, read_rows
from .rig import Optics, along, optics, stack_json, transformed
from .tracks import follow
from .truth import Truth

FORMAT = 1
IMU_DTYPE = np.dtype([("t_us", "<f8"), ("gyro", "<f8", 3), ("accel", "<f8", 3)])


@dataclass(frozen=True)
class Frame:
    """An image of an RGB camera, or of a DAVIS. Times are those of the exposure of its middle row [us]."""

    start_us: int
    end_us: int
    path: Path
    sharp_path: Path  # the same instant without motion blur, where the sequence has it (of RGB cameras)

    @property
    def middle_us(self) -> float:
        """Middle of the exposure [us]."""
        return (self.start_us + self.end_us) / 2


class Camera:
    """A camera of the rig. Its recordings are read when they are used; `truth` is its `Truth`."""

    def __init__(self, folder: Path, entry: Fields):
        self._within: set[tuple[Path, int]] = set()  # files, as last changed, whose values were checked
        self.name = entry.file_name("name")
        self.kind = entry.text("kind", choices=("events", "rgb"))
        self.folder = folder / self.name
        # the camera with the path and the truth
        self.pixels_of = entry.optional(entry.file_name, "pixels_of") or self.name
        self._pixels = folder / self.pixels_of
        self.width, self.height = entry.integer("width", low=1), entry.integer("height", low=1)
        self.pixel_pitch_m = entry.number("pixel_pitch_um", low=1e-3) * 1e-6
        self.K, self.K_rect = entry.array("K", 3, 3), entry.array("K_rect", 3, 3)
        self.R_rect = entry.array("R_rect", 3, 3)
        self.distortion = entry.array("distortion", -1)
        self.distortion_model = entry.text("distortion_model", choices=("radtan", "rational"))
        self.rig_from_camera = entry.array("rig_from_camera", 4, 4)
        self.partner = entry.optional(entry.text, "partner")
        self.baseline_m = entry.optional(entry.number, "baseline_m", low=0)
        self.info: dict[str, Any] = entry.content
        if len(self.distortion) not in (4, 5, 8, 12, 14):
            raise entry.wrong("distortion", "4, 5, 8, 12 or 14 coefficients of OpenCV")
        for key in ("R_rect", "rig_from_camera"):
            R = getattr(self, key)[:3, :3]
            if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
                raise entry.wrong(key, "a rotation")

    def __repr__(self) -> str:
        return f"<Camera {self.name!r}: {self.kind}, {self.width}x{self.height}>"

    @property
    def events_path(self) -> Path:
        """The event file, in the layout of DSEC."""
        return self.folder / "events.h5"

    def events(self) -> Events:
        """All events: t [us], x, y [pixels], p."""
        events = read(existing(self.events_path, "the events of an event camera"), "dsec")
        if (events.width, events.height) != (self.width, self.height):
            raise bad_input(self.events_path, "size", (events.width, events.height), f"{(self.width, self.height)}")
        return events

    def event_file(self) -> EventFile:
        """The events by time or index, without reading all of them."""
        return EventFile(existing(self.events_path, "the events of an event camera"))

    def has(self, name: str) -> bool:
        """Whether the events have labels of that name, "causes" or "objects"."""
        return (self.folder / f"{name}.npy").is_file()

    def causes(self) -> NDArray[np.uint8]:
        """The cause of each event, [n] indices into `pecs.sensor.LABELS`."""
        causes = read_array(self.folder / "causes.npy", "the cause of each event", "u1", (-1,))
        return self._per_event(causes, len(LABELS))

    def objects(self) -> NDArray[np.uint16]:
        """The id of the object that the pixel of each event saw at the event's time, [n]; 0: none or unknown."""
        return self._per_event(read_array(self.folder / "objects.npy", "the object of each event", "<u2", (-1,)))

    @cached_property
    def _event_count(self) -> int:
        with self.event_file() as events:
            return len(events)

    def _per_event(self, values: NDArray[Any], limit: int | None = None) -> NDArray[Any]:
        if len(values) != self._event_count:
            raise bad_input(Path(values.filename), "length", len(values), f"{self._event_count}, one for each event")
        path = Path(values.filename)
        if limit and (content := (path, path.stat().st_mtime_ns)) not in self._within:
            if len(values) and values.max() >= limit:
                raise bad_input(path, "greatest value", int(values.max()), f"less than {limit}")
            self._within.add(content)  # checked once: a window of events costs what it contains
        return values

    def rectify_map(self) -> NDArray[np.float32]:
        """Places of the pixels in the undistorted (stereo: rectified) image: [H, W, 2], x and y [pixels] of K_rect."""
        path = self.folder / "rectify_map.npy"
        return read_array(path, "the rectification map", "<f4", (self.height, self.width, 2))

    def poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Poses as rendered: times [n] in us, and world_from_camera [n, 4, 4]."""
        times_us, poses = self._poses
        return times_us.copy(), poses.copy()

    @cached_property
    def _poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return read_poses(self._pixels / "camera_path.txt")

    def poses_at(self, times_us: ArrayLike) -> NDArray[np.float64]:
        """Poses world_from_camera [n, 4, 4] at any times [us], interpolated on the shortest rotation."""
        times, matrices = self.poses()
        return interpolate(times_us, times, *position_quaternion(matrices))

    def scene_flow(self, i: int) -> NDArray[np.float64]:
        """Motion of the surface points at the pixels' centres from instant i of `truth.times_us` to the next.

        [H, W, 3] in m, in the axes of the world; 0 for still surfaces, NaN where it is unknown and where there is no
        surface.
        """
        move = self.truth.layer("motion", i, ("x_end", "y_end", "z", "z_end"))
        y, x = np.mgrid[: self.height, : self.width] + 0.5
        with np.errstate(invalid="ignore"):
            ends = np.stack([x + move[0], y + move[1]], -1)
        directions = self.view.directions, self.view.lens.directions(ends, **self.view.setting)
        poses = self.poses_at(self.truth.times_us[i : i + 2])
        here, there = (transformed(p, along(d, z)) for p, d, z in zip(poses, directions, move[2:], strict=True))
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(there - here), there - here, np.nan)

    def tracks(
        self, points_px: ArrayLike, at_us: float, times_us: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Follow surface points [n, 2] (x and y [pixels], the first pixel's centre at 0) from a time through others.

            positions, seen = camera.tracks([[120.5, 80]], 0, np.arange(0, 100_001, 1000))

        Positions [m, n, 2], also of hidden points and outside the image, and visibility [m, n]. NaN and False for
        objects that deform (`truth.deforming`), for infinite distance, and where no point of either instant comes to
        the pixel. Points follow the poses of their objects and of the camera. Poses of objects are interpolated between
        instants of the truth; a point is visible there if it is at the instants before and after.
        """
        return follow(self, points_px, at_us, times_us)

    def frames(self) -> list[Frame]:
        """The images of an RGB camera, or of a DAVIS whose recipe has `frames`, by time; empty for other cameras."""
        return list(self._frames)

    @cached_property
    def _frames(self) -> list[Frame]:
        is_rgb = self.kind == "rgb"
        path = self.folder / ("rgb.csv" if is_rgb else "frames/exposures.csv")
        if not path.exists():
            return []
        out: list[Frame] = []
        for number, (index, start, end) in enumerate(read_rows(path, ("index", "start_us", "end_us"), "frames"), 2):
            if index != len(out) or end < start or (out and start < out[-1].start_us):
                raise bad_input(
                    path, f"line {number}", (index, start, end), f"index {len(out)}, times that do not fall"
                )
            name = f"{index:06d}.png"
            own = self.folder / (f"rgb/{name}" if is_rgb else f"frames/images/frame_{index:08d}.png")
            picture = existing(own, f"the picture of {path}: line {number}")
            out.append(Frame(start, end, picture, self.folder / "sharp" / name))
        return out

    @property
    def has_truth(self) -> bool:
        """Whether the camera has ground truth."""
        return (self._pixels / "truth" / "stack.json").is_file()

    @property
    def has_boxes(self) -> bool:
        """Whether the ground truth contains objects."""
        return self.has_truth and (self._pixels / "truth" / "objects.json").is_file()

    @property
    def stack_folder(self) -> Path:
        """Its light, if the set keeps it."""
        return (self.folder if self.kind == "rgb" else self._pixels) / "stack"

    @cached_property
    def view(self) -> Optics:
        """Its lens, with the settings of the ground truth."""
        return optics(stack_json(self.truth.folder), self.info["lens"], self.K)

    @cached_property
    def truth(self) -> Truth:
        """Depth, flow, objects … at instants of this camera; behind a beam splitter those of its partner's pixels."""
        return Truth(self._pixels / "truth", self.width, self.height)


class Sequence:
    """A sequence of a data set: a folder with sequence.json, whose content is `info`; `cameras` are by name."""

    def __init__(self, folder: str | PathLike[str]):
        self.folder = Path(folder)
        path = self.folder / "sequence.json"
        self.info = read_object(path, "a sequence of a data set")
        fields = Fields(self.info, path)
        if fields.integer("format") != FORMAT:
            raise fields.wrong("format", f"{FORMAT}")
        self.name, self.split = fields.file_name("name"), fields.file_name("split")
        self.duration_us = fields.integer("duration_us", low=1)
        self.cameras: dict[str, Camera] = {}
        for entry in fields.tables("cameras"):
            camera = Camera(self.folder, entry)
            if camera.name.casefold() in {name.casefold() for name in self.cameras}:  # folders of every disk differ
                raise entry.wrong("name", "a name that no other camera has")
            self.cameras[camera.name] = camera
        for camera in self.cameras.values():
            self._check_partner(path, camera)

    def _check_partner(self, path: Path, camera: Camera) -> None:
        owner, other, wanted = self.cameras.get(camera.pixels_of), self.cameras.get(camera.partner or ""), {}
        if owner is None or not same_pixels(owner, camera):
            wanted["pixels_of"] = "a camera of the same place, lens and size"
        elif camera.partner and (other is None or other is camera or other.partner != camera.name):
            wanted["partner"] = "a camera whose partner is this one"
        elif other and (not camera.baseline_m or camera.baseline_m != other.baseline_m):
            wanted["baseline_m"] = "metres, the same for both partners"
        for key, text in wanted.items():
            raise bad_input(path, f"camera {camera.name}: {key}", getattr(camera, key), text)

    def __repr__(self) -> str:
        return f"<Sequence {self.name!r}: {self.duration_us / 1e6:g} s, {', '.join(self.cameras)}>"

    def of_kind(self, kind: str) -> list[Camera]:
        """The cameras of a kind ("events" or "rgb"), in the order of sequence.json."""
        return [camera for camera in self.cameras.values() if camera.kind == kind]

    def stereo_pairs(self, kind: str = "events") -> list[tuple[Camera, Camera]]:
        """The stereo pairs (left, right) of a kind, "events" or "rgb": the right one's centre has the greater x in the
        rectified image."""
        pairs = []
        for camera in self.of_kind(kind):
            other = self.cameras.get(camera.partner or "")
            if other is not None and rect_from_rect(camera, other)[0, 3] > 0:
                pairs.append((camera, other))
        return pairs

    def poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Poses of the rig: times [n] in us, and world_from_rig [n, 4, 4]."""
        return read_poses(self.folder / "poses.txt")

    def imu(self) -> NDArray[Any] | None:
        """The samples of the IMU (`IMU_DTYPE`): t_us; gyro [rad/s] and accel [m/s^2, specific force] in the axes of the
        IMU. None without an IMU."""
        if self.info.get("imu") is None:
            return None
        t_ns, gyro, accel = read_euroc_imu(existing(self.folder / "imu.csv", "the IMU's samples"))
        out = np.zeros(len(t_ns), IMU_DTYPE)
        out["t_us"], out["gyro"], out["accel"] = t_ns / 1e3, gyro, accel
        return out


def rig_from_imu(sequence: Sequence) -> NDArray[np.float64]:
    """[4, 4]."""
    return Fields(sequence.info["imu"], sequence.folder / "sequence.json").array("rig_from_imu", 4, 4)


def same_pixels(a: Camera, b: Camera) -> bool:
    """Whether pixels of both cameras see the same, as behind a beam splitter."""
    if (a.width, a.height) != (b.width, b.height) or len(a.distortion) != len(b.distortion):
        return False
    pairs = ((a.K, b.K), (a.distortion, b.distortion), (a.rig_from_camera, b.rig_from_camera))
    return all(np.allclose(x, y, rtol=1e-9, atol=1e-9) for x, y in pairs)


def frames_of(sequence: Sequence, camera: Camera) -> list[Frame]:
    """A camera's own pictures, or those of the RGB camera that shares an event camera's pixels; [] without any."""
    if frames := camera.frames():
        return frames
    for other in sequence.of_kind("rgb"):
        if same_pixels(camera, other):
            return other.frames()
    return []


def rect_from_rect(camera: Camera, other: Camera) -> NDArray[np.float64]:
    """Pose of another camera's rectified frame in that of this one [4, 4]."""
    camera_from_other = np.linalg.inv(camera.rig_from_camera) @ other.rig_from_camera
    rect_from_camera, rect_from_other = np.eye(4), np.eye(4)
    rect_from_camera[:3, :3], rect_from_other[:3, :3] = camera.R_rect, other.R_rect
    return rect_from_camera @ camera_from_other @ rect_from_other.T


def read_poses(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A file of TUM rows `t_s tx ty tz qx qy qz qw`: times [n] in us and poses [n, 4, 4]."""
    t_s, positions_m, quaternions = read_tum(existing(path, "poses"))
    return np.round(t_s * 1e9) / 1e3, pose_matrix(positions_m, quaternions)


def sequences(folder: str | PathLike[str], split: str | None = None) -> list[Sequence]:
    """Open the complete sequences of a data set in its order: all, or those of a `split` such as "train"."""
    found = sorted(existing(Path(folder) / "sequences", "a data set").glob("*/sequence.json"))
    opened = (Sequence(path.parent) for path in found if path.parent.suffix != ".partial")
    return [s for s in opened if split in (None, s.split)]
