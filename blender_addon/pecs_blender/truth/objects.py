# SPDX-License-Identifier: GPL-3.0-or-later
"""Id of the thing at a pixel's centre (things.py), and records of all things: pose, boxes, occlusion
(docs/reference/exr_stack.md)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..output import Layer, Output
from . import boxes, objects_json
from .surfaces import UNKNOWN, HitCache, Poses, SurfaceHits
from .things import Key, Thing, Things

DIGITS = 7  # decimal places, of pixels and metres


class Objects(Layer):
    name, channels, unit, at = "objects", ("instance",), "1", "instant"

    def __init__(self, hits: HitCache):
        self._hits, self._unit_m = hits, hits.stage.source.unit_m
        self._shapes = boxes.Shapes()
        self._things = Things(hits.stage.source.scene, hits.times_s, self._keys_at)
        self._content: dict[str, Any] = {}  # of the latest instant's file

    def _keys_at(self, things: Things, t_s: float) -> set[Key]:
        self._hits.surfaces.note = lambda instance, geometry: (
            things.key(instance),
            self._shapes.shape(instance.object.data, geometry),
        )
        self._hits.stage.set_time(t_s)
        return {key for key, _ in self._hits.surfaces.poses().notes}

    def is_written(self, output: Output, index: int) -> bool:
        return objects_json.one(output.folder, index).is_file() and super().is_written(output, index)

    def write(self, output: Output, index: int, *t_s: float) -> None:
        picture = self.render(*t_s)
        objects_json.write_json(objects_json.one(output.folder, index), self._content)
        output.write_layer(self.name, index, picture)

    def finish(self, output: Output) -> None:
        objects_json.join(output.folder, output.times_ns)

    def render(self, t_s: float) -> np.ndarray:
        seen = self._hits.at(t_s)
        things = [self._things.thing(key) for key, _ in seen.poses.notes]
        ids = self._ids(seen, np.array([thing.id if thing else 0 for thing in things] or [0]))
        parts: dict[Thing, list[boxes.Part]] = {}
        for thing, (_, shape), matrix in zip(things, seen.poses.notes, seen.poses.world_from_local, strict=True):
            if thing and len(shape.vertices):
                parts.setdefault(thing, []).append(boxes.Part(shape, matrix))
        ordered = sorted(parts, key=lambda thing: thing.id)
        self._content = {
            "t_ns": round(t_s * 1e9),
            "classes": {str(k): kind for kind, k in self._things.classes.items()},
            "objects": self._described(seen, ids, {thing: parts[thing] for thing in ordered}),
        }
        return ids[None].astype(np.float32)

    def _ids(self, seen: SurfaceHits, of_instance: np.ndarray) -> np.ndarray:
        """[h, w]"""
        ids = np.where(seen.instance >= 0, of_instance[seen.instance], 0)
        if (twice := seen.instance == UNKNOWN).any():
            ids[twice] = _by_place(seen.poses, seen.random[twice], seen.points[:, twice], of_instance)
        return ids

    def _described(
        self, seen: SurfaceHits, ids: np.ndarray, parts: dict[Thing, list[boxes.Part]]
    ) -> list[dict[str, Any]]:
        sight, view, size = self._hits.surfaces.sight, seen.poses.view, self._hits.stage.size
        outlines = boxes.Outlines(sight, view)
        for shapes in parts.values():
            outlines.add(shapes)
        hidden = boxes.Hidden(sight, seen, ids)
        counts, modal = boxes.seen_boxes(ids, max((thing.id for thing in parts), default=0))
        records = []
        for (thing, shapes), amodal in zip(parts.items(), outlines.boxes(), strict=True):
            world_from_object, low, high = boxes.own_box(shapes)
            world_from_object[:3, 3] *= self._unit_m
            visible, behind = int(counts[thing.id]), hidden.pixels(thing.id, shapes, amodal)
            kind = self._things.classes.get(thing.kind, 0)
            records.append(
                {
                    **{"id": thing.id, "name": thing.name, "class": thing.kind, "class_id": kind},
                    "size_m": _rounded((high - low) * self._unit_m),
                    "centre_local": _rounded((high + low) / 2 * self._unit_m),
                    "world_from_object": [_rounded(row) for row in world_from_object],
                    "box_px": _rounded(modal[thing.id]) if visible else None,
                    "amodal_px": None if amodal is None else _rounded(amodal),
                    "visible_px": visible,
                    "occluded": round(behind / (visible + behind), DIGITS) if behind else 0.0,
                    "truncated": round(boxes.outside(amodal, size), DIGITS),
                }
            )
        return records


def _rounded(values: Any) -> list[float]:
    return [round(float(v), DIGITS) + 0.0 for v in values]


def _by_place(poses: Poses, random: np.ndarray, points: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Ids [n] of the things at points [3, n] in camera axes whose Random [n] is not unique: the instance whose box
    contains the point or is nearest to it."""
    nearest, distance = np.zeros(random.shape, ids.dtype), np.full(random.shape, np.inf)
    for i in np.flatnonzero(np.isin(poses.ids, random)):
        these = np.flatnonzero(random == poses.ids[i])
        vertices = poses.geometries[poses.geometry[i]].vertices
        if not these.size or not len(vertices):
            continue
        camera_from_local = poses.view.camera_from_world @ poses.world_from_local[i]
        back = np.linalg.pinv(camera_from_local[:3, :3])
        local = back @ (points[:, these] - camera_from_local[:3, 3:])
        low, high = vertices.min(0)[:, None], vertices.max(0)[:, None]
        off = np.linalg.norm(np.maximum(np.maximum(low - local, local - high), 0), axis=0)
        off = off + 1e-6 * np.linalg.norm(local - (low + high) / 2, axis=0)
        nearer = off < distance[these]
        nearest[these[nearer]], distance[these[nearer]] = ids[i], off[nearer]
    return nearest
