"""Poses: rotations, interpolation, and the files of TUM and EuRoC, which read back bit by bit. The renderer reads and
interpolates camera paths with it in Blender, whose Python has no SciPy.

Quaternions are (x y z w), world_from_body; [4, 4] matrices map body points to the world. TUM rows are
`t_s tx ty tz qx qy qz qw`; EuRoC csv has nanoseconds and the quaternion's w first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import PecsInputError, bad_input, existing, shown
from ._files import read_text, write_text

TUM_HEADER = "# t_s tx ty tz qx qy qz qw"
EUROC_IMU_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
EUROC_POSE_HEADER = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
MAX_BYTES = 1 << 28
UNIT_TOLERANCE = 1e-2  # of a quaternion's length: files have few digits


def matrix_from_quaternion(q: ArrayLike) -> NDArray[np.float64]:
    """[..., 3, 3] of [..., 4] (x y z w), of any length but 0."""
    q = np.asarray(q, float)
    x, y, z, w = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def pose_matrix(positions_m: ArrayLike, quaternions: ArrayLike) -> NDArray[np.float64]:
    """[..., 4, 4] of positions [..., 3] and quaternions [..., 4]."""
    positions_m = np.asarray(positions_m, float)
    m = np.zeros((*positions_m.shape[:-1], 4, 4))
    m[..., :3, :3] = matrix_from_quaternion(quaternions)
    m[..., :3, 3] = positions_m
    m[..., 3, 3] = 1
    return m


def position_quaternion(matrices: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions [n, 3] and quaternions [n, 4] with w >= 0 of [n, 4, 4]; requires SciPy."""
    from scipy.spatial.transform import Rotation

    matrices = np.asarray(matrices, float)
    return matrices[:, :3, 3].copy(), Rotation.from_matrix(matrices[:, :3, :3]).as_quat(canonical=True)


