"""Objects in a room of known walls: none is in a wall, in another one, in the way of the camera or out of its view."""

import numpy as np
import pecs
import pytest
from pecs.datasets import fitting, trajectories

HALF_M, STEP_M = 1.5, 0.05  # of a cubic room
HOW = {"duration_s": 1.0, "clearance_m": 0.2, "view_deg": 60.0}


def faces(half_m, step_m):
    """Points on the faces of a cube."""
    grid = np.stack(np.meshgrid(*[np.arange(-half_m, half_m + 1e-9, step_m)] * 2), -1).reshape(-1, 2)
    sides = [np.insert(grid, axis, end, 1) for axis in range(3) for end in (-half_m, half_m)]
    return np.concatenate(sides)


@pytest.fixture(scope="module")
def room():
    surfaces = trajectories.Surfaces([0.0], [np.zeros((0, 3))], faces(HALF_M, STEP_M), STEP_M)
    still = {"duration_s": 1.1, "position": [0, -1.2, 0], "yaw_deg": 90}
    return surfaces, trajectories.plan("still", still, None, np.random.default_rng(1))


def cubes(count, half_m, speed=0.0, span_m=1.6, seed=1):
    rng = np.random.default_rng(seed)
    low, high = [-span_m] * 3, [span_m] * 3
    things = [
        {"file": "cube.glb", "position_m": rng.uniform(low, high).tolist(), "low_m": low, "high_m": high,
         "velocity_m_s": [speed, 0, 0], "spin_deg_s": [0, 0, 0]}
        for _ in range(count)
    ]  # fmt: skip
    return things, [faces(half_m, half_m / 4) + thing["position_m"] for thing in things]


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_cubes_are_free(room, speed):
    things, points = cubes(12, 0.15, speed)
    found = np.array(fitting.fit(things, points, *room, np.random.default_rng(2), **HOW))
    for t_s in (0.0, 0.5, 1.0):
        at = found + [speed * t_s, 0, 0]
        assert np.abs(at).max() < HALF_M - 0.15
        apart = np.abs(at[:, None] - at[None]).max(-1) + 9 * np.eye(12)
        assert apart.min() > 2 * 0.15
        assert np.abs(at - [0, -1.2, 0]).max(1).min() > 0.15
    to = found[None] + np.linspace(0, speed, 33)[:, None, None] * [1, 0, 0] - [0, -1.2, 0]
    assert (to[..., 1] / np.linalg.norm(to, axis=-1) >= np.cos(np.radians(30)) - 1e-9).any(0).all()
    again = fitting.fit(things, points, *room, np.random.default_rng(2), **HOW)
    assert again == found.tolist()


def test_a_free_object_stays_where_it_was_drawn(room):
    (thing,), (points,) = cubes(1, 0.1)
    thing, points = thing | {"position_m": [0.1, 0.5, 0.0]}, points - thing["position_m"] + [0.1, 0.5, 0.0]
    assert fitting.fit([thing], [points], *room, np.random.default_rng(2), **HOW) == [[0.1, 0.5, 0.0]]


@pytest.mark.parametrize(
    ("count", "half_m", "span_m", "why"), [(1, 1.6, 0.01, ""), (40, 0.3, 1.0, "touches another object")]
)
def test_what_fits_nowhere_is_one_line(room, count, half_m, span_m, why):
    with pytest.raises(pecs.PecsInputError, match="object .* got no place in 1000 tries") as error:
        fitting.fit(*cubes(count, half_m, span_m=span_m), *room, np.random.default_rng(2), **HOW)
    assert "\n" not in str(error.value)
