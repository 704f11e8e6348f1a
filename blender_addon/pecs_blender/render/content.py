# SPDX-License-Identifier: GPL-3.0-or-later
"""A digest of what a .blend's scene contains, so that an edited scene does not continue the stack of another one.

It covers objects, meshes, materials, lamps, the world, actions and the files that these read, as Blender's RNA shows
them: all properties that can be written, except what only windows show. Not their addresses and not the bytes of the
.blend, which differ each time it is saved. Not covered: painted particles, and caches of simulations.
"""

from __future__ import annotations

import hashlib
from collections import deque
from functools import cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from pecs._files import sha256

SCENE = ("camera", "collection", "world", "frame_start", "unit_settings", "gravity", "rigidbody_world", "use_gravity")
OF_WINDOWS = (
    "active_",
    "open_",
    "panels",
    "show_",
    "select",
    "hide_select",
    "hide_viewport",
    "lock_",
    "matrix_",
    "display",
)
OF_NODES = {"location", "location_absolute", "width", "height", "hide", "label", "color", "parent", "use_custom_color"}
LEFT_OUT = {
    *(p.identifier for p in bpy.types.ID.bl_rna.properties if p.identifier != "name"),
    *("rna_type", "pixels", "filepath", "filepath_raw", "packed_file", "packed_files", "render_slots", "preview"),
    *("particles", "child_particles", "motion_path", "animation_visualization", "mode", "dimensions", "bound_box"),
    *("annotation", "grease_pencil", "view_center", "render_time", "point_cache", "is_editmode", "edit_bones"),
}
ARRAYS = {  # read as one: of the collection's items
    bpy.types.FCurve: {"keyframe_points": ("co", "handle_left", "handle_right", "interpolation", "easing")},
    bpy.types.ShapeKey: {"data": ("co",), "points": ()},
}
GEOMETRY = (bpy.types.Mesh, bpy.types.Curves, bpy.types.PointCloud)
OF_GEOMETRY = {"materials", "shape_keys", "animation_data"}  # the rest of it is in its attributes
EXTENDED = (bpy.types.ID, bpy.types.Bone, bpy.types.PoseBone)  # to which add-ons add properties
RUNTIME = {"cycles"}  # those that renders depend on


def digest(scene: bpy.types.Scene) -> str:
    """SHA-256 of the scene at its first frame, which becomes the current one."""
    scene.frame_set(scene.frame_start)
    walk = _Walk()
    for name in SCENE:
        walk.add(name)
        walk.value(getattr(scene, name, None))
    walk.value(scene.animation_data)
    walk.value(scene.view_layers[0].layer_collection)
    walk.add(scene.render.fps, scene.render.fps_base)
    return walk.to_the_end()


class _Walk:
    """Structures are numbered as they are met, and read in that order: chains of parents may be long."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._numbers: dict[tuple[str, int], int] = {}
        self._met: deque[bpy.types.bpy_struct] = deque()

    def to_the_end(self) -> str:
        while self._met:
            self._read(self._met.popleft())
        return self._hash.hexdigest()

    def add(self, *values: Any) -> None:
        self._hash.update(repr(values).encode())

    def value(self, value: Any) -> None:
        if isinstance(value, bpy.types.bpy_struct):
            key = type(value).__name__, value.as_pointer()
            if key not in self._numbers:
                self._met.append(value)
            self.add(key[0], self._numbers.setdefault(key, len(self._numbers)))
        elif isinstance(value, float):
            self.add(f"{value:.6g}")
        elif hasattr(value, "__len__") and not isinstance(value, (str, bytes, set)):
            for one in value:
                self.value(one)
        else:
            self.add(sorted(value) if isinstance(value, set) else value)

    def _read(self, thing: bpy.types.bpy_struct) -> None:
        for name, keys in _properties(type(thing)).items():
            self.add(name)
            self._property(thing, name, keys)
        self._own_properties(thing)
        if isinstance(thing, GEOMETRY):
            self._geometry(thing)
        if isinstance(thing, bpy.types.Object) and thing.type == "MESH" and thing.vertex_groups:
            self.add([[(g.group, round(g.weight, 5)) for g in v.groups] for v in thing.data.vertices])
        self._files(thing)

    def _property(self, thing: bpy.types.bpy_struct, name: str, keys: tuple[str, ...] | None) -> None:
        try:
            value = getattr(thing, name)
        except (AttributeError, RuntimeError, TypeError, ValueError):  # an enum without a valid value
            return
        if keys is None:
            self.value(value)
        for key in keys or ():
            self._array(value, key)

    def _array(self, items: Any, key: str) -> None:
        if not len(items):
            return
        first = getattr(items[0], key)
        is_int = isinstance(first, (int, str))  # enums are numbers here
        values = np.empty(np.size(first) * len(items), np.int32 if is_int else np.float32)
        items.foreach_get(key, values)
        self.add(key, len(items))
        self._hash.update(values)

    def _geometry(self, data: bpy.types.ID) -> None:
        if isinstance(data, bpy.types.Mesh):
            self._array(data.polygons, "loop_start")
        for attribute in data.attributes:
            if not (attribute.name.startswith(".select") or attribute.data_type == "STRING") and len(attribute.data):
                self.add(attribute.name, attribute.domain)
                key = next(k for k in ("value", "vector", "color") if hasattr(attribute.data[0], k))
                self._array(attribute.data, key)

    def _own_properties(self, thing: bpy.types.bpy_struct) -> None:
        try:
            keys = sorted(thing.keys())
        except TypeError:  # a type that has none
            return
        for key in keys:
            if not hasattr(thing[key], "to_dict"):  # of a group of Blender's own: seen above
                self.add(key)
                self.value(thing[key])

    def _files(self, thing: bpy.types.bpy_struct) -> None:
        if packed := getattr(thing, "packed_file", None):
            self.add(hashlib.sha256(packed.data).hexdigest())
        elif isinstance(path := getattr(thing, "filepath", None), str) and path:
            file = Path(bpy.path.abspath(path, library=getattr(thing, "library", None)))
            self.add(sha256(file) if file.is_file() else file.name)


@cache
def _properties(kind: type) -> dict[str, tuple[str, ...] | None]:
    """Names of the properties that count, and the keys in ARRAYS of those that are read as arrays."""
    arrays = next((keys for one, keys in ARRAYS.items() if issubclass(kind, one)), {})
    return {p.identifier: arrays.get(p.identifier) for p in kind.bl_rna.properties if _counts(kind, p)}


def _counts(kind: type, prop: bpy.types.Property) -> bool:
    name = prop.identifier
    if name in LEFT_OUT or name.startswith(OF_WINDOWS):
        return False
    if prop.is_runtime and name not in RUNTIME and issubclass(kind, EXTENDED):
        return False
    if issubclass(kind, bpy.types.Node) and name in OF_NODES:
        return False
    if issubclass(kind, GEOMETRY):
        return name in OF_GEOMETRY
    return prop.type in ("POINTER", "COLLECTION") or not prop.is_readonly