def slerp(q0: ArrayLike, q1: ArrayLike, fraction: ArrayLike) -> NDArray[np.float64]:
    """[..., 4]: the shorter great circle from q0 to q1 at constant rate (Shoemake 1985)."""
    q0, q1, f = np.asarray(q0, float), np.asarray(q1, float), np.asarray(fraction, float)[..., None]
    cosine = (q0 * q1).sum(axis=-1, keepdims=True)
    q1 = np.where(cosine < 0, -q1, q1)
    angle = np.arctan2(
        np.linalg.norm(q1 - q0, axis=-1, keepdims=True) / 2, np.linalg.norm(q1 + q0, axis=-1, keepdims=True) / 2
    )
    sine = np.sin(2 * angle)
    near = sine < 1e-9
    a = np.where(near, 1 - f, np.sin((1 - f) * 2 * angle) / np.where(near, 1, sine))
    b = np.where(near, f, np.sin(f * 2 * angle) / np.where(near, 1, sine))
    q = a * q0 + b * q1
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def interpolate(
    at: ArrayLike, times: ArrayLike, positions: NDArray[np.float64], quaternions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Poses [m, 4, 4] at `at` [m] between positions [n, 3] and quaternions [n, 4] at increasing timestamps [n], in the
    same unit: positions linear, rotations slerp. Raises PecsInputError outside the timestamps."""
    at, times = np.asarray(at, float), np.asarray(times, float)
    if at.size and (at.min() < times[0] or at.max() > times[-1]):
        raise PecsInputError(
            f"poses: got {at.min():g} to {at.max():g}, wanted times within {times[0]:g} to {times[-1]:g}"
        )
    i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, max(len(times) - 2, 0))
    j = np.minimum(i + 1, len(times) - 1)
    f = (at - times[i]) / np.where(j > i, times[j] - times[i], 1.0)
    place = positions[i] + f[:, None] * (positions[j] - positions[i])
    return pose_matrix(place, slerp(quaternions[i], quaternions[j], f))


# Files


def write_tum(path: str | PathLike, t_s: ArrayLike, positions_m: ArrayLike, quaternions: ArrayLike) -> None:
    """Poses at t_s [n]: positions [n, 3], quaternions [n, 4]. Numbers have as many digits as they need."""
    rows = np.column_stack([np.asarray(v, float) for v in (t_s, positions_m, quaternions)])
    write_text(Path(path), "\n".join([TUM_HEADER, *(" ".join(map(repr, row)) for row in rows.tolist())]) + "\n")


def read_tum(path: str | PathLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """t_s [n], positions_m [n, 3], quaternions [n, 4] of length 1. Raises PecsInputError with file and line."""
    rows = _table(Path(path), None, 8, TUM_HEADER[2:])
    return rows[:, 0], rows[:, 1:4], _unit_quaternions(Path(path), rows[:, 4:8])


def read_euroc_poses(path: str | PathLike) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """t_ns [n], positions_m [n, 3], quaternions [n, 4] (x y z w) of state_groundtruth_estimate0/data.csv; velocities
    and biases that follow are left out."""
    rows = _table(Path(path), ",", 8, EUROC_POSE_HEADER[1:], more=True)
    return _nanoseconds(Path(path)), rows[:, 1:4], _unit_quaternions(Path(path), rows[:, [5, 6, 7, 4]])


def write_euroc_imu(path: str | PathLike, t_ns: ArrayLike, gyro_rad_s: ArrayLike, accel_m_s2: ArrayLike) -> None:
    """imu0/data.csv: angular rate [n, 3] and specific force [n, 3] at t_ns [n]."""
    rows = np.column_stack([np.asarray(v, float) for v in (gyro_rad_s, accel_m_s2)]).tolist()
    times = np.asarray(t_ns).astype(np.int64).tolist()
    lines = [",".join([str(t), *map(repr, row)]) for t, row in zip(times, rows, strict=True)]
    write_text(Path(path), "\n".join([EUROC_IMU_HEADER, *lines]) + "\n")


def read_euroc_imu(path: str | PathLike) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """t_ns [n], gyro_rad_s [n, 3], accel_m_s2 [n, 3]."""
    rows = _table(Path(path), ",", 7, EUROC_IMU_HEADER[1:])
    return _nanoseconds(Path(path)), rows[:, 1:4], rows[:, 4:7]


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of every line with content; `#` begins a comment."""
    text = read_text(existing(path, "a file of poses or of an IMU"), MAX_BYTES)
    for number, line in enumerate(text.splitlines(), 1):
        if content := line.partition("#")[0].strip():
            yield number, content


def _table(path: Path, comma: str | None, columns: int, names: str, more: bool = False) -> NDArray[np.float64]:
    """Rows of finite numbers, the first (a time) rising."""
    rows: list[list[float]] = []
    for number, line in _lines(path):
        words = line.split(comma)
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if not (len(row) == columns or more and len(row) > columns) or not all(map(math.isfinite, row)):
            raise bad_input(path, f"line {number}", shown(line), f"{columns} finite numbers: {names}")
        if rows and row[0] <= rows[-1][0]:
            raise bad_input(path, f"line {number}: time", shown(words[0]), "a time after the one before")
        rows.append(row[:columns])
    if not rows:
        raise bad_input(path, "rows", 0, f"at least one of {names}")
    return np.array(rows)


def _nanoseconds(path: Path) -> NDArray[np.int64]:
    """The first column as integers: a double has too few digits for nanoseconds since 1970."""
    times = []
    for number, line in _lines(path):
        word = line.split(",")[0].strip()
        if not (word.isascii() and word.isdecimal() and int(word[:20]) < 1 << 63):
            raise bad_input(path, f"line {number}: time", shown(word), "whole nanoseconds")
        times.append(int(word))
    return np.array(times, np.int64)


def _unit_quaternions(path: Path, q: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(q, axis=1)
    wrong = np.flatnonzero(np.abs(length - 1) > UNIT_TOLERANCE)
    if len(wrong):
        number = [n for n, _ in _lines(path)][wrong[0]]
        raise bad_input(
            path, f"line {number}: length of the quaternion", float(length[wrong[0]]), f"1 within {UNIT_TOLERANCE:g}"
        )
    exact = np.abs(length - 1) < 1e-12  # as written: bits stay
    return np.where(exact[:, None], q, q / length[:, None])
