"""A camera's motion: its clock, and pose and derivatives at any time. trajectories.py draws motions.

World: z up, metres. Body: the camera's axes, x right, y down, z ahead (OpenCV). A path has two clocks: `clock` stands
still in pauses and otherwise runs as time does (shake follows it), `way` runs `speed` times as fast (the motion along
the path follows it).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, PPoly, make_interp_spline, make_lsq_spline
from scipy.spatial.transform import Rotation

from .. import _poses as poses
from .._errors import PecsInputError

GRAVITY_M_S2 = 9.80665  # standard gravity, 3rd CGPM 1901
RATE_HZ = 1000  # of the samples that a trajectory interpolates; tremor ends at 12 Hz
MAX_SAMPLES = 1 << 20

Array = NDArray[np.float64]
# (t_s, clock_s, way_s), [n] each, evenly spaced -> positions [n, 3] in m, world_from_body
Path = Callable[[Array, Array, Array], tuple[Array, Rotation]]


@dataclass(frozen=True)
class Clock:
    """How time runs along a path. pauses: (start_s, length_s), times in which everything stands; before and after each,
    in ramp_s, it comes to rest and starts again (the rate is a polynomial of degree 7 whose first three derivatives
    vanish at its ends). speed: the factor at the beginning and at the end, exponential in between."""

    duration_s: float
    pauses: tuple[tuple[float, float], ...] = ()
    ramp_s: float = 0.1
    speed: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self):
        for (start, length), (following, _) in zip(self.pauses, self.pauses[1:], strict=False):
            if following - start - length < 2 * self.ramp_s * (1 - 1e-9):
                raise PecsInputError(
                    f"pauses: got {start:g} s + {length:g} s, then {following:g} s, wanted {2 * self.ramp_s:g} s apart"
                )

    @property
    def way_s(self) -> float:
        """Length of the way at the end [s]."""
        return float(self(self.duration_s)[1])

    def __call__(self, t_s: ArrayLike) -> tuple[Array, Array]:
        """Clock and way [s] at times [s]."""
        clock, growth = self._pieces(t_s) - self._pieces(0.0), self._growth_per_s
        return clock, self.speed[0] * (np.expm1(growth * clock) / growth if growth else clock)

    def rates(self, t_s: Array) -> tuple[Array, Array]:
        """First and second derivative of the way [1, 1/s]."""
        rate, change = self._pieces(t_s, 1), self._pieces(t_s, 2)
        speed = self.speed[0] * np.exp(self._growth_per_s * self(t_s)[0])
        return speed * rate, speed * (change + self._growth_per_s * rate**2)

    @cached_property
    def _growth_per_s(self) -> float:
        """Derivative of the logarithm of the speed, over the clock."""
        end = float(self._pieces(self.duration_s) - self._pieces(0.0))
        growth = math.log(self.speed[1] / self.speed[0])
        return growth / end if end and abs(growth) >= 1e-9 else 0.0

    @cached_property
    def _pieces(self) -> PPoly:
        # The integral of S(u) = 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7; it is 1/2 at u = 1.
        rise = np.array([-2.5, 10.0, -14.0, 7.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        powers = np.arange(8, -1, -1)
        run, stand = np.zeros(9), np.zeros(9)
        run[7] = 1
        up = rise * self.ramp_s ** (1.0 - powers)
        down = run - up
        breaks, columns, value = [min([0.0, *(start - self.ramp_s for start, _ in self.pauses)]) - 1.0], [run], 0.0
        for start, length in self.pauses:
            value += start - self.ramp_s - breaks[-1]
            for at, piece, gain in (
                (start - self.ramp_s, down, self.ramp_s / 2),
                (start, stand, 0.0),
                (start + length, up, self.ramp_s / 2),
                (start + length + self.ramp_s, run, 0.0),
            ):
                piece = piece.copy()
                piece[8] = value
                value += gain
                breaks.append(at)
                columns.append(piece)
        return PPoly(np.array(columns).T, [*breaks, breaks[-1] + 1.0])

    @property
    def breaks_s(self) -> Array:
        """Ends of the parts in which the clock is one polynomial, from 0 to the duration [s]."""
        inner = self._pieces.x[1:-1]
        return np.unique([0.0, *inner[(inner > 0) & (inner < self.duration_s)], self.duration_s])


@dataclass(frozen=True)
class State:
    """A trajectory at n times: vectors [n, 3], positions in world coordinates and angles in body coordinates, and
    rotation matrices [n, 3, 3]."""

    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    world_from_body: Array
    angular_velocity_rad_s: Array
    angular_acceleration_rad_s2: Array


class Trajectory:
    """Pose and exact derivatives at any time of a path. `plan` makes trajectories.

    It is a spline of degree 5 through 1000 poses a second of the path, one for each polynomial of the clock. The body's
    axes are x right, y down, z ahead; the world's z is up. Methods raise PecsInputError for times t_s [n] outside 0 to
    duration_s [s]. `kind` and the values that were `drawn` are for records.
    """

    def __init__(self, path: Path, clock: Clock, kind: str = "", drawn: dict | None = None):
        self.clock, self.kind, self.drawn = clock, kind, drawn or {}
        self._breaks = clock.breaks_s
        self._parts = [_part(path, clock, *ends) for ends in zip(self._breaks, self._breaks[1:], strict=False)]

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.clock.duration_s

    def state(self, t_s: ArrayLike) -> State:
        """Return pose, velocities and accelerations."""
        (p, q), (dp, dq), (ddp, ddq) = (self._rows(t_s, k) for k in range(3))
        # q' = q w / 2 with w in body coordinates, for quaternions of any length
        square = (q * q).sum(axis=1, keepdims=True)
        w, dw = (2 * _conjugate_product(q, d) / square for d in (dq, ddq))
        dw -= w * 2 * (q * dq).sum(axis=1, keepdims=True) / square
        return State(p, dp, ddp, poses.matrix_from_quaternion(q), w, dw)

    def positions(self, t_s: ArrayLike) -> Array:
        """Return positions [n, 3] in m, in world coordinates."""
        return self._rows(t_s)[0]

    def pose(self, t_s: ArrayLike) -> tuple[Array, Array]:
        """Return positions [n, 3] in m, and unit quaternions [n, 4] (x y z w) of world_from_body."""
        position, quaternion = self._rows(t_s)
        return position, Rotation.from_quat(quaternion).as_quat(canonical=True)

    def matrices(self, t_s: ArrayLike) -> Array:
        """Return world_from_body [n, 4, 4], translations in m."""
        return poses.pose_matrix(*self._rows(t_s))

    def _rows(self, t_s: ArrayLike, derivative: int = 0) -> tuple[Array, Array]:
        """Positions [n, 3] and quaternions [n, 4], or a derivative of them."""
        t = np.atleast_1d(np.asarray(t_s, float))
        if t.size and not (t.min() >= -1e-9 and t.max() <= self.duration_s + 1e-9):
            raise PecsInputError(f"times: got {t.min():g} to {t.max():g} s, wanted within 0 to {self.duration_s:g} s")
        t = np.clip(t, 0.0, self.duration_s)
        part = np.searchsorted(self._breaks[1:-1], t)
        rows = np.empty((len(t), 7))
        for k, (first, spline) in enumerate(self._parts):
            rows[part == k] = spline(t[part == k], derivative) + (first if derivative == 0 else 0.0)
        return rows[:, :3], rows[:, 3:]


def _part(path: Path, clock: Clock, start_s: float, end_s: float) -> tuple[Array, BSpline]:
    """The first row (position, quaternion), and a spline of the differences from it: zero where the clock stands."""
    wanted = math.ceil((end_s - start_s) * RATE_HZ * max(1.0, *clock.speed))
    t = np.linspace(start_s, end_s, min(max(wanted, 32), MAX_SAMPLES) + 1)
    position, rotation = path(t, *clock(t))
    rows = np.concatenate([position, of_one_sign(rotation.as_quat())], axis=1)
    return rows[0], make_interp_spline(t, rows - rows[0], 5)


def _conjugate_product(a: Array, b: Array) -> Array:
    """The vector part [n, 3] of conj(a) b."""
    return a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])


# Parts of paths


def of_one_sign(q: Array) -> Array:
    """Quaternions [n, 4] without jumps from q to -q."""
    flips = np.cumprod(np.where((q[1:] * q[:-1]).sum(axis=1) < 0, -1, 1))
    return q * np.concatenate([[1], flips])[:, None]


def spline(t: ArrayLike, values: ArrayLike, degree: int, knot_s: float | None = None) -> BSpline:
    """A spline of `degree` (odd), degree - 1 times continuously differentiable, through values [n, m] at t [n]; with
    knot_s, the one with knots that far apart that comes nearest (least squares).

    Interpolating ones are natural: derivatives (degree + 1)/2 … degree - 1 vanish at the ends. Of all functions through
    the points, that has the least integral of the squared derivative (degree + 1)/2: degree 7 is the minimum snap
    (Mellinger & Kumar 2011) of a flight cut out of a longer one.
    """
    t, values = np.asarray(t, float), np.asarray(values, float)
    if knot_s is not None and (inner := round((t[-1] - t[0]) / knot_s)) * 2 < len(t) - degree:
        knots = np.linspace(t[0], t[-1], max(inner, 1) + 1)
        return make_lsq_spline(t, values, np.r_[[t[0]] * degree, knots, [t[-1]] * degree], degree)
    if len(t) < (degree + 1) // 2:  # a polynomial through so few points has no such derivatives
        return make_interp_spline(t, values, len(t) - 1)
    ends = [(k, np.zeros(values.shape[1])) for k in range((degree + 1) // 2, degree)]
    return make_interp_spline(t, values, degree, bc_type=(ends, ends))


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def looking(ahead: Array) -> Rotation:
    """Level cameras that look along `ahead` [n, 3], which is not vertical."""
    z = unit(ahead)
    x = unit(np.cross(z, [0.0, 0.0, 1.0]))
    return Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=-1))


def small_turn(pitch: ArrayLike, yaw: ArrayLike, roll: ArrayLike) -> Rotation:
    """Rz(roll) Ry(yaw) Rx(pitch) about a camera's axes (x right, y down, z ahead): positive pitch looks up, yaw
    right."""
    return Rotation.from_euler("xyz", np.stack(np.broadcast_arrays(pitch, yaw, roll), axis=-1))


@dataclass(frozen=True)
class Waves:
    """Sums of sines and cosines, one per row: their amplitudes [rows, m] at frequencies_hz [m]."""

    frequencies_hz: Array
    sines: Array
    cosines: Array

    def __call__(self, t_s: Array) -> Array:
        """[rows, n]; the value at time 0 is left in."""
        angle = 2 * math.pi * np.outer(self.frequencies_hz, t_s)
        return self.sines @ np.sin(angle) + self.cosines @ np.cos(angle)
