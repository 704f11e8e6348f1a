"""Random trajectories of a camera or a rig that keep their distance from the surfaces of a scene.

    rng = np.random.default_rng(7)
    parameters = {"duration_s": 2, "volume": [[-1, -1, 1], [1, 1, 2]], "speed_m_per_s": 1.5, "pauses": 1}
    trajectory = plan("drone", parameters, Surfaces([0.0], [points]), rng)
    positions_m, quaternions = trajectory.pose(np.linspace(0, 2, 2001))

The same parameters, surfaces and generator give the same bits. docs/reference/trajectories.md describes every kind
and parameter. How to add a kind: its parameters in `PARAMETERS`, a function in `DRAWS` that returns its path
(paths.Path); the tests go over `KINDS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from .. import _poses as poses
from .._errors import PecsInputError
from . import paths
from .parameters import COMMON, PARAMETERS, read
from .paths import Clock, Path, State, Trajectory, spline

__all__ = ["KINDS", "State", "Surfaces", "Trajectory", "instants", "needed_m", "plan"]

KINDS = tuple(PARAMETERS)
DEGREE = {"drone": 7, "hand_held": 5, "vehicle": 5}  # of the splines through waypoints
MAX_WAYPOINTS = 2000
CANDIDATES = 64  # points drawn per attempt
FEW = 10000  # samples of surfaces in the test of what is in view
MIN_THRUST_G = 0.3  # minimum thrust of a drone
MAX_ELEVATION_DEG = 80.0  # maximum elevation of the view: roll is undefined for a vertical one

# Shake, assumed: rms of rotation [deg] and translation [mm] per axis in bands [Hz], with how many sines. Hands: sway,
# what held cameras were measured to do at about 2 and 4 Hz (Japanese Journal of Ergonomics 31(6) 399, abstract), and
# physiological tremor at 8-12 Hz; the amplitudes are guesses that add up to 2.7 deg/s. Cars: the body on its springs,
# and the wheels.
HAND_SHAKE = ((0.3, 1.5, 6, 0.25, 1.5), (1.5, 5.0, 8, 0.1, 0.4), (8.0, 12.0, 6, 0.02, 0.03))
CAR_SHAKE = ((0.8, 2.0, 6, 0.3, 8.0), (9.0, 13.0, 6, 0.01, 0.3))


class Surfaces:
    """Samples of a scene's surfaces, in world coordinates [m]. Between two times, the moving samples of both count.

    `points` are arrays [n, 3] of the moving surfaces at increasing times, `static` [n, 3] of the others; spacing_m is
    the largest distance from a point of a surface to the nearest sample.
    """

    def __init__(
        self, times_s: ArrayLike, points: Sequence[ArrayLike], static: ArrayLike | None = None, spacing_m: float = 0.0
    ):
        self.times_s, self.spacing_m = np.atleast_1d(np.asarray(times_s, float)), spacing_m
        moving = [np.asarray(p, float).reshape(-1, 3) for p in points]
        if len(moving) != len(self.times_s) or (np.diff(self.times_s) <= 0).any():
            raise PecsInputError(
                f"surfaces: got {len(moving)} sets of points at {self.times_s}, wanted one per rising time"
            )
        still = np.zeros((0, 3)) if static is None else np.asarray(static, float).reshape(-1, 3)
        self._few = [p[:: -(-len(p) // FEW) or 1] for p in (still, *moving)]
        self._trees, self._static_tree = [cKDTree(p) for p in moving], cKDTree(still)

    def some(self, t_s: float) -> NDArray[np.float64]:
        """Return about 10,000 samples [n, 3] in m at a time, regularly thinned, for the test of what is in view."""
        i = max(int(np.searchsorted(self.times_s, t_s, side="right")) - 1, 0)
        return np.concatenate([self._few[0], self._few[1 + i]])

    def distance(self, t_s: NDArray[np.float64], positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance [n] in m of each position [n, 3] at its time [n] from the nearest sample; inf without
        samples."""
        nearest = self._static_tree.query(positions_m)[0] if self._static_tree.n else np.full(len(t_s), np.inf)
        first = np.clip(np.searchsorted(self.times_s, t_s, side="right") - 1, 0, None)
        second = np.minimum(first + (t_s > self.times_s[first]), len(self.times_s) - 1)
        for k in np.unique(np.concatenate([first, second])):
            if self._trees[k].n:
                mine = np.flatnonzero((first == k) | (second == k))
                nearest[mine] = np.minimum(nearest[mine], self._trees[k].query(positions_m[mine])[0])
        return nearest


