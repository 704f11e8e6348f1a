# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface points seen at the pixels' centres, and their places on the film at another instant.

The light's scene is rendered by Cycles with one sample along chief rays (sight.py), all surfaces in a material that
identifies instance and polygon (identity.py). A point then moves with its instance's matrix, or with the triangle of a
mesh that deforms (mesh_points.py). A second scene would be slower: Blender keeps the data of one at a time.

Unknown (NaN): the motion of instances that the other instant lacks or whose Random is not unique, of meshes whose
topology changes, of deforming hair, curves and points, and of everything if a panoramic camera moves. Lamps are
ignored. Nothing moves across a cut from one camera to another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import bpy
import numpy as np

from ..camera.sight import Sight, Viewpoint, transformed
from ..camera.stage import Stage
from ..scene import cycles
from .identity import INSTANCE, NORMAL, POLYGON, Identity, name_id
from .mesh_points import Geometries, Geometry, carried

SKY, UNKNOWN = -1, -2
Value = TypeVar("Value")


@dataclass(frozen=True)
class Poses:
    """All instances at one instant. ids: [n] float32, increasing, Cycles' Random; world_from_local: [n, 4, 4];
    geometry: [n] index into geometries; notes: [n] results of Surfaces.note; lamps: properties of those that are
    on, by name."""

    view: Viewpoint
    ids: np.ndarray
    world_from_local: np.ndarray
    geometry: np.ndarray
    geometries: list[Geometry]
    notes: list[Any]
    lamps: dict[str, list[Any]]

    def find(self, ids: np.ndarray) -> np.ndarray:
        """Indices of instances; UNKNOWN for an id that is missing or not unique."""
        if not self.ids.size:
            return np.full(ids.shape, UNKNOWN)
        at = np.searchsorted(self.ids, ids)
        last = np.searchsorted(self.ids, ids, "right") - 1
        return np.where(last == at, at, UNKNOWN)


@dataclass(frozen=True)
class SurfaceHits:
    """First hits of the rays through the pixels' centres. poses: of the same instant. depth: [h, w] along the optical
    axis [m], infinite without a surface. instance: [h, w] index into poses, SKY or UNKNOWN. points: [3, h, w] in camera
    axes. polygon: [h, w] from 0, -1 if unknown. random: [h, w] Cycles' Random of the instance. normals: [3, h, w] in
    camera axes, towards the camera, 0 without a surface; None unless Surfaces.normals is set."""

    poses: Poses
    depth: np.ndarray
    instance: np.ndarray
    points: np.ndarray
    polygon: np.ndarray
    random: np.ndarray
    normals: np.ndarray | None


