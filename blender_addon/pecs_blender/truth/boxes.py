# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes around things, in their own axes and on the film through the camera's image map, and their occlusion.

Camera axes and film coordinates are those of sight.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..camera.sight import Sight, Viewpoint, transformed
from .mesh_points import Geometry, values_of
from .surfaces import SurfaceHits

NEAREST = 1e-2  # depth at which things are clipped, relative to their largest coordinate
EDGE_PX = 8.0  # distance of points along edges, which a lens bends
MAX_PIECES = 256  # of an edge
MAX_RAYS = 2048  # per thing, for occlusion; of more pixels, every second, third, … gets a ray
SAME_DEPTH = 1e-4  # relative

Box = list[float]  # left, top, right, bottom [px]


@dataclass(eq=False)
class Shape:
    """A Geometry with edges [e, 2] and triangles [t, 3] into vertices [v, 3], in local axes; empty if not a mesh."""

    vertices: np.ndarray
    edges: np.ndarray
    triangles: np.ndarray

    @cached_property
    def tree(self) -> BVHTree:
        return BVHTree.FromPolygons(self.vertices.tolist(), self.triangles.tolist(), all_triangles=True)


class Shapes:
    """One Shape per Geometry, while it is referenced elsewhere."""

    def __init__(self) -> None:
        self._shapes: WeakKeyDictionary[Geometry, Shape] = WeakKeyDictionary()

    def shape(self, data: bpy.types.ID, geometry: Geometry) -> Shape:
        if geometry not in self._shapes:
            self._shapes[geometry] = _shape(data, geometry)
        return self._shapes[geometry]


def _shape(data: bpy.types.ID, geometry: Geometry) -> Shape:
    if not isinstance(data, bpy.types.Mesh):
        return Shape(geometry.vertices, np.empty((0, 2), np.int32), np.empty((0, 3), np.int32))
    edges = values_of(data.edges, "vertices", 2).reshape(-1, 2)
    return Shape(geometry.vertices, edges, _triangles(data, geometry.vertices))