class _Rejected(Exception):
    """Why a draw is rejected; `way_s`: position along the way, if the reason is at one place."""

    def __init__(self, why: str, way_s: float | None = None):
        super().__init__(why)
        self.way_s = way_s


def plan(kind: str, parameters: Mapping[str, Any], surfaces: Surfaces | None, rng: np.random.Generator) -> Trajectory:
    """Draw a trajectory that always keeps `clearance_m` from all surfaces and has some of them in view (None: no test).

    docs/reference/trajectories.md lists the parameters of each of `KINDS`; `duration_s` is required. The same
    generator, parameters and surfaces give the same bits; `drawn` of the trajectory contains all values that were
    drawn. Raises PecsInputError if a parameter is wrong, a waypoint cannot be reached, or none of `tries` paths met a
    condition, which the message names.
    """
    if kind not in PARAMETERS:
        raise PecsInputError(f"trajectory: got kind {kind!r}, wanted one of {', '.join(KINDS)}")
    p = read(kind, parameters)
    clock = _clock(p, rng)
    route, again_from_s, why = None, None, ""
    for _ in range(p["tries"]):
        try:
            if kind in DEGREE:
                if route is None:
                    route = _Route(kind, p, clock, surfaces, rng)
                elif again_from_s is not None:
                    route.redraw(again_from_s)
            path, drawn = DRAWS[kind](p, clock, route, rng)
            trajectory = Trajectory(path, clock, kind, _record(p, clock, route, drawn))
            _check(trajectory, p, surfaces)
            return trajectory
        except _Rejected as e:
            why, again_from_s = str(e), e.way_s
            if route and not route.given and again_from_s is None:
                route = None
    raise PecsInputError(f"{kind}: no path in {p['tries']} tries: {why}")


def _clock(p: dict, rng: np.random.Generator) -> Clock:
    duration, ramp, pauses = p["duration_s"], p["pause_ramp_s"], p["pauses"]
    if isinstance(pauses, int):
        each = p["pause_s"] + 2 * ramp
        if pauses * each > duration:
            raise PecsInputError(
                f"pauses: got {pauses} of {each:g} s with their ramps, wanted at most {duration:g} s in all"
            )
        starts = np.sort(rng.uniform(0, duration - pauses * each, pauses)) + each * np.arange(pauses) + ramp
        pauses = [(float(start), p["pause_s"]) for start in starts]
    return Clock(duration, tuple(map(tuple, pauses)), ramp, p["speed"])


def _record(p: dict, clock: Clock, route: _Route | None, drawn: dict) -> dict:
    """The drawn values as JSON."""
    record = {key: value for key, value in p.items() if value is not None}
    record |= {"pauses": [list(pause) for pause in clock.pauses], "speed": list(clock.speed)}
    if route:
        record |= {"waypoints": route.points.tolist(), "waypoint_times_s": route.times_s.tolist()}
    return record | drawn


# Waypoints


