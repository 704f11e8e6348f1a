"""Motions: exact derivatives against finite differences, what a kind promises, clearance, pauses, bits, bad input; and
files of poses."""

import math
import re

import numpy as np
import pytest
from pecs import _poses as poses
from pecs.datasets import paths
from pecs.datasets.parameters import PARAMETERS
from pecs.datasets.paths import spline
from pecs.datasets.trajectories import DEGREE, KINDS, Surfaces, instants, needed_m, plan
from support.trajectories import CENTRE, parameters


def walls(distance_m=3.0, spacing_m=0.1):
    """A closed box about the origin, as samples no farther than spacing_m / sqrt(2) from each of its points."""
    side = np.linspace(-distance_m, distance_m, math.ceil(2 * distance_m / spacing_m) + 1)
    u, v = (c.ravel() for c in np.meshgrid(side, side))
    faces = []
    for axis in range(3):
        for at in (-distance_m, distance_m):
            face = np.insert(np.stack([u, v], axis=1), axis, at, axis=1)
            faces.append(face)
    return np.concatenate(faces)


def path_of(kind, folder, seed, **more):
    """Without surfaces."""
    return plan(kind, parameters(kind, folder, **more), None, np.random.default_rng(seed))


def difference(f, t, h=2e-4):
    """f' to sixth order."""
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    return sum(w * (f(t + k * h) - f(t - k * h)) for k, w in weights.items()) / h


MOVES = {"pauses": [[0.9, 0.2]], "pause_ramp_s": 0.3, "speed": [0.3, 1.5]}


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_exact(kind, tmp_path):
    trajectory = path_of(kind, tmp_path, 3, **MOVES)
    t = np.array([0.11, 0.31, 0.65, 0.77, 1.23, 1.31, 1.57, 1.83])  # also in the pause's ramps
    state = trajectory.state(t)
    turn = np.swapaxes(state.world_from_body, 1, 2) @ difference(lambda s: trajectory.state(s).world_from_body, t)
    rate = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
    assert np.abs(difference(trajectory.positions, t) - state.velocity_m_s).max() < 1e-7
    assert np.abs(difference(lambda at: trajectory.state(at).velocity_m_s, t) - state.acceleration_m_s2).max() < 1e-6
    assert np.abs(rate - state.angular_velocity_rad_s).max() < 1e-7
    accelerated = difference(lambda at: trajectory.state(at).angular_velocity_rad_s, t)
    assert np.abs(accelerated - state.angular_acceleration_rad_s2).max() < 1e-5
    assert np.abs(state.world_from_body @ np.swapaxes(state.world_from_body, 1, 2) - np.eye(3)).max() < 1e-12
    position, quaternion = trajectory.pose(t)
    assert np.abs(position - state.position_m).max() < 1e-12
    assert np.abs(poses.matrix_from_quaternion(quaternion) - state.world_from_body).max() < 1e-12
    if kind != "still":
        assert np.linalg.norm(state.velocity_m_s, axis=1).min() > 1e-3  # there was something to compare


@pytest.mark.parametrize("kind", KINDS)
def test_pauses_stand_still(kind, tmp_path):
    trajectory = path_of(kind, tmp_path, 5, pauses=[[0.0, 0.1], [1.0, 0.3]], pause_ramp_s=0.2, speed=0.3)
    state = trajectory.state(np.concatenate([np.linspace(0, 0.1, 20), np.linspace(1.0, 1.3, 50)[1:]]))
    moves = (state.velocity_m_s, state.acceleration_m_s2, state.angular_velocity_rad_s)
    assert not any(v.any() for v in (*moves, state.angular_acceleration_rad_s2))
    assert len(np.unique(state.position_m[20:].round(12), axis=0)) == 1
    drawn = path_of(kind, tmp_path, 5, pauses=2, pause_ramp_s=0.1, speed=0.1)
    assert len(drawn.clock.pauses) == 2
    for start, length in drawn.clock.pauses:
        assert length == 0.1 and 0 <= start - 0.1 and start + length + 0.1 <= 2
        assert np.abs(drawn.state(np.linspace(start, start + length, 9)).velocity_m_s).max() < 1e-8