class Surfaces:
    """scale: of the picture, 1/4 for a quarter of the pixels in x and y. normals: whether hits() computes them. note:
    called with each evaluated instance and its Geometry."""

    normals = False
    note: Callable[[bpy.types.DepsgraphObjectInstance, Geometry], Any] | None = None

    def __init__(self, stage: Stage, scale: float = 1.0, name: str = "surfaces"):
        self.size = tuple(max(cycles.LEAST_PX, round(n * scale)) for n in stage.size)
        override = stage.source.scene.view_layers[0].material_override
        self._stage, self._identity, self._geometries = stage, Identity(override), Geometries()
        self.sight, self._film = Sight(stage, name, self.size), cycles.Film(stage.source.scene)

    def hits(self) -> SurfaceHits:
        """At the stage's current time."""
        evaluated, scene = [], self._stage.source.scene
        own = (INSTANCE, POLYGON, NORMAL) if self.normals else (INSTANCE, POLYGON)
        with (
            cycles.for_one_sample(scene, self.sight.camera(), self.size),
            self._identity.on(scene.view_layers[0], own),
        ):
            names = "Position", "Depth", *own
            passes = self._film.passes(*names, inspect=lambda d: evaluated.append(self._poses(d, self._identity.mark)))
        poses = evaluated[-1]
        points = self.sight.points(poses.view, passes["Position"].astype(float))
        surface = passes["Depth"][0] < cycles.NO_SURFACE
        depth = np.where(surface, points[2] * self._stage.source.unit_m, np.inf)
        instance = np.where(surface, poses.find(passes[INSTANCE][0]), SKY)
        polygon = passes[POLYGON][0].astype(np.int32) - 1
        normals = _normals(passes[NORMAL][:3], surface, poses.view) if self.normals else None
        return SurfaceHits(poses, depth, instance.astype(np.int32), points, polygon, passes[INSTANCE][0], normals)

    def poses(self) -> Poses:
        """At the stage's current time."""
        evaluated, scene, camera = [], self._stage.source.scene, self.sight.camera()
        if not scene.camera:  # without one, Blender renders nothing
            scene.camera = camera
        self._film.inspect(lambda d: evaluated.append(self._poses(d)))
        return evaluated[-1]

    def place(self, seen: SurfaceHits, poses: Poses) -> np.ndarray:
        """[3, h, w] float64: film x, y [px of this picture; pixel centres at .5] and depth z [m] of the seen points at
        the poses' instant; NaN if unknown, so after a cut. Exactly the pixel's centre where nothing moves."""
        if seen.poses.view.camera != poses.view.camera:
            return np.full((3, *seen.instance.shape), np.nan)
        before, view, instance = seen.poses, poses.view, seen.instance.ravel()
        out = np.full((3, instance.size), np.nan)
        centres, points = self.sight.centres().reshape(2, -1), seen.points.reshape(3, -1)
        known = np.flatnonzero(instance >= 0)
        moves = _Moves(before, poses)
        still = known[moves.still[instance[known]]]
        out[:2, still], out[2, still] = centres[:, still], points[2, still]
        moving = known[moves.moving[instance[known]]]
        now = moves(instance[moving], points[:, moving], seen.polygon.ravel()[moving])
        sky = np.flatnonzero(instance == SKY)
        turned = self._sky(before.view, view, sky)
        both = np.concatenate([moving, sky])  # in one call: setting up a lens's map is slow
        infinite = np.arange(both.size) >= moving.size
        out[:2, both] = self.sight.film(view, np.concatenate([now, turned], 1), infinite)
        out[2, moving], out[2, sky] = now[2], np.inf
        stays = sky[~turned[2].astype(bool)]
        out[:2, stays] = centres[:, stays]
        out[2] *= self._stage.source.unit_m
        return out.reshape(3, *seen.instance.shape)

    def moved(self, seen: SurfaceHits, poses: Poses) -> np.ndarray:
        """[h, w]: whether the seen instance or sky stands otherwise before the camera at the poses' instant, or is
        unknown; everything if a lamp differs."""
        still = _Moves(seen.poses, poses).still & (seen.poses.lamps == poses.lamps)
        return ~np.append(still, [False, self._sky_stays(seen.poses.view, poses.view)])[seen.instance]  # UNKNOWN, SKY

    def outside(self, poses: Poses, ids: np.ndarray) -> np.ndarray:
        """[n, 5, 9]: whether the corners and the middle of the boxes of instances are outside the picture, on its left,
        right, upper, lower side, and behind the camera; all of them of an instance that does not exist, none for a
        projection that is unknown."""
        at, rays = poses.find(ids), self.sight.rays(poses.view)
        if rays is None or not len(poses.ids):
            return np.full((len(ids), 5, 9), rays is not None)
        points = np.array([one.box for one in poses.geometries]).reshape(-1, 3, 9)[poses.geometry[np.maximum(at, 0)]]
        camera_from_local = poses.view.camera_from_world @ poses.world_from_local[np.maximum(at, 0)]
        x, y, z = (camera_from_local[:, :3, :3] @ points + camera_from_local[:, :3, 3:]).swapaxes(0, 1)
        (left, top), (right, bottom) = (
            [f(o) + f(s) * z for o, s in zip(*rays, strict=True)] for f in (np.nanmin, np.nanmax)
        )
        inside = np.stack([x > left, x < right, y > top, y < bottom, z > 0], 1)
        return ~(inside & (at >= 0)[:, None, None])

    def _sky_stays(self, before: Viewpoint, view: Viewpoint) -> bool:
        """Along all rays of an orthographic camera the sky is the same."""
        if before.same(view):
            return True
        rays = self.sight.rays(before)
        return before.camera == view.camera and rays is not None and not rays[1].any()

    def _sky(self, before: Viewpoint, view: Viewpoint, sky: np.ndarray) -> np.ndarray:
        """Directions [3, n] in camera axes of sky pixels [n], which turn with the camera. 0 where the sky stays; where
        a lens has no ray it is dark."""
        if self._sky_stays(before, view):
            return np.zeros((3, sky.size))
        rays = self.sight.rays(before)
        if rays is None:
            return np.full((3, sky.size), np.nan)
        along = np.vstack([rays[1].reshape(2, -1)[:, sky], np.ones((1, sky.size))])
        turned = (view.camera_from_world @ np.linalg.inv(before.camera_from_world))[:3, :3] @ along
        return np.where(np.isnan(turned[0]), 0, turned)

    def _poses(self, depsgraph: bpy.types.Depsgraph, mark: Callable = lambda thing: None) -> Poses:
        ids, matrices, geometry, notes, geometries, numbers = [], [], [], [], [], {}
        for instance in renders(depsgraph):
            thing = instance.object
            data = thing.data
            key = data.as_pointer()
            if key not in numbers:
                numbers[key] = len(geometries)
                geometries.append(self._geometries.geometry(data))
                mark(thing)
            ids.append(instance.random_id & 0xFFFFFFFF if instance.is_instance else name_id(thing.name))
            matrices.append([v for row in instance.matrix_world for v in row])
            geometry.append(numbers[key])
            notes.append(self.note and self.note(instance, geometries[numbers[key]]))
        random = np.array(ids, np.uint32).astype(np.float32) * np.float32(2.0**-32)
        order = np.argsort(random, kind="stable")
        world = np.array(matrices, float).reshape(-1, 4, 4)
        geometry, notes = np.array(geometry, int)[order], [notes[i] for i in order]
        view = self.sight.view(depsgraph)
        return Poses(view, random[order], world[order], geometry, geometries, notes, _lamps(depsgraph))