class _Route:
    """Waypoints [n, 3] and their times on the way: those of the parameters, or random points in `volume`."""

    def __init__(self, kind: str, p: dict, clock: Clock, surfaces: Surfaces | None, rng: np.random.Generator):
        self._kind, self._p, self._clock, self._surfaces, self._rng = kind, p, clock, surfaces, rng
        self.given = p["waypoints"] is not None
        if self.given:
            self.points = np.array(p["waypoints"], float)
            self.times_s = self._times(self.points)
            self.times_s *= clock.way_s / self.times_s[-1]  # the given waypoints fill the duration
            self._reach()
            return
        if p["volume"] is None:
            raise PecsInputError(f"{kind}: got neither volume nor waypoints, wanted one of them")
        self._low, self._high = np.array(p["volume"], float)
        self._extend([])

    def redraw(self, way_s: float) -> None:
        """Draws the waypoints from that place on again. Given waypoints stay; then only other values are drawn."""
        if self.given:
            return
        keep = max(int(np.searchsorted(self.times_s, way_s)) - 1 - int(self._rng.integers(0, 3)), 0)
        self._extend(list(self.points[:keep]))

    def _times(self, points) -> NDArray[np.float64]:
        steps = np.linalg.norm(np.diff(np.asarray(points), axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)]) / self._p["speed_m_per_s"]

    def _needed(self) -> float:
        return needed_m(self._p["clearance_m"], self._surfaces)

    def _distance(self, way_s: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._surfaces is None:
            return np.full(len(points), np.inf)
        # Approximate times, for a uniform clock. The check of the whole path uses the exact ones.
        t = np.minimum(way_s / max(self._clock.way_s, 1e-12), 1.0) * self._clock.duration_s
        return self._surfaces.distance(t, points)

    def _reach(self) -> None:
        distance = self._distance(self.times_s, self.points)
        worst = int(np.argmin(distance))
        if distance[worst] < self._needed():
            point = ", ".join(f"{c:g}" for c in self.points[worst])
            raise PecsInputError(
                f"{self._kind}: unreachable waypoint {worst + 1}: ({point}) m is {distance[worst]:.3g} m from a "
                f"surface, wanted {self._needed():.3g} m"
            )

    def _extend(self, points: list) -> None:
        """Draws points to the end of the way and one beyond it, so that the path ends inside the spline."""
        if self._p["speed_m_per_s"] * self._clock.way_s > MAX_WAYPOINTS * self._p["step_m"][1]:
            raise PecsInputError(
                f"{self._kind}: got a way of {self._p['speed_m_per_s'] * self._clock.way_s:.4g} m, wanted at most "
                f"{MAX_WAYPOINTS} steps of {self._p['step_m'][1]:g} m"
            )
        while len(points) < 5 or self._times(points)[-2] < self._clock.way_s:
            points.append(self._next(points))
        self.points, self.times_s = np.array(points), self._times(points)
        self.times_s *= self._stretch()

    def _stretch(self) -> float:
        """Factor of the times that gives the spline the speed on average: it is longer than the lines between its
        points."""
        way = np.linspace(0, self.times_s[-1], 64 * len(self.points))
        steps = np.linalg.norm(np.diff(self.position()(way), axis=0), axis=1)
        length_m = np.concatenate([[0.0], np.cumsum(steps)])
        return self._clock.way_s / float(np.interp(self._p["speed_m_per_s"] * self._clock.way_s, length_m, way))

    def position(self) -> Callable[..., NDArray[np.float64]]:
        """The spline through the points, in its way; a vehicle's is planar."""
        axes = 2 if self._kind == "vehicle" else 3
        return spline(self.times_s, self.points[:, :axes], DEGREE[self._kind])

    def _next(self, points: list) -> NDArray[np.float64]:
        """A point at the distance of a step that keeps clearance, as does the line to it."""
        short, far = self._p["step_m"]
        low, high = self._low, self._high
        if points:
            low, high = np.maximum(low, points[-1] - far), np.minimum(high, points[-1] + far)
        nearest = 0.0
        for _ in range(8):
            candidates = self._rng.uniform(low, high, (CANDIDATES, 3))
            if points:
                step = np.linalg.norm(candidates - points[-1], axis=1)
                candidates = candidates[(step >= short) & (step <= far) & self._turns(points, candidates)]
            for candidate in candidates:
                line = np.linspace(points[-1] if points else candidate, candidate, 8)[1:]
                way = np.full(len(line), self._times([*points, candidate])[-1] if points else 0.0)
                distance = self._distance(way, line).min()
                if distance >= self._needed():
                    return candidate
                nearest = max(nearest, distance)
        if nearest == 0:
            raise _Rejected(
                f"unreachable waypoint {len(points) + 1}: no step of {short:g} to {far:g} m stays in the volume"
            )
        raise _Rejected(
            f"unreachable waypoint {len(points) + 1}: every way to it comes within {nearest:.3g} m of a surface, "
            f"wanted {self._needed():.3g} m"
        )

    def _turns(self, points: list, candidates: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask of candidates ahead: for a vehicle by its turning circle, for a drone within 120 deg."""
        if self._kind == "drone" and len(points) > 1:
            ahead, step = points[-1] - points[-2], candidates - points[-1]
            return step @ ahead > -0.5 * np.linalg.norm(ahead) * np.linalg.norm(step, axis=1)
        if self._kind != "vehicle":
            return np.ones(len(candidates), bool)
        step = (candidates - points[-1])[:, :2]
        heading = self._p["heading_deg"]
        if len(points) > 1:
            ahead = (points[-1] - points[-2])[:2]
        elif heading is not None:
            ahead = np.array([math.cos(math.radians(heading)), math.sin(math.radians(heading))])
        else:
            return np.ones(len(candidates), bool)
        turn = np.abs(np.arctan2(ahead[0] * step[:, 1] - ahead[1] * step[:, 0], step @ ahead))
        return turn <= np.minimum(0.5 * np.linalg.norm(step, axis=1) / self._p["min_radius_m"], math.radians(50))


# Draws: parameters, clock, route, generator -> the path, and drawn values other than the waypoints


def _drone(p: dict, clock: Clock, route: _Route, rng) -> tuple[Path, dict]:
    """A quadrotor: its thrust carries gravity and acceleration, so that its axis is their sum's direction; yaw along
    the way, or towards a target (Mellinger & Kumar 2011, section III)."""
    position, target = route.position(), p["target"]
    if target is None:
        velocity = position(route.times_s, 1)
        yaw = spline(route.times_s, np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))[:, None], 5)
    on_body = paths.small_turn(math.radians(p["pitch_deg"]), 0.0, 0.0)

    def path(t, clock_s, way):
        at, (rate, change) = position(way), (c[:, None] for c in clock.rates(t))
        up = paths.unit(position(way, 2) * rate**2 + position(way, 1) * change + [0.0, 0.0, paths.GRAVITY_M_S2])
        if target is None:
            angle = yaw(way)[:, 0]
            heading = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        else:
            heading = (target - at) * [1, 1, 0]
        left = paths.unit(np.cross(up, heading))
        return at, Rotation.from_matrix(np.stack([-left, -up, np.cross(left, up)], axis=-1)) * on_body

    return path, {}


def _hand_held(p: dict, clock: Clock, route: _Route, rng) -> tuple[Path, dict]:
    """A spline; looks at a target or along a spline of yaw and pitch. Shake along the camera's axes and about them
    comes on top."""
    position, target, drawn = route.position(), p["target"], {}
    knots = np.arange(math.ceil(clock.way_s / p["gaze_s"]) + 4) * p["gaze_s"]
    wander = np.radians(p["wander_deg"]) * rng.uniform(-1, 1, (len(knots), 2))
    if target is None:
        yaw_deg = p["yaw_deg"] if p["yaw_deg"] is not None else float(rng.uniform(0, 360))
        drawn = {"yaw_deg": yaw_deg}
        wander += np.radians([yaw_deg, p["pitch_deg"]])
    turned = spline(knots, wander, 5)  # yaw and pitch in the world, or pitch and yaw relative to the target
    shake = _waves(HAND_SHAKE, p["shake"], [1e-3] * 3, [math.radians(1)] * 3, rng)

    def path(t, clock_s, way):
        at, angles, waves = position(way), turned(way), shake(clock_s)
        pitch, yaw, roll = waves[3:]
        if target is None:
            view = paths.looking(_direction(*angles.T))
        else:
            view, pitch, yaw = paths.looking(target - at), pitch + angles[:, 0], yaw + angles[:, 1]
        return at + view.apply(waves[:3].T), view * paths.small_turn(pitch, yaw, roll)

    return path, drawn


def _vehicle(p: dict, clock: Clock, route: _Route, rng) -> tuple[Path, dict]:
    """A planar spline at a fixed height, looking along its tangent; shake: heave, pitch and roll."""
    position, height_m = route.position(), float(route.points[0, 2])
    way = np.linspace(0, clock.way_s, 64 * len(route.points))
    (u, v), (du, dv) = position(way, 1).T, position(way, 2).T
    curvature = np.abs(u * dv - v * du) / np.hypot(u, v) ** 3
    tightest = int(np.argmax(curvature))
    if curvature[tightest] * p["min_radius_m"] > 1:
        radius = 1 / curvature[tightest]
        raise _Rejected(f"turns on a radius of {radius:.3g} m, wanted {p['min_radius_m']:g} m", way[tightest])
    shake = _waves(CAR_SHAKE, p["shake"], [1e-3], [math.radians(1)] * 2, rng)

    def path(t, clock_s, way):
        heave, pitch, roll = shake(clock_s)
        view = paths.looking(np.column_stack([position(way, 1), 0 * way]))
        turn = paths.small_turn(pitch + math.radians(p["pitch_deg"]), 0.0, roll)
        return np.column_stack([position(way), heave + height_m]), view * turn

    return path, {}


def _waves(bands, factor: float, metres: list[float], radians: list[float], rng) -> paths.Waves:
    """Rows of translation (per mm), then rotation (per degree), independent of each other, normal in amplitude."""
    frequencies = np.concatenate([rng.uniform(low, high, count) for low, high, count, _, _ in bands])
    rms = np.concatenate([np.tile([[mm], [deg]], count) / math.sqrt(count) for _, _, count, deg, mm in bands], axis=1)
    scale = factor * np.concatenate([np.outer(metres, rms[0]), np.outer(radians, rms[1])])
    a, b = scale * rng.standard_normal(scale.shape), scale * rng.standard_normal(scale.shape)
    return paths.Waves(frequencies, a, b)


def _direction(yaw: ArrayLike, pitch: ArrayLike) -> NDArray[np.float64]:
    """[..., 3]: yaw counter-clockwise from the world's +x, pitch up [rad]."""
    return np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)], axis=-1)


