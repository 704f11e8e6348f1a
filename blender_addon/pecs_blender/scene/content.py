# SPDX-License-Identifier: GPL-3.0-or-later
"""A digest of what a .blend's scene contains, so that an edited scene does not continue the stack of another one.

It covers all that Blender's RNA shows of the scene, its first view layer, and whatever they refer to, and the files
that these read; except interface_only.txt. Not their addresses and not the bytes of the .blend, which differ each time
it is saved. Not covered, since RNA does not show them: painted particles, sculpted multiresolution, and caches of
simulations.
"""

from __future__ import annotations

import hashlib
from collections import deque
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from pecs._files import sha256

from .cycles import BOUNCES, SETTINGS
from .outside_files import files

KEYFRAME = ("co", "handle_left", "handle_right", "interpolation", "easing", "back", "amplitude", "period")
ARRAYS = {  # read as one: of the collection's items, those of these that they have
    bpy.types.FCurve: {"keyframe_points": KEYFRAME, "sampled_points": ("co",)},
    bpy.types.ShapeKey: {"data": ("co", "handle_left", "handle_right", "radius", "tilt")},
}
GEOMETRY = (bpy.types.Mesh, bpy.types.Curves, bpy.types.PointCloud)  # its attributes are read as arrays
EXTENDED = (bpy.types.ID, bpy.types.Bone, bpy.types.PoseBone, bpy.types.ViewLayer)  # to which add-ons add properties
PATHS = ("FILE_PATH", "DIR_PATH")  # of these the files count, wherever they are (outside_files.py)
INTERFACE = {"CyclesRenderSettings": {*SETTINGS, *BOUNCES}}  # type -> names and patterns; the latter are in stack.json
for _line in Path(__file__).with_name("interface_only.txt").read_text().splitlines():
    if not _line.startswith("#"):
        _kind, _, _names = _line.partition(": ")
        INTERFACE.setdefault(_kind, set()).update(_names.split())
RENDERER = "cycles"  # begins the names of those that renders depend on


def digest(scene: bpy.types.Scene) -> str:
    """SHA-256 of the scene at its first frame, which becomes the current one."""
    scene.frame_set(scene.frame_start)
    walk = Walk(scene)
    walk.value([(marker.frame, marker.camera) for marker in scene.timeline_markers if marker.camera])
    walk.value(scene)
    walk.value(scene.view_layers[0])
    return walk.to_the_end()


class Walk:
    """Structures are numbered as they are met, and read in that order: chains of parents may be long. met: all so
    far."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self._hash = hashlib.sha256()
        self._scene, self.met = scene, {}
        self._numbers: dict[tuple[str, int], int] = {}
        self._next: deque[bpy.types.bpy_struct] = deque()

    def to_the_end(self) -> str:
        while self._next:
            self._read(self._next.popleft())
        return self._hash.hexdigest()

    def add(self, *values: Any) -> None:
        self._hash.update(repr(values).encode())

    def value(self, value: Any) -> None:
        if isinstance(value, bpy.types.bpy_struct):
            key = type(value).__name__, value.as_pointer()
            if key not in self._numbers:
                self._next.append(value)
            self.add(key[0], self._numbers.setdefault(key, len(self._numbers)))
        elif isinstance(value, float):
            self.add(f"{value:.6g}")
        elif hasattr(value, "__len__") and not isinstance(value, (str, bytes, set)):
            for one in value:
                self.value(one)
        else:
            self.add(sorted(value) if isinstance(value, set) else value)

    def _read(self, thing: bpy.types.bpy_struct) -> None:
        self.met.setdefault(type(thing), []).append(thing)
        for name, arrays in _properties(type(thing)).items():
            self.add(name)
            self._property(thing, name, arrays)
        self._own_properties(thing)
        if isinstance(thing, GEOMETRY):
            self._geometry(thing)
        if getattr(thing, "show_only_shape_key", False):
            self.add(thing.active_shape_key_index)
        if isinstance(thing, bpy.types.Object) and thing.type == "MESH" and thing.vertex_groups:
            self.add([[(g.group, round(g.weight, 5)) for g in v.groups] for v in thing.data.vertices])
        if packed := getattr(thing, "packed_file", None):
            self.add(hashlib.sha256(packed.data).hexdigest())
        for file in files(thing, self._scene):
            self._file(file)

    def _property(self, thing: bpy.types.bpy_struct, name: str, arrays: tuple[str, ...]) -> None:
        try:
            value = getattr(thing, name)
        except (AttributeError, RuntimeError, TypeError, ValueError):  # an enum without a valid value
            return
        if not arrays:
            self.value(value)
        for key in arrays:
            self._array(value, key)
        for key in _of_collection(type(thing), name):
            self.value(getattr(value, key, None))

    def _array(self, items: Any, key: str) -> None:
        if not len(items) or not hasattr(items[0], key):
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
            for layer in data.skin_vertices:
                for key in ("radius", "use_root", "use_loose"):
                    self._array(layer.data, key)
        if isinstance(data, bpy.types.Curves):
            self._array(data.curve_offset_data, "value")
        for attribute in data.attributes:
            if not (attribute.name.startswith(".select") or attribute.data_type == "STRING") and len(attribute.data):
                self.add(attribute.name, attribute.domain)
                key = next(k for k in ("value", "vector", "color") if hasattr(attribute.data[0], k))
                self._array(attribute.data, key)
        for name in ("render_color_index", "default_color_name"):
            self.add(getattr(data.attributes, name, None))

    def _own_properties(self, thing: bpy.types.bpy_struct) -> None:
        try:
            keys = sorted(thing.keys())
        except TypeError:  # a type that has none
            return
        for key in keys:
            # Those of a group of Blender's own are seen above.
            if key not in thing.bl_rna.properties and not hasattr(thing[key], "to_dict"):
                self.add(key)
                self.value(thing[key])

    def _file(self, file: Path) -> None:
        if file.is_dir():
            self.add(sorted((one.name, one.stat().st_size) for one in file.rglob("*") if one.is_file()))
        else:
            self.add(sha256(file) if file.is_file() else file.name)


@cache
def _properties(kind: type) -> dict[str, tuple[str, ...]]:
    """Names of the properties that count, and the keys in ARRAYS of those that are read as arrays."""
    arrays = next((keys for one, keys in ARRAYS.items() if issubclass(kind, one)), {})
    return {p.identifier: arrays.get(p.identifier, ()) for p in kind.bl_rna.properties if counts(kind, p)}


@cache
def _of_collection(kind: type, name: str) -> tuple[str, ...]:
    """Properties of a collection itself that count."""
    prop = kind.bl_rna.properties[name]
    if prop.type != "COLLECTION" or not prop.srna:
        return ()
    own = [one.identifier for one in prop.srna.properties if one.type not in ("POINTER", "COLLECTION")]
    return tuple(one for one in own if not one.startswith("active") or one == "active_index" and name == "uv_layers")


def counts(kind: type, prop: bpy.types.Property) -> bool:
    """Whether a property of a type counts for the digest."""
    name = prop.identifier
    if name == "rna_type" or prop.is_runtime and issubclass(kind, EXTENDED) and not name.startswith(RENDERER):
        return False
    if prop.type == "STRING" and prop.subtype in PATHS:
        return False
    struct = kind.bl_rna
    while struct:
        listed = INTERFACE.get(struct.identifier, ()) if name in struct.properties else ()
        if any(fnmatchcase(name, pattern) for pattern in listed):
            return False
        struct = struct.base
    return True
