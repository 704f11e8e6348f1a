# SPDX-License-Identifier: GPL-3.0-or-later
"""Which surface point each pixel's centre sees, and where on the film those points are at another instant.

A companion scene of the same objects is rendered by Cycles with one sample along chief rays (scene/sight.py), all
surfaces in one material that says which instance is hit (Object Info's Random) and which polygon (an attribute, which
only the companion's evaluated meshes get: neither the file nor the light's render has it). A point is then carried by
its instance's matrix, or by the triangle of a mesh that deforms.

Not known: what an instance does that the other instant lacks, or whose Random another has too; meshes whose topology
changes; hair, curves and points that move by themselves; panoramic cameras that move. Lamps are looked through, and
transparent surfaces are seen where they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from . import cycles
from .job import Job
from .mesh_points import Geometries, Geometry, carried
from .sight import Sight, View, transformed

SKY, UNKNOWN = -1, -2
INSTANCE, POLYGON = "pecs_instance", "pecs_polygon"
MAX_POLYGONS = 1 << 24  # a float32 holds their numbers


@dataclass(frozen=True)
class Poses:
    """All instances at one instant. ids: [n] float32, rising, as Cycles' Random; world_from_local: [n, 4, 4];
    geometry: index into geometries of each, -1 for what has no points."""

    view: View
    ids: np.ndarray
    world_from_local: np.ndarray
    geometry: np.ndarray
    geometries: list[Geometry]

    def find(self, ids: np.ndarray) -> np.ndarray:
        """Their indices; UNKNOWN for what is not here, or twice."""
        if not self.ids.size:
            return np.full(ids.shape, UNKNOWN)
        at = np.searchsorted(self.ids, ids)
        last = np.searchsorted(self.ids, ids, "right") - 1
        return np.where(last == at, at, UNKNOWN)


@dataclass(frozen=True)
class Seen:
    """poses: of the same instant. depth: [h, w] along the optical axis [m], infinite where there is no surface.
    instance: [h, w] index into poses, SKY or UNKNOWN. points: [3, h, w] in camera axes. polygon: [h, w] from 0, -1
    where it is not known."""

    poses: Poses
    depth: np.ndarray
    instance: np.ndarray
    points: np.ndarray
    polygon: np.ndarray


class Surfaces:
    """scale: of the picture that it looks at, 1/4 for a quarter of the pixels in x and y."""

    def __init__(self, job: Job, scratch: Path, scale: float = 1.0, name: str = "surfaces"):
        size = tuple(max(1, round(n * scale)) for n in job.size)
        self._job, self._scene = job, _companion(job.source.scene, size)
        render = self._scene.render
        render.pixel_aspect_x, render.pixel_aspect_y = np.array(job.size) / size  # where the scale does not divide it
        self._sight, self._film = Sight(job, scratch, name, self._scene, size), cycles.Film(self._scene)
        self._geometries = Geometries()
        self.size = size

    def centres(self) -> np.ndarray:
        """[2, h, w]: film x, y of the pixels' centres."""
        return self._sight.centres()

    def seen(self) -> Seen:
        """At the instant at which the job's scene stands."""
        self._follow()
        found = []
        passes = self._film.passes("Position", "Depth", INSTANCE, POLYGON, look=lambda d: found.append(self._poses(d)))
        poses = found[-1]
        points = self._sight.points(poses.view, passes["Position"].astype(float))
        surface = passes["Depth"][0] < cycles.NO_SURFACE
        depth = np.where(surface, points[2] * self._job.source.unit_m, np.inf)
        instance = np.where(surface, poses.find(passes[INSTANCE][0]), SKY)
        return Seen(poses, depth, instance.astype(np.int32), points, passes[POLYGON][0].astype(np.int32) - 1)

    def poses(self) -> Poses:
        """At the instant at which the job's scene stands."""
        self._follow()
        found = []
        self._film.look(lambda d: found.append(self._poses(d)))
        return found[-1]

    def place(self, seen: Seen, poses: Poses) -> np.ndarray:
        """[3, h, w] float64: film x, y [px of this picture; pixel centres at .5] and depth z [m] of the points seen, at
        the poses' instant; NaN where it is not known. Bit by bit the pixel's centre where nothing moves."""
        before, view, instance = seen.poses, poses.view, seen.instance.ravel()
        out = np.full((3, instance.size), np.nan)
        centres, points = self.centres().reshape(2, -1), seen.points.reshape(3, -1)
        known = np.flatnonzero(instance >= 0)
        moves = _Moves(before, poses)
        still = known[moves.still[instance[known]]]
        out[:2, still], out[2, still] = centres[:, still], points[2, still]
        moving = known[moves.moving[instance[known]]]
        if moving.size:
            now = moves(instance[moving], points[:, moving], seen.polygon.ravel()[moving])
            out[:2, moving], out[2, moving] = self._sight.film(view, now), now[2]
        out[2] *= self._job.source.unit_m
        self._place_sky(before.view, view, np.flatnonzero(instance == SKY), centres, out)
        return out.reshape(3, *seen.instance.shape)

    def _place_sky(self, before: View, view: View, sky: np.ndarray, centres: np.ndarray, out: np.ndarray) -> None:
        """It turns with the camera, and is the same along all rays of an orthographic one."""
        rays = self._sight.rays(before)
        out[2, sky] = np.inf
        if before.same(view) or (rays is not None and not rays[1].any()):
            out[:2, sky] = centres[:, sky]
        elif rays is not None:
            along = np.vstack([rays[1].reshape(2, -1)[:, sky], np.ones((1, sky.size))])
            turned = (view.camera_from_world @ np.linalg.inv(before.camera_from_world))[:3, :3] @ along
            dark = np.isnan(turned[0])  # no ray of the lens arrives: nothing is seen, ever
            out[:2, sky] = np.where(dark, centres[:, sky], self._sight.film(view, turned, infinite=True))

    def _follow(self) -> None:
        """The companion to the instant of the job's scene."""
        scene, own = self._scene, self._job.source.scene
        scene.frame_current, scene.frame_subframe = own.frame_current, own.frame_subframe
        scene.camera = self._sight.camera()

    def _poses(self, depsgraph: bpy.types.Depsgraph) -> Poses:
        ids, matrices, geometry, found, numbers = [], [], [], [], {}
        for instance in depsgraph.object_instances:
            thing = instance.object
            data = thing.data
            if not isinstance(data, (bpy.types.Mesh, bpy.types.Curves, bpy.types.PointCloud)):
                continue
            key = data.as_pointer()
            if key not in numbers:
                numbers[key] = len(found)
                found.append(self._geometries.of(data))
                _number_polygons(data)
            ids.append(instance.random_id & 0xFFFFFFFF if instance.is_instance else _name_id(thing.name))
            matrices.append([v for row in instance.matrix_world for v in row])
            geometry.append(numbers[key])
        random = np.array(ids, np.uint32).astype(np.float32) * np.float32(2.0**-32)
        order = np.argsort(random, kind="stable")
        world = np.array(matrices, float).reshape(-1, 4, 4)
        return Poses(self._sight.view(depsgraph), random[order], world[order], np.array(geometry, int)[order], found)