def _orbit(p: dict, clock: Clock, route, rng) -> tuple[Path, dict]:
    """About a point that the camera looks at: radius and height are sines of the way."""
    side = 1 if rng.uniform() < 0.5 else -1
    start_deg = p["start_deg"] if p["start_deg"] is not None else float(rng.uniform(0, 360))
    rate = side * p["speed_m_per_s"] / p["radius_m"]
    phase = float(rng.uniform(0, 2 * math.pi))

    def path(t, clock_s, way):
        angle = way * rate + math.radians(start_deg)
        height = p["height_m"] + p["bob_m"] * np.sin(1.7 * rate * way + phase)  # 1.7: successive rounds differ
        arm = np.stack([p["radius_m"] * np.cos(angle), p["radius_m"] * np.sin(angle), height], axis=-1)
        return p["target"] + arm, paths.looking(-arm)

    return path, {"start_deg": start_deg, "side": side, "bob_phase_rad": phase}


def _still(p: dict, clock: Clock, route, rng) -> tuple[Path, dict]:
    position = p["position"]
    if position is None:
        if p["volume"] is None:
            raise PecsInputError("still: got neither position nor volume, wanted one of them")
        position = tuple(rng.uniform(*np.array(p["volume"], float)).tolist())
    drawn = {"position": list(position)}
    if p["target"] is not None:
        ahead = np.subtract(p["target"], position)
    else:
        yaw_deg = p["yaw_deg"] if p["yaw_deg"] is not None else float(rng.uniform(0, 360))
        drawn["yaw_deg"] = yaw_deg
        ahead = _direction(math.radians(yaw_deg), math.radians(p["pitch_deg"]))
    return lambda t, clock_s, way: (np.tile(position, (len(t), 1)), paths.looking(np.tile(ahead, (len(t), 1)))), drawn


