"""Pictures of an event camera's own pixels: formats of hybrid chips (DAVIS) have one grid for both."""

from __future__ import annotations

import numpy as np

from ..sequence import Camera, Frame, Sequence

NO_FRAMES = "no RGB camera has the same pixels (place, lens and size) as the event camera; see beam-splitter rigs"


def same_pixels(a: Camera, b: Camera) -> bool:
    """Whether a pixel of one sees what that of the other sees."""
    if (a.width, a.height) != (b.width, b.height) or len(a.distortion) != len(b.distortion):
        return False
    pairs = ((a.K, b.K), (a.distortion, b.distortion), (a.rig_from_camera, b.rig_from_camera))
    return all(np.allclose(x, y, rtol=1e-9, atol=1e-9) for x, y in pairs)


def frames_of(sequence: Sequence, camera: Camera) -> list[Frame]:
    """The pictures of the RGB camera that shares the event camera's pixels; [] without one."""
    for other in sequence.of_kind("rgb"):
        if same_pixels(camera, other):
            return other.frames()
    return []


def truth_at(camera: Camera, t_us: float) -> int | None:
    """The truth's instant at a time, to 1 us."""
    if not camera.has_truth:
        return None
    times = camera.truth.times_us
    i = int(np.abs(times - t_us).argmin())
    return i if abs(times[i] - t_us) <= 1 else None
