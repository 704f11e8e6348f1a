# SPDX-License-Identifier: GPL-3.0-or-later
"""Points on deforming meshes: the place of a polygon's point after the mesh's vertices have moved."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b
from itertools import product
from weakref import WeakValueDictionary

import bpy
import numpy as np

MAX_TRIANGLES = 64  # of a polygon that is searched for a point


class Topology:
    """triangles: [t, 3] vertex indices, those of polygon p from first[p] to first[p + 1]. Read only for a second mesh
    with the same corners, since most meshes never deform."""

    triangles: np.ndarray | None = None
    first: np.ndarray

    def read(self, mesh: bpy.types.Mesh) -> None:
        mesh.calc_loop_triangles()
        polygons = values_of(mesh.loop_triangle_polygons, "value")
        self.first = np.searchsorted(polygons, np.arange(len(mesh.polygons) + 1))
        self.triangles = values_of(mesh.loop_triangles, "vertices", 3).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Geometry:
    """vertices: [v, 3] float32, local. topology: of meshes only. box: [3, 9], corners and middle of the one around the
    vertices; NaN without any."""

    vertices: np.ndarray
    topology: Topology | None

    @cached_property
    def box(self) -> np.ndarray:
        if not len(self.vertices):
            return np.full((3, 9), np.nan)
        low, high = self.vertices.min(0), self.vertices.max(0)
        return np.array([*product(*zip(low, high, strict=True)), (low + high) / 2], float).T


class Geometries:
    """Returns the same Geometry for the same points while it is referenced elsewhere."""

    def __init__(self):
        self._geometries: WeakValueDictionary[tuple, Geometry] = WeakValueDictionary()
        self._topologies: WeakValueDictionary[tuple, Topology] = WeakValueDictionary()

    def geometry(self, data: bpy.types.ID) -> Geometry:
        """data: anything with positions; a mesh, curves, a point cloud."""
        mesh = isinstance(data, bpy.types.Mesh)
        points = values_of(data.attributes["position"].data, "vector", 3, np.float32) if len(data.attributes) else _none
        counts = (type(data).__name__, len(points), *((len(data.polygons), len(data.loops)) if mesh else ()))
        key = counts, _digest(points)
        if (geometry := self._geometries.get(key)) is None:
            geometry = Geometry(points.reshape(-1, 3), self._topology(data, counts) if mesh else None)
            self._geometries[key] = geometry
        return geometry

    def _topology(self, mesh: bpy.types.Mesh, counts: tuple) -> Topology:
        key = counts, _digest(values_of(mesh.loops, "vertex_index"))
        if (topology := self._topologies.get(key)) is None:
            topology = self._topologies[key] = Topology()
        elif topology.triangles is None:
            topology.read(mesh)
        return topology


_none = np.empty(0, np.float32)


def values_of(collection: bpy.types.bpy_prop_collection, key: str, per_item: int = 1, kind: type = np.int32):
    values = np.empty(per_item * len(collection), kind)
    collection.foreach_get(key, values)
    return values


def _digest(values: np.ndarray) -> bytes:
    return blake2b(values, digest_size=16).digest()


def carried(before: Geometry, after: Geometry, polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Moves points [3, n] in polygons [n] (-1: unknown) of `before` to `after`; NaN where the two do not correspond. A
    point off its triangle (on a surface that Cycles subdivides) keeps its distance."""
    topology, out = before.topology, np.full(points.shape, np.nan)
    if topology is None or topology is not after.topology or topology.triangles is None:
        return out
    first, count = topology.first[polygon], topology.first[polygon + 1] - topology.first[polygon]
    usable = (polygon >= 0) & (count <= MAX_TRIANGLES)
    inside = np.full(len(polygon), -np.inf)  # smallest barycentric coordinate, >= 0 in the point's own triangle
    for k in range(count[usable].max(initial=0)):
        these = np.flatnonzero(usable & (count > k) & (inside < 0))
        triangle = topology.triangles[first[these] + k]
        u, v, rest = _in_triangle(_corners(before.vertices, triangle), points[:, these])
        least = np.minimum(np.minimum(u, v), 1 - u - v)
        better = least > inside[these]  # False for NaN, in a triangle without area
        these = these[better]
        inside[these] = least[better]
        a, ab, ac = _corners(after.vertices, triangle[better])
        out[:, these] = a + u[better] * ab + v[better] * ac + rest[:, better]
    return out


def _corners(vertices: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A corner of each triangle [n, 3], and the two edges from it: [3, n] each."""
    a, b, c = (vertices[corner].T.astype(float) for corner in triangle.T)
    return a, b - a, c - a


def _in_triangle(corners: tuple, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights of the second and third corner, and the offset of the point from the plane."""
    a, ab, ac = corners
    p = points - a
    bb, bc, cc, pb, pc = (np.einsum("in,in->n", *pair) for pair in ((ab, ab), (ab, ac), (ac, ac), (p, ab), (p, ac)))
    with np.errstate(all="ignore"):
        area = bb * cc - bc * bc
        u, v = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
        return u, v, p - u * ab - v * ac