def _recorded(p: dict, clock: Clock, route, rng) -> tuple[Path, dict]:
    """Splines of a recording's positions and quaternions; world_from_recorded and body_from_camera [4, 4] place the
    recording in the scene and the camera on the recorded body."""
    if p["format"] == "euroc":
        t_ns, position, quaternion = poses.read_euroc_poses(p["file"])
        t = (t_ns - t_ns[0]) * 1e-9
    else:
        t, position, quaternion = poses.read_tum(p["file"])
        t = t - t[0]
    spare = t[-1] - clock.way_s
    if len(t) < 6 or spare < (p["start_s"] or 0):
        wanted = f"wanted 6 or more of at least {clock.way_s + (p['start_s'] or 0):g} s"
        raise PecsInputError(f"{p['file']}: got {len(t)} poses of {t[-1]:g} s, {wanted}")
    start = p["start_s"] if p["start_s"] is not None else float(rng.uniform(0, spare))
    body = spline(t, np.column_stack([position, paths.of_one_sign(quaternion)]), 5, p["knot_s"])
    world, camera = (np.array(p[key], float) for key in ("world_from_recorded", "body_from_camera"))

    def path(t, clock_s, way):
        rows = body(way + start)
        pose = world @ poses.pose_matrix(rows[:, :3], rows[:, 3:]) @ camera
        return pose[:, :3, 3], Rotation.from_matrix(pose[:, :3, :3])

    return path, {"start_s": start}


DRAWS: dict[str, Callable] = {
    "drone": _drone,
    "hand_held": _hand_held,
    "vehicle": _vehicle,
    "orbit": _orbit,
    "still": _still,
    "recorded": _recorded,
}
assert set(DRAWS) == set(PARAMETERS) and set(COMMON) <= set(PARAMETERS["still"])


# Checks of a whole path


