# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera's trajectory in a TUM text file: rows `t_s tx ty tz qx qy qz qw` of world_from_camera, `#` begins a comment.

The world is the scene's, in metres, z up; camera axes are OpenCV's: x right, y down, z forward; t = 0 is the scene's.
Between rows, positions are linear and attitudes slerp. A single row applies to all times.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pecs._errors import bad_input
from pecs._files import sha256
from pecs._poses import interpolate, read_tum

from .timeline import Timeline

SAME_POSE = 1e-6  # metres, or in an entry of a rotation: largest difference between begin and end of a period


@dataclass(frozen=True)
class CameraPath:
    """times_s: [n], increasing. positions_m: [n, 3], quaternions: [n, 4] world_from_camera. sha256: of the file."""

    file: Path
    times_s: np.ndarray
    positions_m: np.ndarray
    quaternions: np.ndarray
    sha256: str

    def world_from_camera(self, t_s: float) -> np.ndarray:
        """[4, 4], metres. Before the first and after the last row, the pose of that row."""
        at = np.clip(t_s, *self.times_s[[0, -1]])
        return interpolate([at], self.times_s, self.positions_m, self.quaternions)[0]

    def check(self, plan: Timeline) -> None:
        """Raises PecsInputError if the path does not cover the plan or, for a period, does not end where it begins."""
        first_ns, last_ns = (round(t * 1e9) for t in self.times_s[[0, -1]])
        begin_ns, end_ns = plan.times_ns[0], plan.bounds_ns[-1]
        if len(self.times_s) > 1 and not (first_ns <= begin_ns and end_ns <= last_ns):
            span = f"{self.times_s[0]:.9g} to {self.times_s[-1]:.9g} s"
            wanted = f"all of {begin_ns * 1e-9:.9g} to {end_ns * 1e-9:.9g} s, the rendered instants"
            raise bad_input(self.file, "times", span, wanted)
        if plan.period_ns:
            begin, end = (self.world_from_camera(ns * 1e-9) for ns in (begin_ns, end_ns))
            if np.abs(end - begin).max() > SAME_POSE:
                raise bad_input(
                    self.file, f"t = {end_ns * 1e-9:.9g} s", "another pose", "the first pose, for one period"
                )


def read_camera_path(file: Path) -> CameraPath:
    return CameraPath(file, *read_tum(file), sha256(file))
