# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects of other files that `--place FILE` adds to a scene (docs/reference/render.md)."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector
from pecs._config import Fields, read_json
from pecs._errors import PecsNotFoundError, bad_input
from pecs._files import sha256

from . import cycles
from .content import Walk
from .importers import READERS, imported
from .sky import Sky

FILES = ("file", "texture")
LEAST_EXTENT = 1e-9  # of a file's objects, in its unit
MOST = 1e6  # m, m/s, degrees, degrees/s
TYPES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "EMPTY", "ARMATURE")  # no lamps, no cameras


class Placed:
    """The objects of a placement file in the scene; pose() moves them to an instant. record: for stack.json, with the
    files' names only. check: of each file. sky: instead of the scene's, or None."""

    def __init__(self, file: Path, scene: bpy.types.Scene, unit_m: float, check: Callable[[Path], None]):
        content = read_json(file)
        self._unit_m, self._things = unit_m, []
        top = Fields(content, file)
        if top.number("format") != 1:
            raise top.wrong("format", "1")
        self.sky = Sky(top.table("sky"), scene) if top.has("sky") else None
        for entry in top.tables("objects"):
            self._things.append(_Thing(entry, scene, check))
        top.done()
        self.record = [
            _recorded(entry, thing.content_sha256)
            for entry, thing in zip(content["objects"], self._things, strict=True)
        ]
        self.pose(0.0)

    def pose(self, t_s: float) -> None:
        for thing in self._things:
            thing.pose(t_s, self._unit_m)


def _recorded(thing: dict[str, Any], content: str) -> dict[str, Any]:
    files = {key: Path(thing[key]) for key in FILES if thing[key]}
    names = {key: file.name for key, file in files.items()}
    return thing | names | {f"{key}_sha256": sha256(file) for key, file in files.items()} | {"content_sha256": content}


class _Thing:
    """The objects of one file under an empty at the centre of their box, scaled to a largest extent of 1.
    content_sha256: of these, with the files that they read, such as textures."""

    def __init__(self, entry: Fields, scene: bpy.types.Scene, check: Callable[[Path], None]):
        name, file = entry.text("name"), Path(entry.text("file"))
        if name in bpy.data.objects or name in bpy.data.collections:
            raise entry.wrong("name", "a name that no other object has")
        size_m = entry.number("size_m", low=1e-6, high=1e6) if entry.has("size_m") else None
        unit_m = entry.number("unit_m", low=1e-9, high=1e6) if entry.has("unit_m") else 1.0
        up = entry.text("up", choices=("y", "z")) if entry.has("up") else None
        keys = ("position_m", "velocity_m_s", "rotation_deg", "spin_deg_s")
        self._position_m, self._velocity, self._turn, self._spin = (
            entry.numbers(key, count=3, low=-MOST, high=MOST) for key in keys
        )
        texture = Path(entry.text("texture")) if entry.has("texture") else None
        kind = entry.text("class")
        entry.done()
        collection = bpy.data.collections.new(name)
        collection["pecs_class"], collection["pecs_object"] = kind, name  # its parts are one object
        scene.collection.children.link(collection)
        objects = _loaded(file, collection, up)
        if texture:
            _dress(objects, texture, file)
        check(file)  # before anything is evaluated
        walk = Walk(scene)
        walk.value(objects)
        self.content_sha256 = walk.to_the_end()
        bpy.context.view_layer.update()
        self._empty = bpy.data.objects.new(name, None)
        collection.objects.link(self._empty)
        low, high = _box(objects, file)
        extent = max(high - low)
        self._size_m = size_m or extent * unit_m
        centred = Matrix.Scale(1 / extent, 4) @ Matrix.Translation(-(low + high) / 2)
        for thing in objects:
            if thing.parent not in objects:
                thing.matrix_world = centred @ thing.matrix_world
                thing.parent = self._empty

    def pose(self, t_s: float, unit_m: float) -> None:
        place = (Vector(self._position_m) + t_s * Vector(self._velocity)) / unit_m
        turned = Euler([math.radians(a) for a in self._turn]).to_matrix().to_4x4()
        spin = Vector(self._spin)
        spun = Matrix.Rotation(math.radians(spin.length) * t_s, 4, spin) if spin.length else Matrix.Identity(4)
        scaled = Matrix.Scale(self._size_m / unit_m, 4)
        self._empty.matrix_world = Matrix.Translation(place) @ spun @ turned @ scaled


def _loaded(file: Path, collection: bpy.types.Collection, up: str | None) -> list[bpy.types.Object]:
    if not file.is_file():
        raise PecsNotFoundError(f"{file}: no such file")
    if (kind := file.suffix.lower()) not in (".blend", *READERS):
        raise bad_input(file, "", f"a file of type {kind!r}", f"one of .blend, {', '.join(READERS)}")
    found = imported(file, up) if kind in READERS else _appended(file)
    objects = [thing for thing in found if thing.type in TYPES]
    for thing in found:
        if thing not in objects:  # lamps and cameras
            bpy.data.objects.remove(thing)
    for thing in objects:
        thing.animation_data_clear()
        collection.objects.link(thing)
    return objects


def _appended(file: Path) -> list[bpy.types.Object]:
    try:
        with cycles.quiet(2), bpy.data.libraries.load(str(file)) as (there, here):
            here.objects = list(there.objects)
    except OSError as e:
        raise bad_input(file, "", str(e).strip().splitlines()[-1], "a .blend file") from None
    return [thing for thing in here.objects if thing is not None]


def _box(objects: list[bpy.types.Object], file: Path) -> tuple[Vector, Vector]:
    corners = [thing.matrix_world @ Vector(c) for thing in objects if thing.type == "MESH" for c in thing.bound_box]
    if not corners:
        raise bad_input(file, "objects", "no mesh", "an object to place")
    if not all(map(_is_finite, objects)):
        raise bad_input(file, "objects", "vertices that are not finite", "numbers")
    low, high = (Vector([end(c[i] for c in corners) for i in range(3)]) for end in (min, max))
    extent = max(high - low)
    if not extent > 0:
        raise bad_input(file, "objects", "a point", "an object with a size")
    if not LEAST_EXTENT <= extent <= 1 / LEAST_EXTENT:
        raise bad_input(file, "objects", f"an extent of {extent:g}", "1e-09 to 1e+09")
    return low, high


def _is_finite(thing: bpy.types.Object) -> bool:
    if thing.type != "MESH":
        return True
    vertices = np.empty(3 * len(thing.data.vertices), np.float32)
    thing.data.vertices.foreach_get("co", vertices)
    return bool(np.isfinite(vertices).all())


def _dress(objects: list[bpy.types.Object], texture: Path, file: Path) -> None:
    """Gives all meshes one material: the texture on their UV maps."""
    if not texture.is_file():
        raise PecsNotFoundError(f"{texture}: no such file")
    material = bpy.data.materials.new(texture.stem)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    image = nodes.new("ShaderNodeTexImage")
    try:
        image.image = bpy.data.images.load(str(texture), check_existing=True)
    except RuntimeError as e:
        raise bad_input(texture, "", str(e).strip(), "a picture") from None
    if not all(image.image.size):
        raise bad_input(texture, "", "no pixels", "a picture")
    links.new(image.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    for thing in objects:
        if thing.type != "MESH":
            continue
        if not thing.data.uv_layers:
            raise bad_input(file, f"object {thing.name}", "no UV map", "one for the texture")
        thing.data.materials.clear()
        thing.data.materials.append(material)
