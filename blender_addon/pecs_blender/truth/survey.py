# SPDX-License-Identifier: GPL-3.0-or-later
"""Points on the surfaces of a scene, for planning outside Blender (docs/reference/render.md).

The number of points of a thing is proportional to its area. They are spread in equal steps of area over its triangles,
and within a triangle by the R2 sequence (Roberts 2018), so they are even and the same in every run. Things that neither
move nor deform at any instant are written once.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from pecs._errors import UsageError
from pecs._files import write_whole

from ..scene import cycles
from ..scene.source import Source
from ..scene.timeline import timeline
from .boxes import Shape, Shapes
from .mesh_points import Geometries, Geometry
from .surfaces import renders
from .things import Key, Things

POINTS = 200_000  # default, at the first instant
MAX_POINTS = 50_000_000  # at all instants together
MIN_POINTS = 64  # of a part of a thing
R2 = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True)
class Instance:
    key: Key
    geometry: Geometry
    shape: Shape
    world_from_local: np.ndarray  # [4, 4] to metres

    def same(self, other: Instance) -> bool:
        return self.geometry is other.geometry and np.array_equal(self.world_from_local, other.world_from_local)

    def vertices(self) -> np.ndarray:
        """[v, 3], world coordinates."""
        return self.shape.vertices.astype(float) @ self.world_from_local[:3, :3].T + self.world_from_local[:3, 3]

    def corners(self) -> np.ndarray:
        """[t, 3, 3]: corners of the triangles, world coordinates."""
        return self.vertices()[self.shape.triangles]

    def extent(self) -> np.ndarray:
        """[2, 3]: lowest and highest corner."""
        world = self.vertices()
        return np.array([world.min(0), world.max(0)])


def survey(source: Source, output: Path, frames: str | None, fps: float, spacing_m: float | None) -> None:
    """frames: as for a render; None for the scene's period or range."""
    if not output.absolute().parent.is_dir():
        raise UsageError(f"-o {output}: the folder does not exist")
    whole = "period" if source.period_s else "all" if source.duration_s else "1"
    times_s = [t * 1e-9 for t in timeline(frames or whole, fps, source.period_s, source.duration_s).times_ns]
    eye = _Eye(source)
    things = Things(source.scene, times_s, lambda things, t_s: {i.key for i in eye.instances(things, t_s)})
    instants = [eye.instances(things, t_s) for t_s in times_s]
    spacing_m = spacing_m or _spacing_m(instants[0])
    still = _still(instants)
    counts = ((one.key, _count(_areas(one.corners()), spacing_m)) for one in instants[0])
    count = sum(n if key in still else n * len(times_s) for key, n in counts)
    if count > MAX_POINTS:
        raise UsageError(f"--spacing: got about {count:.2g} points, wanted at most {MAX_POINTS:.2g}")
    sampled = [_sampled([i for i in instances if i.key not in still], things, spacing_m) for instances in instants]
    static = _sampled([i for i in instants[0] if i.key in still], things, spacing_m)
    extents = np.array([one.extent() for instances in instants for one in instances]).reshape(-1, 2, 3)
    bounds = [extents[:, 0].min(0), extents[:, 1].max(0)] if len(extents) else np.zeros((2, 3))
    arrays = dict(
        times_s=np.array(times_s),
        first=np.cumsum([0, *(len(part[0]) for part in sampled)]),
        **dict(zip(("points", "normals", "objects"), map(np.concatenate, zip(*sampled, strict=True)), strict=True)),
        **dict(zip(("static_points", "static_normals", "static_objects"), static, strict=True)),
        bounds_m=np.array(bounds),
        spacing_m=np.array(spacing_m),
        unit_m=np.array(source.unit_m),
        period_s=np.array(source.period_s or np.nan),
        duration_s=np.array(source.duration_s or np.nan),
        ids=np.array([thing.id for thing in things], np.int32),
        names=np.array([thing.name for thing in things], str),
        classes=np.array([thing.kind or "" for thing in things], str),
    )
    data = io.BytesIO()  # zipfile reports a full disk badly
    np.savez(data, **arrays)
    write_whole(output, data.getvalue())


