"""Parts that the writers share: the report, cameras of events with their pictures, boxes of objects that have a
class."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import PecsInputError
from ..sequence import Camera, Frame, Sequence, frames_of
from ..truth import STUFF

# Classes by the names of the lists of DSEC-Detection and Prophesee.
ALIASES = {
    "person": ("pedestrian",),
    "lorry": ("truck",),
    "motorbike": ("motorcycle", "two wheeler"),
    **dict.fromkeys(("bicycle", "motorcycle", "rider"), ("two wheeler",)),
    **{name: (name.replace("_", " "),) for name in ("traffic_sign", "traffic_light")},
}
NO_FRAMES = "the event camera takes no frames (frames), and no RGB camera has its pixels (pixels_of)"


class Report:
    """Counts of what was written and what was left out. `count` sums numbers per sequence; `leave_out` lists each
    reason once. sequence "": of all."""

    def __init__(self, left_out: Mapping[str, str] | None = None) -> None:
        """left_out: {what: why} of every sequence."""
        self.sequences: dict[str, dict[str, Any]] = {}
        self.left_out: dict[tuple[str, str], list[str]] = {key: [] for key in (left_out or {}).items()}
        self.more: dict[str, Any] = {}

    def count(self, sequence: str, **numbers: int) -> None:
        counts = self.sequences.setdefault(sequence, {})
        for key, number in numbers.items():
            counts[key] = counts.get(key, 0) + int(number)

    def leave_out(self, what: str, why: str, sequence: str) -> None:
        names = self.left_out.setdefault((what, why), [])
        if sequence and sequence not in names:
            names.append(sequence)

    def as_dict(self) -> dict[str, Any]:
        left = [
            {"what": what, "why": why} | ({"sequences": names} if names else {})
            for (what, why), names in self.left_out.items()
        ]
        return {"sequences": self.sequences, "left_out": left, **self.more}


def event_cameras(sequence: Sequence) -> Iterator[tuple[str, Camera]]:
    """Event cameras with a name for their files: the sequence's, and the camera's where there are several."""
    cameras = sequence.of_kind("events")
    for camera in cameras:
        yield sequence.name if len(cameras) == 1 else f"{sequence.name}_{camera.name}", camera


def with_pictures(
    format: str, sequences: list[Sequence], report: Report
) -> Iterator[tuple[Sequence, str, Camera, list[Frame]]]:
    """Event cameras as of `event_cameras`, with the pictures of their pixels, for a format whose reader requires them.
    Cameras without are left out; raises PecsInputError if that are all."""
    for sequence in sequences:
        for name, camera in event_cameras(sequence):
            if frames := frames_of(sequence, camera):
                yield sequence, name, camera, frames
            else:
                report.leave_out(f"camera {camera.name}", NO_FRAMES, sequence.name)
    if not report.sequences:
        raise PecsInputError(f"{format}: {NO_FRAMES}")


def truth_at(camera: Camera, t_us: float) -> int | None:
    """Index of the truth's instant within 1 us of a time."""
    if not camera.has_truth:
        return None
    times = camera.truth.times_us
    i = int(np.abs(times - t_us).argmin())
    return i if abs(times[i] - t_us) <= 1 else None


def four(K: NDArray[np.float64]) -> list[float]:
    """fx fy cx cy."""
    return [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]


@dataclass(frozen=True)
class Box:
    """In px, edges of pixels; `track` is the object's id, `name` its class."""

    x: float
    y: float
    w: float
    h: float
    name: str
    track: int
    occluded: float
    truncated: float
    amodal: tuple[float, float, float, float]  # x, y, w, h


def boxes(camera: Camera, i: int) -> Iterator[Box]:
    """Visible objects at an instant of the truth whose class is one of things (not of `STUFF`)."""
    truth = camera.truth
    for row in truth.boxes(i):
        name = truth.classes.get(int(row["class_id"]))
        if name is None or name in STUFF or not row["visible_px"]:
            continue
        x0, y0, x1, y1 = (float(row[k]) for k in ("x0", "y0", "x1", "y1"))
        a0, b0, a1, b1 = (float(row["amodal_" + k]) for k in ("x0", "y0", "x1", "y1"))
        yield Box(
            *(x0, y0, x1 - x0, y1 - y0),
            name,
            int(row["id"]),
            *(float(row["occluded"]), float(row["truncated"])),
            (a0, b0, a1 - a0, b1 - b0),
        )


def class_numbers(sequences: Iterable[Sequence], known: tuple[str, ...] = (), first: int = 0) -> dict[str, int]:
    """{class: number} for a whole set: names in `known` by their place there, others after them by name."""
    cameras = [camera for sequence in sequences for camera in sequence.cameras.values() if camera.has_boxes]
    names = {name for camera in cameras for name in camera.truth.classes.values()} - STUFF
    same = {name: also for name in sorted(names - {*known}) for also in ALIASES.get(name, ()) if also in known}
    numbers = {name: first + i for i, name in enumerate([*known, *sorted(names - {*known, *same})])}
    return numbers | {name: numbers[also] for name, also in same.items()}


def report_unread(report: Report, numbers: Mapping[str, int], read: int, reader: str) -> None:
    """Lists the classes whose numbers, from `read` on, a format's own reader drops."""
    for name, number in numbers.items():
        if number >= read:
            report.leave_out(
                f"class {name} for {reader}", f"it reads classes 0 to {read - 1}; this one is {number}", ""
            )
