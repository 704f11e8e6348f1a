"""Boxes of objects that have a class, under class numbers that hold for a whole set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ..sequence import Camera, Sequence


@dataclass(frozen=True)
class Box:
    """In px, edges of pixels; `track` is the object's id, `name` its class."""

    x: float
    y: float
    w: float
    h: float
    name: str
    track: int
    visible_px: int
    occluded: float
    truncated: float
    amodal: tuple[float, float, float, float]  # x, y, w, h


def boxes(camera: Camera, i: int) -> Iterator[Box]:
    """Of what is seen at an instant of the truth, of objects with a class."""
    truth = camera.truth
    for row in truth.boxes(i):
        if row["class_id"] == 0 or not row["visible_px"]:
            continue
        x0, y0, x1, y1 = (float(row[k]) for k in ("x0", "y0", "x1", "y1"))
        a0, b0, a1, b1 = (float(row["amodal_" + k]) for k in ("x0", "y0", "x1", "y1"))
        yield Box(
            *(x0, y0, x1 - x0, y1 - y0),
            truth.classes[int(row["class_id"])],
            int(row["id"]),
            *(int(row["visible_px"]), float(row["occluded"]), float(row["truncated"])),
            (a0, b0, a1 - a0, b1 - b0),
        )


def class_numbers(sequences: Iterable[Sequence], known: tuple[str, ...] = (), first: int = 0) -> dict[str, int]:
    """{class: number}: names in `known` by their place there, others behind them by name."""
    names = {
        name
        for sequence in sequences
        for camera in sequence.cameras.values()
        if camera.has_boxes
        for name in camera.truth.classes.values()
    }
    order = [*known, *sorted(names - set(known))]
    return {name: first + i for i, name in enumerate(order)}