def needed_m(clearance_m: float, surfaces: Surfaces | None) -> float:
    """Return the distance [m] that a path must keep from every sample.

    The surface between samples is then also at least `clearance_m` away. An eighth of it is added for the camera's
    motion between two checks.
    """
    return math.hypot(clearance_m, surfaces.spacing_m if surfaces else 0.0) + clearance_m / 8


def _check(trajectory: Trajectory, p: dict, surfaces: Surfaces | None) -> None:
    _check_limits(trajectory, p)
    t = instants(trajectory, p["clearance_m"] / 4)
    at = t[:: max(len(t) // 64, 1)]
    rotation = trajectory.matrices(at)[:, :3, :3]
    view = np.degrees(np.arcsin(np.clip(rotation[:, 2, 2], -1, 1)))
    steep = int(np.argmax(np.abs(view)))
    if p.get("target") is not None and abs(view[steep]) > MAX_ELEVATION_DEG:
        wanted = f"wanted at most {MAX_ELEVATION_DEG:g}"
        raise _Rejected(f"looks {view[steep]:.0f} deg up at {at[steep]:.3g} s, {wanted}", _way(trajectory, at[steep]))
    if surfaces is None:
        return
    distance = surfaces.distance(t, trajectory.positions(t))
    worst, needed = int(np.argmin(distance)), needed_m(p["clearance_m"], surfaces)
    if distance[worst] < needed:
        why = f"comes within {distance[worst]:.3g} m of a surface at {t[worst]:.3g} s, wanted {needed:.3g} m"
        raise _Rejected(why, _way(trajectory, t[worst]))
    for i in range(0, len(at), 4):
        to = surfaces.some(at[i]) - trajectory.positions(at[i : i + 1])
        ahead, cosine = to @ rotation[i, :, 2], math.cos(math.radians(p["view_deg"] / 2))
        if not ((ahead > 0) & (ahead**2 > cosine**2 * (to**2).sum(axis=1))).any():
            why = f"sees nothing within {p['view_deg']:g} deg at {at[i]:.3g} s"
            raise _Rejected(why, _way(trajectory, at[i]))


def _check_limits(trajectory: Trajectory, p: dict) -> None:
    """The greatest speed, and limits of a quadrotor: tilt, rate, and a minimum thrust (near zero its attitude is
    undefined)."""
    t, rows = np.linspace(0, trajectory.duration_s, 512), []
    state = trajectory.state(t)
    if trajectory.kind == "drone":
        force = state.acceleration_m_s2 + [0.0, 0.0, paths.GRAVITY_M_S2]
        tilt = np.degrees(np.arctan2(np.hypot(force[:, 0], force[:, 1]), force[:, 2]))
        thrust = np.linalg.norm(force, axis=1) / paths.GRAVITY_M_S2
        rate = np.degrees(np.linalg.norm(state.angular_velocity_rad_s, axis=1))
        rows.append(("tilts {:.0f} deg", tilt, p["max_tilt_deg"]))
        rows.append(("has a thrust of {:.2f} g", -thrust, -MIN_THRUST_G))
        rows.append(("turns at {:.0f} deg/s", rate, p["max_rate_deg_s"]))
    if p["max_speed_m_per_s"] is not None:
        rows.append(("moves at {:.3g} m/s", np.linalg.norm(state.velocity_m_s, axis=1), p["max_speed_m_per_s"]))
    for name, value, limit in rows:
        worst = int(np.argmax(value))
        if value[worst] > limit:
            what = f"{name.format(abs(value[worst]))} at {t[worst]:.3g} s"
            wanted = f"wanted {'at least' if limit < 0 else 'at most'} {abs(limit):g}: slower, or longer steps"
            raise _Rejected(f"{what}, {wanted}", _way(trajectory, t[worst]))


def _way(trajectory: Trajectory, t_s: float) -> float:
    return float(trajectory.clock(t_s)[1])


def instants(trajectory: Trajectory, step_m: float, most: int = 20000) -> NDArray[np.float64]:
    """Return times from 0 to the end [s] between which the trajectory moves by at most `step_m`; at least 65, and at
    most `most` with longer steps."""
    t = np.linspace(0, trajectory.duration_s, 4097)
    steps = np.linalg.norm(np.diff(trajectory.positions(t), axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    count = min(math.ceil(length[-1] / step_m) + 1, most)
    even = np.interp(np.linspace(0, length[-1], count), length, t)
    return np.unique(np.concatenate([even, t[::64]]))
