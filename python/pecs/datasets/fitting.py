"""Places of objects: not in a surface of the scene or in each other, not in the way of the rig, and in its view."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from .._errors import PecsInputError
from .rig import Array
from .trajectories import Surfaces, Trajectory

TRIES = 1000
SAMPLES = 400  # of an object's surface
SCENE_TIMES, PATH_TIMES = 5, 33
SEEN_STEPS = 16  # along a line of sight
ACROSS = 0.75  # how far samples of two surfaces that meet may be apart, in sums of their spacings


class _Solid:
    """An object at any place: its surface samples about its middle, in its attitude at time 0."""

    def __init__(self, thing: dict[str, Any], points: Array):
        self.local = points[:: -(-len(points) // SAMPLES) or 1] - thing["position_m"]
        self.velocity, self.spin = (np.array(thing[key], float) for key in ("velocity_m_s", "spin_deg_s"))
        distances = np.linalg.norm(self.local, axis=1)
        self.inner_m, self.outer_m = float(distances.min()), float(distances.max())
        near = cKDTree(self.local).query(self.local, k=2)[0][:, 1] if len(self.local) > 1 else np.zeros(1)
        self.spacing_m = float(near.max())
        self.position = np.zeros(3)

    def middle(self, t_s: float) -> Array:
        return self.position + t_s * self.velocity

    def points(self, t_s: float) -> Array:
        return self.middle(t_s) + Rotation.from_rotvec(np.radians(self.spin) * t_s).apply(self.local)


class _Room:
    def __init__(self, scene: Surfaces, path: Trajectory, duration_s: float, clearance_m: float, view_deg: float):
        self._scene, self._clearance_m = scene, clearance_m
        self._cosine = math.cos(math.radians(view_deg / 2))
        self._times = np.linspace(0, duration_s, SCENE_TIMES)
        self._path_times = np.linspace(0, duration_s, PATH_TIMES)
        self._cameras = path.matrices(self._path_times)
        self._there: list[_Solid] = []

    def add(self, solid: _Solid) -> None:
        self._there.append(solid)

    def fault(self, solid: _Solid) -> str:
        """Why the object cannot be where it is; "" if it can."""
        if not self._in_view(solid):
            return "is not in view of the path"
        for t_s, camera in zip(self._path_times, self._cameras, strict=True):
            to_middle = np.linalg.norm(solid.middle(t_s) - camera[:3, 3])
            if to_middle < solid.inner_m or (
                to_middle < solid.outer_m + self._clearance_m
                and np.linalg.norm(solid.points(t_s) - camera[:3, 3], axis=1).min() < self._clearance_m
            ):
                return "is in the way of the rig"
        for t_s in self._times:
            points = solid.points(t_s)
            if self._scene.distance(np.full(len(points), t_s), points).min() < ACROSS * (
                solid.spacing_m + self._scene.spacing_m
            ):
                return "touches a surface of the scene"
            if any(_meet(solid, points, other, t_s) for other in self._there):
                return "touches another object"
        return ""

    def _in_view(self, solid: _Solid) -> bool:
        for t_s, camera in zip(self._path_times, self._cameras, strict=True):
            line = solid.middle(t_s) - camera[:3, 3]
            length = float(np.linalg.norm(line))
            if line @ camera[:3, 2] < self._cosine * length:
                continue
            end = max(0.0, 1 - (solid.outer_m + self._scene.spacing_m) / length)
            between = camera[:3, 3] + np.linspace(0, end, SEEN_STEPS)[:, None] * line
            if self._scene.distance(np.full(SEEN_STEPS, t_s), between).min() > self._scene.spacing_m:
                return True
        return False


def _meet(one: _Solid, points: Array, other: _Solid, t_s: float) -> bool:
    apart = float(np.linalg.norm(one.middle(t_s) - other.middle(t_s)))
    gap = ACROSS * (one.spacing_m + other.spacing_m)
    if apart >= one.outer_m + other.outer_m + gap:
        return False
    if apart < max(one.inner_m, other.inner_m):
        return True
    return bool(cKDTree(other.points(t_s)).query(points)[0].min() < gap)


def fit(
    things: list[dict[str, Any]],
    samples: list[Array],
    scene: Surfaces,
    path: Trajectory,
    rng: np.random.Generator,
    **how: float,
) -> list[list[float]]:
    """Positions of objects: the drawn one, or another one in low_m to high_m. samples: points [n, 3] of each one's
    surface where it was drawn. scene: without them. how: duration_s, clearance_m and view_deg. Raises PecsInputError
    for an object that fits nowhere."""
    room, found = _Room(scene, path, **how), []
    for number, (thing, points) in enumerate(zip(things, samples, strict=True)):
        solid = _Solid(thing, points)
        solid.position, why = np.array(thing["position_m"], float), ""
        for _ in range(TRIES):
            if not (why := room.fault(solid)):
                break
            solid.position = rng.uniform(thing["low_m"], thing["high_m"])
        if why:
            what = f"object {number} ({thing['file']}, {2 * solid.outer_m:.3g} m across)"
            raise PecsInputError(f"{what}: got no place in {TRIES} tries, since it {why}, wanted room for it")
        room.add(solid)
        found.append(solid.position.tolist())
    return found