class _Eye:
    """Finds the instances that Cycles would render, without rendering."""

    def __init__(self, source: Source):
        self._source, self._geometries, self._shapes = source, Geometries(), Shapes()
        cycles.configure(source.scene, 8, 8, cycles.Sampling(samples=1, seed=0, bounces=source.bounces))
        source.set_time(0.0)
        source.make_camera(50.0, 36.0)  # without one, Blender renders nothing
        self._film = cycles.Film(source.scene)

    def instances(self, things: Things, t_s: float) -> list[Instance]:
        instances: list[Instance] = []
        self._source.set_time(t_s)
        self._film.inspect(lambda depsgraph: instances.extend(self._all(depsgraph, things)))
        return sorted(instances, key=lambda instance: instance.key)

    def _all(self, depsgraph: bpy.types.Depsgraph, things: Things):
        metres = np.diag([*[self._source.unit_m] * 3, 1.0])
        for instance in renders(depsgraph):
            data = instance.object.data
            geometry = self._geometries.geometry(data)
            if len(geometry.vertices):
                matrix = metres @ np.array(instance.matrix_world, float)
                yield Instance(things.key(instance), geometry, self._shapes.shape(data, geometry), matrix)


def _still(instants: list[list[Instance]]) -> set[Key]:
    """Keys of instances that are the same at all instants."""
    by_key: list[dict[Key, list[Instance]]] = []
    for instances in instants:
        by_key.append({})
        for one in instances:
            by_key[-1].setdefault(one.key, []).append(one)

    def same(key: Key) -> bool:
        first = by_key[0][key]
        return all(
            len(parts := instant.get(key, [])) == len(first) and all(map(Instance.same, first, parts))
            for instant in by_key
        )

    return {key for key in by_key[0] if same(key)}


def _spacing_m(instances: list[Instance]) -> float:
    area = sum(_areas(one.corners()).sum() for one in instances)
    return float(f"{max(area / POINTS, 1e-12) ** 0.5:.3g}")


def _areas(corners: np.ndarray) -> np.ndarray:
    """[t]"""
    return np.linalg.norm(_across(corners), axis=1) / 2


def _across(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _count(areas: np.ndarray, spacing_m: float) -> int:
    total = float(areas.sum())
    return max(MIN_POINTS, int(np.ceil(total / spacing_m**2))) if total > 0 else 0


def _steps(areas: np.ndarray, spacing_m: float) -> np.ndarray:
    """Index of each point's triangle."""
    count = _count(areas, spacing_m)
    at = (np.arange(count) + 0.5) / max(1, count) * areas.sum()
    return np.minimum(np.searchsorted(np.cumsum(areas), at), len(areas) - 1)


def _sampled(instances: list[Instance], things: Things, spacing_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points [n, 3] and normals [n, 3] float32, ids [n] int32. Hair and point clouds have their own points, normals
    0."""
    points, normals, numbers = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    for one in instances:
        thing = things.thing(one.key)
        corners = one.corners()
        which = _steps(_areas(corners), spacing_m)
        if len(which):
            u, v = ((np.arange(len(which))[:, None] + 1) * R2 % 1).T
            fold = u + v > 1
            u, v = np.where(fold, 1 - u, u)[:, None], np.where(fold, 1 - v, v)[:, None]
            a, b, c = (corners[which, k] for k in range(3))
            points.append(a + u * (b - a) + v * (c - a))
            across = _across(corners)[which]
            normals.append(across / np.linalg.norm(across, axis=1, keepdims=True))
        else:
            points.append(one.vertices())
            normals.append(np.zeros_like(points[-1]))
        numbers.append(np.full(len(points[-1]), thing.id if thing else 0))
    kinds = (points, np.float32), (normals, np.float32), (numbers, np.int32)
    return tuple(np.concatenate(values).astype(kind) for values, kind in kinds)
