"""Motions of a camera as formulas of time, each with exact derivatives (taylor.py). trajectories.py draws them.

World: z up, metres. Body: the camera's axes, x right, y down, z ahead (OpenCV). A path knows two clocks, both series of
the true time: `clock` stands still in pauses and otherwise runs as time does (what shakes by itself follows it), `way`
runs `speed` times as fast (what goes along the path follows it).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _poses as poses
from .._errors import PecsInputError
from . import taylor
from .taylor import Piecewise, Rotation, Series, Vector, cross, unit

GRAVITY_M_S2 = 9.80665  # standard gravity, 3rd CGPM 1901
UP = (0.0, 0.0, 1.0)


class Path(Protocol):
    """frame() is given series of at least `order`; its rotation's may be two orders shorter."""

    order: int

    def frame(self, clock: Series, way: Series) -> tuple[Vector, Rotation]: ...


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
        return float(self(np.array([self.duration_s]), 0)[1].values()[0])

    def __call__(self, t_s: ArrayLike, order: int) -> tuple[Series, Series]:
        """Series of the clock and of the way."""
        t = Series.variable(t_s, order)
        clock = self._clock(t)
        end = self._clock(Series.variable([self.duration_s], 0)).values()[0]
        first, last = self.speed
        growth = math.log(last / first)
        if abs(growth) < 1e-9 or end == 0:
            return clock, clock * first
        return clock, ((clock * (growth / end)).exp() - 1) * (first * end / growth)

    def _clock(self, t: Series) -> Series:
        if not self.pauses:
            return t
        pieces = self._pieces()
        begin = pieces(Series.variable([0.0], 0)).values()[0]
        return pieces(t) - begin

    def _pieces(self) -> Piecewise:
        # The integral of S(u) = 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7; it is 1/2 at u = 1.
        rise = np.array([-2.5, 10.0, -14.0, 7.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        powers = np.arange(8, -1, -1)
        run, stand = np.zeros(9), np.zeros(9)
        run[7] = 1
        up = rise * self.ramp_s ** (1.0 - powers)
        down = run - up
        breaks, columns, value = [min(0.0, self.pauses[0][0] - self.ramp_s) - 1.0], [run], 0.0
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
        return Piecewise(np.array(columns).T, [*breaks, math.inf])


@dataclass(frozen=True)
class State:
    """A trajectory at n times.

    Attributes
    ----------
    position_m, velocity_m_s, acceleration_m_s2 : float64 array
        [n, 3] in world coordinates [m, m/s, m/s^2].
    world_from_body : float64 array
        [n, 3, 3], rotation matrices.
    angular_velocity_rad_s, angular_acceleration_rad_s2 : float64 array
        [n, 3] in body coordinates [rad/s, rad/s^2].
    """

    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    acceleration_m_s2: NDArray[np.float64]
    world_from_body: NDArray[np.float64]
    angular_velocity_rad_s: NDArray[np.float64]
    angular_acceleration_rad_s2: NDArray[np.float64]


class Trajectory:
    """Pose and exact derivatives at any time of a path. `plan` makes trajectories.

    The body's axes are x right, y down, z ahead; the world's z is up. Methods raise PecsInputError for times outside
    the trajectory.

    Parameters
    ----------
    path : Path
        Formulas of the motion.
    clock : Clock
        Duration, pauses and speed.
    kind : str
        Name of the kind, for records. Default "".
    drawn : dict, optional
        Values that were drawn, for records in JSON. Default: none.
    """

    def __init__(self, path: Path, clock: Clock, kind: str = "", drawn: dict | None = None):
        self.path, self.clock, self.kind, self.drawn = path, clock, kind, drawn or {}

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.clock.duration_s

    def state(self, t_s: ArrayLike) -> State:
        """Return pose, velocities and accelerations.

        Parameters
        ----------
        t_s : array
            [n], times from 0 to `duration_s` [s].

        Returns
        -------
        State
            At these times.
        """
        position, rotation = self._series(t_s, max(self.path.order, 2))
        r, r1, r2 = (taylor.matrices(rotation, k) for k in range(3))
        back = np.swapaxes(r, -1, -2)
        return State(
            taylor.values(position),
            taylor.values(position, 1),
            taylor.values(position, 2),
            r,
            _axis(back @ r1),  # R' = R [w]x
            _axis(back @ r2),  # R'' = R ([w]x^2 + [w']x), and the square is symmetric
        )

    def positions(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Return positions.

        Parameters
        ----------
        t_s : array
            [n], times from 0 to `duration_s` [s].

        Returns
        -------
        float64 array
            [n, 3] in m, in world coordinates.
        """
        return taylor.values(self._series(t_s, self.path.order - 2)[0])

    def pose(self, t_s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions and quaternions.

        Parameters
        ----------
        t_s : array
            [n], times from 0 to `duration_s` [s].

        Returns
        -------
        (float64 array, float64 array)
            Positions [n, 3] in m, and unit quaternions [n, 4] (x y z w) of world_from_body.
        """
        position, rotation = self._series(t_s, self.path.order - 2)
        return taylor.values(position), poses.quaternion_from_matrix(taylor.matrices(rotation))

    def matrices(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Return pose matrices.

        Parameters
        ----------
        t_s : array
            [n], times from 0 to `duration_s` [s].

        Returns
        -------
        float64 array
            world_from_body [n, 4, 4], translations in m.
        """
        return poses.pose_matrix(*self.pose(t_s))

    def _series(self, t_s: ArrayLike, order: int) -> tuple[Vector, Rotation]:
        t = np.atleast_1d(np.asarray(t_s, float))
        if t.size and not (t.min() >= -1e-9 and t.max() <= self.duration_s + 1e-9):
            raise PecsInputError(f"times: got {t.min():g} to {t.max():g} s, wanted within 0 to {self.duration_s:g} s")
        return self.path.frame(*self.clock(np.clip(t, 0.0, self.duration_s), order))


def _axis(m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vector of a matrix's antisymmetric part."""
    return np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=-1) / 2


# Attitudes


def looking(ahead: Vector) -> Rotation:
    """A level camera that looks along `ahead`, which is not vertical."""
    z = unit(ahead)
    x = unit(cross(z, UP))
    return x, cross(z, x), z


def looking_at(position: Vector, target: ArrayLike) -> Rotation:
    return looking(tuple(float(c) - p for c, p in zip(target, position, strict=True)))


def direction(yaw: Series, pitch: Series) -> Vector:
    """yaw counter-clockwise from the world's +x, pitch up; radians."""
    (sy, cy), (sp, cp) = yaw.sin_cos(), pitch.sin_cos()
    return cy * cp, sy * cp, sp


@dataclass(frozen=True)
class Waves:
    """Sums of sines, one per row: amplitudes, phases_rad [rows, m], at frequencies_hz [m]. Their value at time 0 is
    left in."""

    frequencies_hz: NDArray[np.float64]
    amplitudes: NDArray[np.float64]
    phases_rad: NDArray[np.float64]

    def __call__(self, t: Series) -> list[Series]:
        c = np.zeros((len(self.amplitudes), *t.c.shape))
        for k, frequency in enumerate(self.frequencies_hz):
            sine, cosine = (t * (2 * math.pi * frequency)).sin_cos()
            a, phase = self.amplitudes[:, k, None, None], self.phases_rad[:, k, None, None]
            c += a * (np.cos(phase) * sine.c + np.sin(phase) * cosine.c)
        return [Series(row) for row in c]


# Paths


@dataclass(frozen=True)
class Drone:
    """A quadrotor: its thrust carries gravity and acceleration, so that its axis is their sum's direction; yaw along a
    spline, or towards a target (Mellinger & Kumar 2011, section III). pitch_rad: of the camera on the body, up."""

    position: list[Piecewise]  # 3
    yaw: Piecewise | None  # rad; or
    target: tuple[float, float, float] | None
    pitch_rad: float
    order: int = 4  # the attitude's second derivative is the position's fourth

    def thrust(self, position: Vector) -> Vector:
        """Thrust per mass [m/s^2]."""
        x, y, z = (p.derivative(2) for p in position)
        return x, y, z + GRAVITY_M_S2

    def frame(self, clock: Series, way: Series) -> tuple[Vector, Rotation]:
        position = tuple(p(way) for p in self.position)
        zb = unit(self.thrust(position))
        order = len(zb[0].c) - 1
        if self.yaw is not None:
            sine, cosine = self.yaw(way.truncated(order)).sin_cos()
            heading = (cosine, sine, sine * 0)
        else:
            x, y = (float(c) - p.truncated(order) for c, p in zip(self.target[:2], position, strict=False))
            heading = (x, y, x * 0)
        left = unit(cross(zb, heading))
        body = (tuple(-c for c in left), tuple(-c for c in zb), cross(left, zb))
        zero = zb[0] * 0
        return position, taylor.turned(body, taylor.small_turn(zero + self.pitch_rad, zero, zero))


@dataclass(frozen=True)
class HandHeld:
    """A spline; looks at a target or along a spline of yaw and pitch; `wander` (rad, on the way) and `shake` (metres
    along the camera's axes, then rad about them: up, right, clockwise; on the clock) come on top."""

    position: list[Piecewise]
    gaze: list[Piecewise] | None  # yaw, pitch [rad]; or
    target: tuple[float, float, float] | None
    wander: list[Piecewise] | None  # pitch, yaw [rad]
    shake: Waves  # 6 rows
    order: int = 2

    def frame(self, clock: Series, way: Series) -> tuple[Vector, Rotation]:
        position = tuple(p(way) for p in self.position)
        view = looking(direction(*(g(way) for g in self.gaze))) if self.gaze else looking_at(position, self.target)
        dx, dy, dz, pitch, yaw, roll = self.shake(clock)
        if self.wander:
            pitch, yaw = (w(way) + s for w, s in zip(self.wander, (pitch, yaw), strict=True))
        rotation = taylor.turned(view, taylor.small_turn(pitch, yaw, roll))
        x, y, z = view
        moved = tuple(position[i] + x[i] * dx + y[i] * dy + z[i] * dz for i in range(3))
        return moved, rotation


@dataclass(frozen=True)
class Vehicle:
    """A planar spline at a fixed height, looking along its tangent; `shake`: heave [m], pitch, roll [rad], on the
    clock."""

    position: list[Piecewise]  # x, y
    height_m: float
    pitch_rad: float
    shake: Waves  # 3 rows
    order: int = 2

    def frame(self, clock: Series, way: Series) -> tuple[Vector, Rotation]:
        heave, pitch, roll = self.shake(clock)
        x, y = (p(way) for p in self.position)
        u, v = (p.derivative()(way) for p in self.position)
        rotation = taylor.turned(looking((u, v, u * 0)), taylor.small_turn(pitch + self.pitch_rad, u * 0, roll))
        return (x, y, heave + self.height_m), rotation


@dataclass(frozen=True)
class Orbit:
    """An orbit about a point that the camera looks at: radius and height are sines of the way."""

    centre: tuple[float, float, float]
    radius_m: float
    height_m: float
    bob_m: float
    rate_rad_s: float
    start_rad: float
    bob_phase_rad: float
    order: int = 2

    def frame(self, clock: Series, way: Series) -> tuple[Vector, Rotation]:
        sine, cosine = (way * self.rate_rad_s + self.start_rad).sin_cos()
        bob, _ = (way * (1.7 * self.rate_rad_s) + self.bob_phase_rad).sin_cos()  # 1.7: successive rounds differ
        x, y, z = self.centre
        position = (cosine * self.radius_m + x, sine * self.radius_m + y, bob * self.bob_m + z + self.height_m)
        return position, looking_at(position, self.centre)


@dataclass(frozen=True)
class Still:
    position_m: tuple[float, float, float]
    ahead: tuple[float, float, float]
    order: int = 2

    def frame(self, clock: Series, way: Series) -> tuple[Vector, Rotation]:
        zero = way * 0
        position, ahead = (tuple(zero + c for c in v) for v in (self.position_m, self.ahead))
        return position, looking(ahead)


@dataclass(frozen=True)
class Recorded:
    """Splines of a recording: positions, and quaternions (x y z w) of one sign, made unit. world_from_recorded and
    body_from_camera [4, 4] place the recording in the scene and the camera on the recorded body."""

    position: list[Piecewise]
    quaternion: list[Piecewise]
    start_s: float
    world_from_recorded: NDArray[np.float64]
    body_from_camera: NDArray[np.float64]
    order: int = 2

    def frame(self, clock: Series, way: Series) -> tuple[Vector, Rotation]:
        at = way + self.start_s
        p = [f(at) for f in self.position]
        x, y, z, w = (f(at) for f in self.quaternion)
        two = 2 / (x * x + y * y + z * z + w * w)
        body = (
            (1 - (y * y + z * z) * two, (x * y + z * w) * two, (x * z - y * w) * two),
            ((x * y - z * w) * two, 1 - (x * x + z * z) * two, (y * z + x * w) * two),
            ((x * z + y * w) * two, (y * z - x * w) * two, 1 - (x * x + y * y) * two),
        )
        (world, origin), (local, lever) = (
            (m[:3, :3], m[:3, 3]) for m in (self.world_from_recorded, self.body_from_camera)
        )
        body = taylor.turned(tuple(map(tuple, world.T)), body)
        position = tuple(
            sum((world[i, k] * p[k] for k in range(3)), sum((body[k][i] * lever[k] for k in range(3)), origin[i]))
            for i in range(3)
        )
        return position, taylor.turned(body, tuple(map(tuple, local.T)))