@pytest.mark.parametrize("speed", [0.01, 0.1, 1.0, 10.0])
def test_speed_over_three_decades(speed, tmp_path):
    """An orbit's speed is known."""
    trajectory = path_of("orbit", tmp_path, 0, bob_m=0, speed=speed)
    moving = np.linalg.norm(trajectory.state(np.linspace(0, 2, 50)).velocity_m_s, axis=1)
    assert np.allclose(moving, speed, rtol=1e-12)
    sweep = path_of("orbit", tmp_path, 0, bob_m=0, speed=[0.01, speed])
    moving = np.linalg.norm(sweep.state([0.0, 1.0, 2.0]).velocity_m_s, axis=1)
    assert np.allclose(moving, [0.01, 0.1 * math.sqrt(speed), speed], rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_bits(kind, tmp_path):
    t, surfaces = np.linspace(0, 2, 101), Surfaces([0.0], [walls()])
    given = parameters(kind, tmp_path, pauses=1, pause_ramp_s=0.1, speed=0.1)
    drawn = [plan(kind, given, surfaces, np.random.default_rng(seed)) for seed in (9, 9, 10)]
    first, again, other = (trajectory.matrices(t) for trajectory in drawn)
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert np.array_equal(drawn[0].matrices(t[37:38]), first[37:38])  # poses do not depend on the other times


def test_minimum_snap():
    """Through its points, six times continuously differentiable, ends free; and no wiggle lowers the snap."""
    from scipy.integrate import trapezoid

    rng = np.random.default_rng(1)
    t, points = np.array([0.0, 0.7, 1.5, 1.9, 3.0, 4.2]), rng.uniform(-1, 1, (6, 1))
    f = spline(t, points, 7)
    assert np.abs(f(t) - points).max() < 1e-12
    for k in range(7):
        before, after = f(t[1:-1] - 1e-9, k), f(t[1:-1], k)
        assert np.abs(before - after).max() < 1e-5 * (1 + np.abs(after).max())
    assert all(np.abs(f(t[[0, -1]], k)).max() < 1e-6 * np.abs(f(t, k)).max() for k in (4, 5, 6))
    fine, wiggle = np.linspace(0, 4.2, 20001), np.polynomial.Polynomial.fromroots(t)

    def cost(c):
        """Integral of snap^2 with a wiggle of that height that is zero at the points."""
        return trapezoid((f(fine, 4)[:, 0] + c * wiggle.deriv(4)(fine)) ** 2, fine)

    assert cost(0.0) < min(cost(1e-3), cost(-1e-3))


def test_drone_thrust_points_up_the_body(tmp_path):
    """What a quadrotor can: its axis carries gravity and acceleration; the camera is pitched on it and level in roll
    about the heading."""
    trajectory = path_of("drone", tmp_path, 2)
    state = trajectory.state(np.linspace(0, 2, 200))
    thrust = state.acceleration_m_s2 + [0, 0, paths.GRAVITY_M_S2]
    thrust /= np.linalg.norm(thrust, axis=1, keepdims=True)
    axis = np.einsum("nij,j->ni", state.world_from_body, [0, -math.cos(math.radians(20)), -math.sin(math.radians(20))])
    assert np.abs(thrust - axis).max() < 1e-7
    assert np.degrees(np.arccos(thrust[:, 2])).max() <= 60
    assert np.degrees(np.linalg.norm(state.angular_velocity_rad_s, axis=1)).max() <= 361


@pytest.mark.parametrize("kind", ("drone", "hand_held", "orbit", "still"))
def test_looks_at_its_target(kind, tmp_path):
    more = {"target": CENTRE} | ({"wander_deg": 0, "shake": 0} if kind == "hand_held" else {})
    trajectory = path_of(kind, tmp_path, 8, **more)
    matrix = trajectory.matrices(np.linspace(0, 2, 50))
    seen = np.einsum("nji,nj->ni", matrix[:, :3, :3], np.array(CENTRE) - matrix[:, :3, 3])
    if kind == "drone":  # in yaw
        left = np.cross(*np.swapaxes(matrix[:, :3, 1:3], 1, 2).swapaxes(0, 1))
        assert np.abs((left * (np.array(CENTRE) - matrix[:, :3, 3]) * [1, 1, 0]).sum(axis=1)).max() < 0.6
    else:
        assert np.abs(seen[:, :2]).max() < 1e-12 and seen[:, 2].min() > 0
        assert np.abs(matrix[:, 2, 0]).max() < 1e-12 and matrix[:, 2, 1].max() < 0  # level, y down


def test_vehicle_keeps_its_turning_circle(tmp_path):
    trajectory = path_of("vehicle", tmp_path, 4, shake=0)
    state = trajectory.state(np.linspace(0, 2, 500))
    speed = np.linalg.norm(state.velocity_m_s, axis=1)
    turn = np.cross(state.velocity_m_s, state.acceleration_m_s2)[:, 2] / speed**3
    assert np.abs(turn).max() * 0.4 <= 1.001 and np.abs(state.position_m[:, 2] - 0.2).max() == 0
    ahead = state.world_from_body[:, :, 2]
    assert np.abs(ahead - state.velocity_m_s / speed[:, None]).max() < 1e-9


def test_shake_is_as_stated(tmp_path):
    """2.7 deg/s on each axis, within what a few sines vary."""
    found = []
    for seed in range(12):
        more = {"volume": [[0, 0, 0], [1, 1, 1]], "wander_deg": 0, "duration_s": 20.0, "speed": 0.01}
        trajectory = path_of("hand_held", tmp_path, seed, **more)
        found.append(np.degrees(trajectory.state(np.linspace(0, 20, 2000)).angular_velocity_rad_s).std(axis=0))
    assert 2.2 < np.sqrt(np.mean(np.square(found))) < 3.2


def test_recorded_goes_through_its_poses(tmp_path):
    world = np.array([[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1.0]])
    camera = np.array([[1, 0, 0, 0.1], [0, 0, 1, 0.2], [0, -1, 0, 0.3], [0, 0, 0, 1.0]])
    more = {"start_s": 0.5, "world_from_recorded": world.tolist(), "body_from_camera": camera.tolist()}
    trajectory = path_of("recorded", tmp_path, 0, **more)
    t, position, quaternion = poses.read_tum(tmp_path / "poses.txt")
    wanted = world @ poses.pose_matrix(position, quaternion) @ camera
    keep = slice(50, 250)
    assert np.abs(trajectory.matrices((t - t[0])[keep] - 0.5) - wanted[keep]).max() < 1e-6  # times since 1970
    noisy = position + np.random.default_rng(0).normal(0, 1e-3, position.shape)
    poses.write_tum(tmp_path / "noisy.txt", t, noisy, quaternion)
    rough, smooth = (
        path_of("recorded", tmp_path, 0, duration_s=3, start_s=0.5, file=tmp_path / "noisy.txt", **knot)
        for knot in ({}, {"knot_s": 0.3})
    )
    at = np.linspace(0, 3, 300)
    assert (
        np.abs(smooth.positions(at) - np.stack([np.interp(at + 0.5, t - t[0], p) for p in position.T], 1)).max() < 2e-3
    )
    assert np.abs(smooth.state(at).acceleration_m_s2).max() < 0.1 * np.abs(rough.state(at).acceleration_m_s2).max()


@pytest.mark.parametrize("kind", DEGREE)
def test_mean_speed_is_the_given_one(kind, tmp_path):
    """Between drawn waypoints, although a spline is longer than the lines between them."""
    given = parameters(kind, tmp_path, shake=0.0) if kind != "drone" else parameters(kind, tmp_path)
    for seed in range(8):
        trajectory = plan(kind, given, None, np.random.default_rng(seed))
        moved = np.diff(trajectory.positions(np.linspace(0, 2, 4001)), axis=0)
        assert np.linalg.norm(moved, axis=1).sum() / 2 == pytest.approx(trajectory.drawn["speed_m_per_s"], rel=0.01)


@pytest.mark.parametrize("kind", DEGREE)
def test_keeps_clear(kind, tmp_path):
    """It keeps clear of walls, and of a ball that moves, at its own time."""
    times = np.linspace(0, 2, 21)
    ball = np.random.default_rng(0).normal(size=(400, 3))
    ball = 0.3 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    where = np.stack([-1.5 + 1.5 * times, 0 * times, 0 * times], axis=1)
    surfaces = Surfaces(times, [ball + w for w in where], static=walls(2.6), spacing_m=0.08)
    given = parameters(kind, tmp_path, clearance_m=0.3, tries=500)
    for seed in range(5):
        trajectory = plan(kind, given, surfaces, np.random.default_rng(seed))
        t = np.linspace(0, 2, 2001)
        p = trajectory.positions(t)
        assert (2.6 - np.abs(p)).min() >= 0.3
        centre = np.stack([np.interp(t, times, w) for w in where.T], axis=1)
        assert np.linalg.norm(p - centre, axis=1).min() >= 0.3 + 0.3 - 0.08  # half of what it moves between instants
        steps = np.linalg.norm(np.diff(trajectory.positions(instants(trajectory, 0.01)), axis=0), axis=1)
        assert steps.max() < 0.0101


def test_says_what_cannot_be_met(tmp_path):
    surfaces = Surfaces([0.0], [walls()])

    def refused(kind, match, where=surfaces, **more):
        with pytest.raises(ValueError, match=match) as e:
            plan(kind, parameters(kind, tmp_path, **more), where, np.random.default_rng(0))
        assert "\n" not in str(e.value) and len(str(e.value)) < 400
        return str(e.value)

    there = [[0, 0, 0], [1, 0, 0], [2.9, 0, 0], [1, 1, 0]]
    text = refused("drone", r"unreachable waypoint 3: \(2.9, 0, 0\) m is 0.1 m from a surface", waypoints=there)
    assert f"wanted {needed_m(0.2, surfaces):.3g} m" in text
    inside = [[2.9, 2.9, 2.9], [3, 3, 3]]
    refused("hand_held", "hand_held: no path in 5 tries: unreachable waypoint 1: every way", volume=inside, tries=5)
    refused("drone", "unreachable waypoint 2: no step of 0.5 to 1.5 m", volume=[[0, 0, 0], [0.1, 0.1, 0.1]], tries=3)
    refused("drone", "tilts .* deg at .* s, wanted at most 60", speed=20.0, tries=3)
    refused(
        "vehicle",
        "turns on a radius of .*, wanted 50 m",
        waypoints=[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
        min_radius_m=50,
    )
    refused("orbit", "comes within .* of a surface", radius_m=3.0, start_deg=0, tries=3)
    refused("orbit", "looks -89 deg up", radius_m=0.01, height_m=1, tries=3)
    ahead = {"target": None, "yaw_deg": 90, "pitch_deg": 0}
    refused("still", "sees nothing within 40 deg", Surfaces([0.0], [[[0.0, -3, 0]]]), tries=4, **ahead)
    refused("recorded", r"got 400 poses of 3.99 s, wanted 6 or more of at least 5 s", duration_s=5.0)
    refused("hand_held", "neither volume nor waypoints", volume=None)
    refused("still", "neither position nor volume", volume=None)
    refused("drone", "got a way of 2e\\+06 m, wanted at most 2000 steps", speed=1000.0, duration_s=2000.0)


@pytest.mark.parametrize(
    "kind, more, match",
    [
        ("walk", {}, "got kind 'walk', wanted one of drone, hand_held"),
        ("drone", {"hight": 1}, "drone: hight: got an unknown key, wanted one of clearance_m"),
        ("drone", {"duration_s": None}, "duration_s: got nothing"),
        ("drone", {"duration_s": 0}, "drone: duration_s: got 0, wanted a number in \\[0.0001, 3600\\]"),
        ("drone", {"duration_s": float("nan")}, "duration_s: got NaN"),
        ("drone", {"speed": 1e4}, "speed: got 10000.0, wanted a number in \\[0.001, 1000\\]"),
        ("drone", {"speed": [1, 2, 3]}, "wanted a list of 2 numbers"),
        ("drone", {"volume": [[0, 0, 0], [1, 1, -1]]}, "wanted the lower end first"),
        ("drone", {"volume": [[0, 0], [1, 1]]}, "wanted 2 x 3 finite numbers"),
        ("drone", {"volume": "big"}, "wanted 2 x 3 finite numbers"),
        ("drone", {"tries": 0}, "wanted a whole number in \\[1, 100000\\]"),
        ("drone", {"tries": True}, "wanted a whole number in \\[1, 100000\\]"),
        ("drone", {"pauses": [[1.0, 0.1], [0.5, 0.1]]}, "in the order of time"),
        ("drone", {"pauses": [[0.5, 0.1], [0.65, 0.1]]}, "wanted 0.8 s apart"),
        ("drone", {"pauses": 3}, "got 3 of 0.9 s with their ramps, wanted at most 2 s in all"),
        ("orbit", {"target": None}, "orbit: target: got nothing"),
        ("recorded", {"format": "bag"}, 'got "bag", wanted one of tum, euroc'),
        (
            "recorded",
            {"body_from_camera": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
            "wanted a rotation",
        ),
    ],
)
def test_bad_parameters(kind, more, match, tmp_path):
    given = {k: v for k, v in ((parameters(kind, tmp_path) if kind in KINDS else {}) | more).items() if v is not None}
    with pytest.raises(ValueError, match=match) as e:
        plan(kind, given, None, np.random.default_rng(0))
    assert "\n" not in str(e.value) and e.value.code == 4


def test_what_was_drawn_is_json(tmp_path):
    import json

    for kind in KINDS:
        given = {k: str(v) if k == "file" else v for k, v in parameters(kind, tmp_path).items()}
        trajectory = plan(kind, given, None, np.random.default_rng(1))
        drawn = json.loads(json.dumps(trajectory.drawn))
        assert drawn["duration_s"] == 2.0 and (kind not in DEGREE or len(drawn["waypoints"]) >= 5)


def test_the_page(root):
    """docs/reference/trajectories.md as a user reads it: its Python runs, and it names every kind and parameter."""
    text = (root / "docs/reference/trajectories.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    names = {}
    exec(block, names)
    assert len(names["samples"].t_ns) == 2001
    for kind in KINDS:
        assert f"`{kind}`" in text and not [key for key in PARAMETERS[kind] if f"`{key}`" not in text]


# Files


def test_files_read_back_bit_by_bit(tmp_path):
    rng = np.random.default_rng(0)
    q = rng.normal(size=(50, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    p, t_ns = rng.normal(size=(50, 3)), 1403636579758555392 + np.arange(50) * 5000001
    poses.write_tum(tmp_path / "a.txt", t_ns * 1e-9, p, q)
    rows = zip(t_ns.tolist(), np.column_stack([p, q[:, [3, 0, 1, 2]]]).tolist(), strict=True)
    lines = [",".join(map(repr, [t, *row])) for t, row in rows]
    (tmp_path / "b.csv").write_text("\n".join([poses.EUROC_POSE_HEADER, *lines]) + "\n")
    poses.write_euroc_imu(tmp_path / "c.csv", t_ns, p, q[:, :3])
    for written, read in (
        ((t_ns * 1e-9, p, q), poses.read_tum(tmp_path / "a.txt")),
        ((t_ns, p, q), poses.read_euroc_poses(tmp_path / "b.csv")),
        ((t_ns, p, q[:, :3]), poses.read_euroc_imu(tmp_path / "c.csv")),
    ):
        assert all(np.array_equal(a, b) for a, b in zip(written, read, strict=True))
    row = (tmp_path / "b.csv").read_text().splitlines()[1]
    (tmp_path / "b.csv").write_text(row + ",0.1,0.2,0.3,0,0,0,0,0,0\n")  # with velocity and biases
    assert poses.read_euroc_poses(tmp_path / "b.csv")[0][0] == t_ns[0]


@pytest.mark.parametrize(
    "text, match",
    [
        ("", "rows: got 0"),
        ("0 0 0 0 0 0 0\n", 'line 1: got "0 0 0 0 0 0 0", wanted 8 finite numbers'),
        ("# t\n0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", 'line 3: time: got "0", wanted a time after'),
        ("0 0 0 0 0 0 0 2\n", "line 1: length of the quaternion: got 2.0, wanted 1"),
        ("0 0 nan 0 0 0 0 1\n", 'line 1: got "0 0 nan'),
        ("0 0 0 0 0 0 0 0\n", "line 1: length of the quaternion: got 0.0"),
        ("0 0 0 0 0 0 0.01 1.015\n", "line 1: length of the quaternion: got 1.015"),
        ("0 0 0 0 0 0 0 1\n1,0,0,0,0,0,0,1\n", 'line 2: got "1,0'),
        ("x" * 1000, 'line 1: got "xxx'),
        ("\udcff\udcfe0", "byte 0: got invalid UTF-8"),
    ],
)
def test_bad_files(text, match, tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(text, errors="surrogateescape")
    with pytest.raises(ValueError, match=match) as e:
        poses.read_tum(path)
    assert str(e.value).startswith(str(path)) and "\n" not in str(e.value)
    with pytest.raises(ValueError):
        poses.read_euroc_poses(path)
    with pytest.raises(FileNotFoundError, match="no such file"):
        poses.read_tum(tmp_path / "none.txt")
    with pytest.raises(FileNotFoundError, match="Is a directory"):
        poses.read_tum(tmp_path)
    with pytest.raises(OSError, match="poses.txt"):
        poses.write_tum(path / "a.txt", [0.0], [[0, 0, 0]], [[0, 0, 0, 1]])


def test_rounded_quaternions_and_comments(tmp_path):
    """Three decimals, as published files have them, and a comment behind a row."""
    (tmp_path / "a.txt").write_text("# t\n0 1 2 3 0.498 0.500 0.500 0.500  # first\n1 1 2 3 0 0 0 1\n")
    t_s, positions_m, quaternions = poses.read_tum(tmp_path / "a.txt")
    assert t_s.tolist() == [0, 1] and np.allclose(np.linalg.norm(quaternions, axis=1), 1, atol=1e-15)


def test_rotations_and_interpolation():
    """Against scipy's."""
    from scipy.spatial.transform import Rotation, Slerp

    turns = Rotation.random(200, random_state=1)
    special = Rotation.from_quat([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0.6, 0.8, 0, 0]])
    turns = Rotation.concatenate([turns, special])
    times, at = np.arange(len(turns)) * 0.1, np.linspace(0, (len(turns) - 1) * 0.1, 777)
    matrices = np.tile(np.eye(4), (len(turns), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = turns.as_matrix(), np.outer(times, [1, 2, 3])
    positions, q = poses.position_quaternion(matrices)
    assert np.abs((q * turns.as_quat()).sum(axis=1) ** 2 - 1).max() < 1e-12 and q[:, 3].min() >= 0
    assert np.abs(poses.matrix_from_quaternion(q) - turns.as_matrix()).max() < 1e-12
    assert np.abs(poses.pose_matrix(positions, q) - matrices).max() < 1e-12
    found = poses.interpolate(at, times, positions, q)
    near = Rotation.from_matrix(found[:, :3, :3]) * Slerp(times, turns)(at).inv()
    assert near.magnitude()[at < 19.9].max() < 1e-9  # further on come half turns: either way is right
    assert np.abs(found[:, :3, 3] - np.outer(at, [1, 2, 3])).max() < 1e-12
    near_pair = poses.slerp([0, 0, 0, 1], [1e-12, 0, 0, 1], 0.5)
    assert np.abs(near_pair - [5e-13, 0, 0, 1]).max() < 1e-15
    with pytest.raises(ValueError, match="wanted times within"):
        poses.interpolate([-0.1], times, positions, q)


def test_a_path_that_is_too_fast_is_drawn_again():
    given = {"duration_s": 1.0, "volume": [[-2, -2, 0], [2, 2, 2]], "speed_m_per_s": 1.0, "yaw_deg": 0}
    seconds = np.linspace(0, 1, 512)

    def most(seed, **more):
        path = plan("hand_held", given | more, None, np.random.default_rng(seed))
        return np.linalg.norm(path.state(seconds).velocity_m_s, axis=1).max()

    free = [most(seed) for seed in range(12)]
    limit = float(np.median(free))
    assert max(free) > limit and all(most(seed, max_speed_m_per_s=limit) <= limit for seed in range(12))
    with pytest.raises(ValueError, match="no path in 200 tries: moves at .* m/s at .* s, wanted at most 0.1"):
        most(1, max_speed_m_per_s=0.1)
