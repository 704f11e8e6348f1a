"""Tracks: places at other times of the surface points that a camera sees at one time (`Camera.tracks`)."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._poses import interpolate, position_quaternion
from ._bilinear import on_surface
from .rig import Optics, along, transformed
from .truth import Truth

Array = NDArray[np.float64]
_SAME_US = 1.0  # a time so near to an instant of the truth is that instant
_FOUND_PX = 0.05  # how near a point must come to its pixel


class Camera(Protocol):
    """The members of `pecs.Camera` that tracks need."""

    width: int
    height: int

    @property
    def truth(self) -> Truth: ...
    @property
    def view(self) -> Optics: ...
    def poses(self) -> tuple[Array, Array]: ...
    def poses_at(self, times_us: ArrayLike) -> Array: ...


def follow(camera: Camera, points_px: ArrayLike, at_us: float, times_us: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    """As `Camera.tracks`."""
    points = np.asarray(points_px, np.float64).reshape(-1, 2)
    times = np.atleast_1d(np.asarray(times_us, np.float64))
    local, ids = _surface(camera, points, at_us)
    positions, seen = np.empty((len(times), len(points), 2)), np.empty((len(times), len(points)), bool)
    for k, t_us in enumerate(times):
        positions[k], z = _seen_at(camera, local, ids, t_us)
        seen[k] = _inside(camera, positions[k])
        for i in _instants(camera, t_us):
            seen[k] &= camera.truth.shows(i, *_seen_at(camera, local, ids, camera.truth.times_us[i]))
    return positions, seen


def _instants(camera: Camera, t_us: float) -> list[int]:
    """The instants of the truth before and after a time, or the one at it."""
    times = camera.truth.times_us
    if not times[0] - _SAME_US <= t_us <= times[-1] + _SAME_US:
        raise IndexError(f"{camera.truth.folder}: track at {t_us} us: got {times[[0, -1]]} us of truth")
    near = int(np.abs(times - t_us).argmin())
    if abs(times[near] - t_us) <= _SAME_US:
        return [near]
    after = int(np.searchsorted(times, t_us))
    return [after - 1, after]


def _objects(camera: Camera, t_us: float) -> dict[int, Array]:
    """{id: world_from_object} of the objects that keep their shape, between two instants interpolated."""
    truth, around = camera.truth, _instants(camera, t_us)
    first, *second = (truth.object_poses(i) for i in around)
    rigid = set(first).difference(truth.deforming)
    if not second:
        return {k: first[k] for k in rigid}
    ends = truth.times_us[around]
    return {
        k: interpolate([t_us], ends, *position_quaternion([first[k], second[0][k]]))[0] for k in rigid & set(second[0])
    }


def _camera_pose(camera: Camera, t_us: float) -> Array:
    times, _ = camera.poses()
    return camera.poses_at([np.clip(t_us, times[0], times[-1])])[0]


def _seen_at(camera: Camera, local: Array, ids: NDArray[Any], t_us: float) -> tuple[Array, Array]:
    """Pixels [n, 2] and depths [n] of points of objects."""
    world = np.full_like(local, np.nan)
    for k, pose in _objects(camera, t_us).items():
        world[ids == k] = transformed(pose, local[ids == k])
    points = transformed(np.linalg.inv(_camera_pose(camera, t_us)), world)
    with np.errstate(invalid="ignore"):
        points[~(points[:, 2] > 0)] = np.nan
    return camera.view.pixels(points) - 0.5, points[:, 2]


def _inside(camera: Camera, pixels: Array) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return ((pixels > -0.5) & (pixels < [camera.width - 0.5, camera.height - 0.5])).all(-1)


def _surface(camera: Camera, pixels: Array, at_us: float) -> tuple[Array, NDArray[np.int64]]:
    """Surface that pixels see at a time: points in the axes of their objects, and these objects' ids; NaN unknown.
    Between two instants, the nearest of the points of either one that come to the pixel."""
    around = _instants(camera, at_us)
    if len(around) == 1:
        return _surface_of(camera, around[0], pixels)
    best = np.full((len(pixels), 3), np.nan), np.zeros(len(pixels), np.int64)
    depth = np.full(len(pixels), np.inf)
    for i in around:
        source = pixels
        for _ in range(12):  # converges where neighbours move alike
            local, ids = _surface_of(camera, i, source)
            found, z = _seen_at(camera, local, ids, at_us)
            missed = pixels - found
            source = source + np.nan_to_num(missed)
        with np.errstate(invalid="ignore"):
            nearer = (np.abs(missed).max(-1) < _FOUND_PX) & (z < depth)
        depth = np.where(nearer, z, depth)
        best[0][nearer], best[1][nearer] = local[nearer], ids[nearer]
    return best


def _surface_of(camera: Camera, i: int, pixels: Array) -> tuple[Array, NDArray[np.int64]]:
    """As `_surface`, at an instant of the truth. Depth is interpolated as its inverse, which is linear on planes."""
    truth, inside = camera.truth, _inside(camera, pixels)
    at = np.clip(np.where(inside[:, None], pixels, 0), 0, [camera.width - 1, camera.height - 1])
    objects = truth.instances(i)
    x, y = np.rint(at).astype(int).T
    with np.errstate(divide="ignore"):
        z = 1 / on_surface(1 / truth.depth(i)[1].astype(np.float64)[..., None], at, objects)[..., 0]
    directions = camera.view.lens.directions(pixels + 0.5, **camera.view.setting)
    t_us = float(truth.times_us[i])
    world = transformed(_camera_pose(camera, t_us), along(directions, z))
    ids, local = np.where(inside, objects[y, x], 0), np.full((len(pixels), 3), np.nan)
    for k, pose in _objects(camera, t_us).items():
        local[ids == k] = transformed(np.linalg.inv(pose), world[ids == k])
    return local, ids
