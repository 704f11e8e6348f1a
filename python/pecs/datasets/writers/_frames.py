"""Pictures of an event camera's own pixels: formats of hybrid chips (DAVIS) have one grid for both."""

from __future__ import annotations

import numpy as np

from ..sequence import Camera, frames_of

NO_FRAMES = "no RGB camera has the same pixels (place, lens and size) as the event camera; see beam-splitter rigs"
__all__ = ["NO_FRAMES", "frames_of", "truth_at"]


def truth_at(camera: Camera, t_us: float) -> int | None:
    """The truth's instant at a time, to 1 us."""
    if not camera.has_truth:
        return None
    times = camera.truth.times_us
    i = int(np.abs(times - t_us).argmin())
    return i if abs(times[i] - t_us) <= 1 else None
