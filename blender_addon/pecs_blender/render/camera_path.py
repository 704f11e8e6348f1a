# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera's path in a TUM text file: rows `t_s tx ty tz qx qy qz qw` of world_from_camera, `#` begins a comment.

The world is the scene's, in metres, z up; camera axes are OpenCV's: x right, y down, z forward; t = 0 is the scene's.
Between two rows the position goes along a straight line and the attitude along the shortest turn (slerp). One row alone
stands for all times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
from pecs._errors import bad_input
from pecs._files import read_text

from .timeline import Timeline

MAX_BYTES = 1 << 28
UNIT = 1e-3  # how far a quaternion's length may be from 1
SAME = 1e-6  # metres, or in an entry of a rotation: a path that comes back to its begin


@dataclass(frozen=True)
class CameraPath:
    """times_s: [n], rising. positions_m: [n, 3]. quaternions: [n, 4], x y z w, unit. sha256: of the file."""

    file: Path
    times_s: np.ndarray
    positions_m: np.ndarray
    quaternions: np.ndarray
    sha256: str

    def world_from_camera(self, t_s: float) -> np.ndarray:
        """[4, 4], metres; the nearest row's before the first and after the last."""
        last = len(self.times_s) - 1
        i = int(np.clip(np.searchsorted(self.times_s, t_s, "right") - 1, 0, max(0, last - 1)))
        j = min(i + 1, last)
        f = float(np.clip((t_s - self.times_s[i]) / (self.times_s[j] - self.times_s[i]), 0, 1)) if j > i else 0.0
        matrix = np.eye(4)
        matrix[:3, :3] = _rotation(_slerp(self.quaternions[i], self.quaternions[j], f))
        matrix[:3, 3] = (1 - f) * self.positions_m[i] + f * self.positions_m[j]
        return matrix

    def check(self, plan: Timeline) -> None:
        """That it covers a plan, and comes back where that repeats."""
        first_ns, last_ns = (round(t * 1e9) for t in self.times_s[[0, -1]])
        begin_ns, end_ns = plan.times_ns[0], plan.bounds_ns[-1]
        if len(self.times_s) > 1 and not (first_ns <= begin_ns and end_ns <= last_ns):
            span = f"{self.times_s[0]:.9g} to {self.times_s[-1]:.9g} s"
            wanted = f"all of {begin_ns * 1e-9:.9g} to {end_ns * 1e-9:.9g} s, the instants that are rendered"
            raise bad_input(self.file, "times", span, wanted)
        if plan.period_ns:
            begin, end = (self.world_from_camera(ns * 1e-9) for ns in (begin_ns, end_ns))
            if np.abs(end - begin).max() > SAME:
                raise bad_input(self.file, f"t = {end_ns * 1e-9:.9g} s", "another pose", "the first, for one period")


def read_camera_path(file: Path) -> CameraPath:
    text = read_text(file, MAX_BYTES, "text")
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        if words := line.partition("#")[0].split():
            rows.append(_row(file, f"line {number}", words, rows[-1][0] if rows else -math.inf))
    if not rows:
        raise bad_input(file, "", "no row", "rows t_s tx ty tz qx qy qz qw")
    table = np.array(rows)
    unit = table[:, 4:] / np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
    return CameraPath(file, table[:, 0], table[:, 1:4], unit, sha256(text.encode()).hexdigest())


def _row(file: Path, place: str, words: list[str], after_s: float) -> list[float]:
    if len(words) != 8:
        raise bad_input(file, place, f"{len(words)} values", "8: t_s tx ty tz qx qy qz qw")
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise bad_input(file, place, repr(word[:40]), "a finite number")
        values.append(value)
    if values[0] <= after_s:
        raise bad_input(file, place, f"t_s = {words[0][:40]}", f"more than {after_s:.12g}, the row's before")
    if not abs((length := math.hypot(*values[4:])) - 1) <= UNIT:
        raise bad_input(file, place, f"a quaternion of length {length:.6g}", f"1 within {UNIT:g}")
    return values


def _slerp(a: np.ndarray, b: np.ndarray, f: float) -> np.ndarray:
    """Shoemake 1985; along the shorter way."""
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    angle = math.atan2(float(np.linalg.norm(b - cosine * a)), cosine)
    if angle < 1e-9:
        return a
    return (math.sin((1 - f) * angle) * a + math.sin(f * angle) * b) / math.sin(angle)


def _rotation(q: np.ndarray) -> np.ndarray:
    """[3, 3] of x y z w."""
    x, y, z, w = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