def _triangles(mesh: bpy.types.Mesh, vertices: np.ndarray) -> np.ndarray:
    """[t, 3], in an order that depends only on the corners' positions: Blender creates a primitive's polygons in
    another order, with another first corner, each time."""
    mesh.calc_loop_triangles()
    place = np.empty(len(vertices), np.int64)
    place[np.lexsort(vertices.T)] = np.arange(len(vertices))
    corners, first = values_of(mesh.loops, "vertex_index"), values_of(mesh.polygons, "loop_start")
    count = values_of(mesh.polygons, "loop_total")
    quads = _begun_at_lowest(corners[first[count == 4][:, None] + np.arange(4)], place)
    a, b, c, d = (vertices[quads[:, k]] for k in range(4))
    dented = np.einsum("ni,ni->n", np.cross(b - a, c - a), np.cross(c - a, d - a)) < 0
    quads[dented] = np.roll(quads[dented], -1, axis=1)
    of_quad = count[values_of(mesh.loop_triangle_polygons, "value")] == 4
    others = values_of(mesh.loop_triangles, "vertices", 3).reshape(-1, 3)[~of_quad]
    triangles = np.concatenate([_begun_at_lowest(others, place), quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return triangles[np.lexsort(place[triangles].T[::-1])]


def _begun_at_lowest(polygons: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Polygons [n, k], rotated to begin at their lowest corner."""
    turn = place[polygons].argmin(1)[:, None] if len(polygons) else np.empty((0, 1), int)
    return np.take_along_axis(polygons, (np.arange(polygons.shape[1]) + turn) % polygons.shape[1], 1)


@dataclass(frozen=True)
class Part:
    """A part of a thing."""

    shape: Shape
    world_from_local: np.ndarray


def axes(world_from_local: np.ndarray) -> np.ndarray:
    """[3, 3]: rotation from local axes without their scale to the world. Of sheared axes, it keeps the first axis and
    the plane of the first two."""
    turn, scale = np.linalg.qr(world_from_local[:3, :3])
    turn = turn * np.where(np.diag(scale) < 0, -1.0, 1.0)
    if np.linalg.det(turn) < 0:  # mirrored
        turn[:, 2] = -turn[:, 2]
    return turn


def own_box(parts: list[Part]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """world_from_object [4, 4] of the first part, and lowest and highest corner [3] of all parts in these axes, in the
    scene's unit."""
    world_from_object = parts[0].world_from_local.copy()
    world_from_object[:3, :3] = axes(parts[0].world_from_local)
    back = np.linalg.inv(world_from_object)
    points = np.concatenate(
        [transformed(back @ p.world_from_local, p.shape.vertices.T.astype(float)) for p in parts], axis=1
    )
    if not points.size:
        return world_from_object, np.zeros(3), np.zeros(3)
    return world_from_object, points.min(1), points.max(1)


class Outlines:
    """Points whose images bound things, for one view."""

    def __init__(self, sight: Sight, view: Viewpoint):
        self._sight, self._view, self._points, self._counts = sight, view, [], []
        rays = sight.rays(view) if view.lens else None
        self._px = np.nan if rays is None else sight.size[0] / np.ptp(rays[1][0][np.isfinite(rays[1][0])])

    def add(self, parts: list[Part]) -> None:
        points = np.concatenate([self._of(part) for part in parts], axis=1)
        self._points.append(points)
        self._counts.append(points.shape[1])

    def boxes(self) -> list[Box | None]:
        """One box per thing, in their order; None if the thing is behind the camera."""
        points = np.concatenate([*self._points, np.empty((3, 0))], axis=1)
        film = self._sight.film(self._view, points, np.zeros(points.shape[1], bool))
        return [_bounds(part) for part in np.split(film, np.cumsum(self._counts)[:-1], axis=1)][: len(self._counts)]

    def _of(self, part: Part) -> np.ndarray:
        """[3, n] in camera axes."""
        points = transformed(self._view.camera_from_world @ part.world_from_local, part.shape.vertices.T.astype(float))
        clip = self._view.clip_from_camera
        is_orthographic = clip is not None and not clip[3, :3].any()
        near = 0.0 if is_orthographic else NEAREST * np.abs(points).max(initial=0)
        ahead = points[2] > near
        a, b = (points[:, part.shape.edges[:, k]] for k in (0, 1))
        crossing = ahead[part.shape.edges[:, 0]] != ahead[part.shape.edges[:, 1]]
        f = (near - a[2, crossing]) / (b[2, crossing] - a[2, crossing])
        cut = a[:, crossing] + f * (b[:, crossing] - a[:, crossing])
        return np.concatenate([points[:, ahead], cut, *self._along(a, b, near)], axis=1)

    def _along(self, a: np.ndarray, b: np.ndarray, near: float) -> list[np.ndarray]:
        """Points on edges, which a lens bends, at z = 1: its rays meet in one point."""
        if not self._view.lens or not a.size:
            return []
        some = (a[2] > near) | (b[2] > near)
        a, b = a[:, some], b[:, some]
        for one, other in ((a, b), (b, a)):
            behind = one[2] <= near
            f = (near - one[2, behind]) / (other[2, behind] - one[2, behind])
            one[:, behind] += f * (other[:, behind] - one[:, behind])
        a, b = a[:2] / a[2], b[:2] / b[2]
        pieces = np.clip(np.hypot(*(b - a)) * self._px / EDGE_PX, 1, MAX_PIECES).astype(int)
        which = np.repeat(np.arange(len(pieces)), pieces - 1)
        first = np.cumsum(pieces - 1) - (pieces - 1)
        f = (np.arange(len(which)) - first[which] + 1) / pieces[which]
        return [np.vstack([a[:, which] + f * (b - a)[:, which], np.ones((1, len(which)))])]


def _bounds(film: np.ndarray) -> Box | None:
    known = film[:, np.isfinite(film).all(0)]
    return [*known.min(1), *known.max(1)] if known.size else None


def seen_boxes(ids: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Number of pixels [count + 1] with each id in a picture [h, w], and their boxes [count + 1, 4]."""
    height, width = ids.shape
    flat, (y, x) = ids.ravel(), np.indices(ids.shape).reshape(2, -1)
    boxes = np.tile([width, height, 0, 0], (count + 1, 1))
    for axis, places in enumerate((x, y)):
        np.minimum.at(boxes[:, axis], flat, places)
        np.maximum.at(boxes[:, 2 + axis], flat, places + 1)
    return np.bincount(flat, minlength=count + 1), boxes


def outside(box: Box | None, size: tuple[int, int]) -> float:
    """Fraction of a box outside the picture; 1 without a box."""
    if box is None:
        return 1.0
    share = 1.0
    for low, high, end in ((box[0], box[2], size[0]), (box[1], box[3], size[1])):
        inside = max(0.0, min(high, end) - max(low, 0.0))
        share *= inside / (high - low) if high > low else float(0 <= low <= end)
    return 1 - share


class Hidden:
    """Occlusion of a thing by others, from chief rays that are intersected with the thing alone."""

    def __init__(self, sight: Sight, seen: SurfaceHits, ids: np.ndarray):
        self._seen, self._ids, self._view = seen, ids, seen.poses.view
        self._rays = sight.rays(self._view)

    def pixels(self, thing: int, parts: list[Part], box: Box | None) -> int:
        """Approximate number of pixels whose rays hit the thing behind the visible surface."""
        parts = [part for part in parts if len(part.shape.triangles)]
        if self._rays is None or box is None or not parts:
            return 0
        height, width = self._ids.shape
        left, top = (max(0, int(np.floor(v))) for v in box[:2])
        right, bottom = min(width, int(np.ceil(box[2]))), min(height, int(np.ceil(box[3])))
        if left >= right or top >= bottom:
            return 0
        part = np.s_[top:bottom, left:right]
        other = (self._ids[part] != thing) & np.isfinite(self._seen.depth[part])
        y, x = np.nonzero(other & np.isfinite(self._rays[1][0][part]))
        step = -(-len(y) // MAX_RAYS) or 1
        y, x = y[::step] + top, x[::step] + left
        met = np.zeros(len(y), bool)
        for one in parts:
            met |= self._meets(one, y, x)
        return int(met.sum()) * step

    def _meets(self, part: Part, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        camera_from_local = self._view.camera_from_world @ part.world_from_local
        if abs(np.linalg.det(camera_from_local[:3, :3])) < 1e-12:
            return np.zeros(len(y), bool)
        local_from_camera, (origins, along) = np.linalg.inv(camera_from_local), self._rays
        starts = transformed(local_from_camera, np.vstack([origins[:, y, x], np.zeros((1, len(y)))]))
        ways = local_from_camera[:3, :3] @ np.vstack([along[:, y, x], np.ones((1, len(y)))])
        ways /= np.linalg.norm(ways, axis=0)
        cast = part.shape.tree.ray_cast
        far = [cast(start, way)[3] for start, way in zip(starts.T.tolist(), ways.T.tolist(), strict=True)]
        met = starts + np.array(far, float) * ways  # NaN without a hit
        depths = transformed(camera_from_local, met)[2]
        return depths >= self._seen.points[2, y, x] * (1 - SAME_DEPTH)