class _Moves:
    """From camera axes to camera axes, from one instant to another. still: [n] instances that stay as they are, bit by
    bit, before the same camera; moving: the others, as far as they are there."""

    def __init__(self, before: Poses, after: Poses):
        self._before, self._after = before, after
        found = after.find(before.ids)
        there = found >= 0
        self._there = at = np.where(there, found, 0)
        if not after.ids.size:
            self.still = self.moving = there
            return
        one, other = (np.array([id(g) for g in poses.geometries]) for poses in (before, after))
        self._deforms = one[before.geometry] != other[after.geometry[at]]
        unmoved = (before.world_from_local == after.world_from_local[at]).all((1, 2))
        self.still = there & unmoved & ~self._deforms & before.view.same(after.view)
        self.moving = there & ~self.still

    def __call__(self, instance: np.ndarray, points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
        """points [3, n] of instances [n], in polygons [n]; NaN where it is not known."""
        before, after = self._before, self._after
        used = np.flatnonzero(np.bincount(instance, minlength=len(before.ids)))
        short = np.searchsorted(used, instance)
        local_from_camera = _inverse(before.world_from_local[used]) @ np.linalg.inv(before.view.camera_from_world)
        camera_from_local = after.view.camera_from_world @ after.world_from_local[self._there[used]]
        now = _each(camera_from_local @ local_from_camera, short, points)
        if self._deforms[used].any():
            for k, one in enumerate(used):
                if self._deforms[one]:
                    of = np.flatnonzero(short == k)
                    geometries = (
                        before.geometries[before.geometry[one]],
                        after.geometries[after.geometry[self._there[one]]],
                    )
                    local = carried(*geometries, polygon[of], transformed(local_from_camera[k], points[:, of]))
                    now[:, of] = transformed(camera_from_local[k], local)
        return now


def _each(matrices: np.ndarray, index: np.ndarray, points: np.ndarray) -> np.ndarray:
    """matrices[index] of points [3, n]"""
    if len(matrices) == 1:
        return transformed(matrices[0], points)
    rows = [sum(matrices[index, r, c] * points[c] for c in range(3)) + matrices[index, r, 3] for r in range(3)]
    return np.stack(rows)


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Of [n, 4, 4]; a flattened axis stays flat."""
    out = np.tile(np.eye(4), (len(matrices), 1, 1))
    out[:, :3, :3] = np.linalg.pinv(matrices[:, :3, :3], rcond=1e-6)
    out[:, :3, 3:] = -out[:, :3, :3] @ matrices[:, :3, 3:]
    return out


def _number_polygons(data: bpy.types.ID) -> None:
    """In an evaluated mesh."""
    if isinstance(data, bpy.types.Mesh) and 0 < len(data.polygons) < MAX_POLYGONS and POLYGON not in data.attributes:
        numbers = np.arange(1, len(data.polygons) + 1, dtype=np.float32)
        data.attributes.new(POLYGON, "FLOAT", "FACE").data.foreach_set("value", numbers)


def _name_id(name: str) -> int:
    """Cycles' Random of an object that is no instance (util/hash.h: a string's hash, and Jenkins' lookup3 of it)."""
    key = 0
    for byte in name.encode():
        key = key * 37 + (byte if byte < 128 else byte - 256)
    mask = 0xFFFFFFFF
    start = (0xDEADBEEF + (2 << 2) + 13) & mask
    state = {"a": (start + key) & mask, "b": start, "c": start}
    for of, by, turn in zip("cabcabc", "bcabcab", (14, 11, 25, 16, 4, 14, 24), strict=True):
        other = state[by]
        state[of] = ((state[of] ^ other) - ((other << turn) | (other >> (32 - turn)))) & mask
    return state["c"]


def _companion(scene: bpy.types.Scene, size: tuple[int, int]) -> bpy.types.Scene:
    """The same objects and collections, for Cycles to look at apart from the light."""
    companion = scene.copy()
    companion.world = None
    companion.timeline_markers.clear()  # they would change the camera
    companion.render.resolution_x, companion.render.resolution_y = size
    companion.render.use_border = False
    for key, value in {"samples": 1, "max_bounces": 0, "use_denoising": False, "filter_width": 0.01}.items():
        setattr(companion.cycles, key, value)
    layer = companion.view_layers[0]
    for p in layer.bl_rna.properties:
        if p.identifier.startswith("use_pass_"):
            setattr(layer, p.identifier, p.identifier in ("use_pass_position", "use_pass_z"))
    layer.samples = 0  # as the scene
    while layer.aovs:
        layer.aovs.remove(layer.aovs[0])
    for name in (INSTANCE, POLYGON):
        layer.aovs.add().name = name
        layer.aovs[-1].type = "VALUE"
    layer.material_override = _material()
    return companion


def _material() -> bpy.types.Material:
    material = bpy.data.materials.new("pecs surfaces")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    instance, polygon = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeAttribute")
    polygon.attribute_name = POLYGON
    for name, socket in ((INSTANCE, instance.outputs["Random"]), (POLYGON, polygon.outputs["Fac"])):
        node = tree.nodes.new("ShaderNodeOutputAOV")
        node.aov_name = name
        tree.links.new(socket, node.inputs["Value"])
    return material
