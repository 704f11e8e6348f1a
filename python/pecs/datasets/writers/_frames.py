"""Pictures of an event camera's own pixels: formats of hybrid chips (DAVIS) have one grid for both."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..sequence import Camera, Sequence, frames_of

NO_FRAMES = "no RGB camera has the same pixels (place, lens and size) as the event camera; see beam-splitter rigs"
__all__ = ["NO_FRAMES", "event_cameras", "frames_of", "truth_at"]


def event_cameras(sequence: Sequence) -> Iterator[tuple[str, Camera]]:
    """With a name for their files: the sequence's, and the camera's where there are several."""
    cameras = sequence.of_kind("events")
    for camera in cameras:
        yield sequence.name if len(cameras) == 1 else f"{sequence.name}_{camera.name}", camera


def truth_at(camera: Camera, t_us: float) -> int | None:
    """The truth's instant at a time, to 1 us."""
    if not camera.has_truth:
        return None
    times = camera.truth.times_us
    i = int(np.abs(times - t_us).argmin())
    return i if abs(times[i] - t_us) <= 1 else None