def _lamps(depsgraph: bpy.types.Depsgraph) -> dict[str, list[Any]]:
    """Places and numbers of all lamps, by names."""
    lamps = {}
    for one in depsgraph.object_instances:
        if (light := one.object).type == "LIGHT":
            numbers = [
                getattr(light.data, p.identifier)
                for p in light.data.bl_rna.properties
                if p.type == "FLOAT" and not p.is_array
            ]
            lamps.setdefault(light.name, []).append([*map(tuple, one.matrix_world), numbers])
    return lamps


def renders(depsgraph: bpy.types.Depsgraph) -> Iterator[bpy.types.DepsgraphObjectInstance]:
    """Instances with surfaces."""
    for instance in depsgraph.object_instances:
        if isinstance(instance.object.data, (bpy.types.Mesh, bpy.types.Curves, bpy.types.PointCloud)):
            yield instance


class Recent(Generic[Value]):
    """The last few values of a function, by its argument."""

    def __init__(self, count: int):
        self._count, self._kept = count, {}

    def get(self, key: float, make: Callable[[Any], Value]) -> Value:
        if key not in self._kept:
            self._kept[key] = make(key)
            while len(self._kept) > self._count:
                self._kept.pop(next(iter(self._kept)))
        return self._kept[key]


class HitCache:
    """Hits at the last few instants, shared by layers. times_s: of all instants to render."""

    def __init__(self, stage: Stage, times_s: list[float]):
        self.stage, self.times_s = stage, times_s
        self._kept: Recent[SurfaceHits] = Recent(1)  # an interval ends where the next begins

    def keep(self, count: int) -> None:
        self._kept = Recent(count)

    @cached_property
    def surfaces(self) -> Surfaces:
        return Surfaces(self.stage, name="chief_rays")

    def at(self, t_s: float) -> SurfaceHits:
        """Moves the scene to t_s if the hits are not cached."""
        return self._kept.get(t_s, self._seen)

    def _seen(self, t_s: float) -> SurfaceHits:
        self.stage.set_time(t_s)
        return self.surfaces.hits()


def _normals(normals: np.ndarray, surface: np.ndarray, view: Viewpoint) -> np.ndarray:
    turned = np.einsum("ij,jyx->iyx", view.camera_from_world[:3, :3], normals)
    with np.errstate(all="ignore"):
        return np.where(surface, turned / np.linalg.norm(turned, axis=0), 0)


class _Moves:
    """Moves points in camera axes from one instant to another. still: [n] instances that are bit-identical before the
    same camera; moving: all others that exist at both instants."""

    def __init__(self, before: Poses, after: Poses):
        self._before, self._after = before, after
        index = after.find(before.ids)
        there = index >= 0
        self._there = at = np.where(there, index, 0)
        if not after.ids.size:
            self.still = self.moving = there
            return
        one, other = (np.array([id(g) for g in poses.geometries]) for poses in (before, after))
        self._deforms = one[before.geometry] != other[after.geometry[at]]
        self._stays = (before.world_from_local == after.world_from_local[at]).all((1, 2)) & ~self._deforms
        self.still = there & self._stays & before.view.same(after.view)
        self.moving = there & ~self.still

    def __call__(self, instance: np.ndarray, points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
        """points [3, n] of instances [n], in polygons [n]; NaN if unknown."""
        before, after = self._before, self._after
        if not instance.size:
            return points
        world_from_camera = np.linalg.inv(before.view.camera_from_world)
        now = transformed(after.view.camera_from_world @ world_from_camera, points)  # of what stays in the world
        moving = np.flatnonzero(~self._stays[instance])
        instance, points = instance[moving], points[:, moving]
        used = np.flatnonzero(np.bincount(instance, minlength=len(before.ids)))
        short = np.searchsorted(used, instance)
        local_from_camera = _inverse(before.world_from_local[used]) @ world_from_camera
        camera_from_local = after.view.camera_from_world @ after.world_from_local[self._there[used]]
        now[:, moving] = _each(camera_from_local @ local_from_camera, short, points)
        for k in np.flatnonzero(self._deforms[used]):
            of, there = np.flatnonzero(short == k), self._there[used[k]]
            shapes = before.geometries[before.geometry[used[k]]], after.geometries[after.geometry[there]]
            local = carried(*shapes, polygon[moving[of]], transformed(local_from_camera[k], points[:, of]))
            now[:, moving[of]] = transformed(camera_from_local[k], local)
        return now


def _each(matrices: np.ndarray, index: np.ndarray, points: np.ndarray) -> np.ndarray:
    """matrices[index] of points [3, n]"""
    rows = [sum(matrices[index, r, c] * points[c] for c in range(3)) + matrices[index, r, 3] for r in range(3)]
    return np.stack(rows)


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Inverses of [n, 4, 4]; a flattened axis stays flat."""
    out = np.tile(np.eye(4), (len(matrices), 1, 1))
    out[:, :3, :3] = np.linalg.pinv(matrices[:, :3, :3], rcond=1e-6)
    out[:, :3, 3:] = -out[:, :3, :3] @ matrices[:, :3, 3:]
    return out
