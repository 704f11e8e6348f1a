# SPDX-License-Identifier: GPL-3.0-or-later
"""Names, classes and ids of the things in a scene.

A thing is an object, or an instance created by a collection, nodes or particles. Parts with the same text in the custom
property `pecs_object` are one thing. Its class is the custom property `pecs_class`. Both properties are looked up in
the object, the object that creates the instance, their collections (parents too) and the material; the first one
counts. Ids number the sorted names of all objects of the scene and of all instances at the first, middle and last
instant (at all instants, if these differ), so they depend on neither camera nor shard. Particles of other instants have
id 0."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy
from pecs._errors import bad_input

SHAPES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD")  # types of objects with surfaces
CLASS, OBJECT = "pecs_class", "pecs_object"
NO_INDEX = 0x7FFFFFFF  # fills Blender's persistent ids

Key = tuple[tuple[str, ...], tuple[int, ...]]  # names from the outside in, and Blender's ids among equal names


@dataclass(frozen=True)
class Thing:
    """id: from 1. kind: class, or None."""

    id: int
    name: str
    kind: str | None


class Things:
    """Assigns ids to things."""

    def __init__(self, scene: bpy.types.Scene, times_s: list[float], keys_at: Callable[[Things, float], set[Key]]):
        """keys_at: moves the scene to a time and returns the key of each instance."""
        self._parents = _collection_parents()
        self._kinds: dict[Key, str | None] = {}
        self._texts: dict[tuple[int, int | None], tuple[str | None, str | None]] = {}  # by addresses
        for thing in scene.objects:
            if thing.type in SHAPES:
                self._add(thing, None, ())
        seen = [keys_at(self, t_s) for t_s in _spread(times_s)]
        if any(keys != seen[0] for keys in seen):
            for t_s in times_s:
                keys_at(self, t_s)
        self.classes = {kind: k for k, kind in enumerate(sorted({k for k in self._kinds.values() if k}), 1)}
        self._things = {key: Thing(i, _name(key), self._kinds[key]) for i, key in enumerate(sorted(self._kinds), 1)}
        self._is_numbered = True

    _is_numbered = False

    def thing(self, key: Key) -> Thing | None:
        return self._things.get(key)

    def __iter__(self) -> Iterator[Thing]:
        return iter(self._things.values())

    def key(self, instance: bpy.types.DepsgraphObjectInstance) -> Key:
        if not instance.is_instance:
            return self._add(instance.object.original, None, ())
        numbers = tuple(n for n in instance.persistent_id if n != NO_INDEX)
        return self._add(instance.object.original, instance.parent and instance.parent.original, numbers)

    def _add(self, thing: bpy.types.Object, maker: bpy.types.Object | None, numbers: tuple[int, ...]) -> Key:
        both = thing.as_pointer(), maker and maker.as_pointer()
        if both not in self._texts:
            self._texts[both] = self._text(thing, maker, OBJECT), self._text(thing, maker, CLASS)
        of, kind = self._texts[both]
        names = tuple(filter(None, (maker and maker.name, of or thing.name)))
        key = names, numbers[1:] if of else numbers  # the first number counts within an instance
        if not self._is_numbered:
            self._kinds[key] = self._kinds.get(key) or kind
        return key

    def _text(self, thing: bpy.types.Object, maker: bpy.types.Object | None, prop: str) -> str | None:
        for holder in self._holders(thing, maker):
            if (text := holder.get(prop)) is not None:
                if not isinstance(text, str) or not text.strip():
                    raise bad_input("scene", f"{holder.name!r}.{prop}", repr(text), "a name")
                return text
        return None

    def _holders(self, thing: bpy.types.Object, maker: bpy.types.Object | None) -> Iterator[bpy.types.ID]:
        both = [one for one in (thing, maker) if one]
        yield from both
        rising = [collection for one in both for collection in one.users_collection]
        for collection in rising:  # the loop appends to it
            yield collection
            rising += [p for p in self._parents.get(collection, ()) if p not in rising]
        yield from (slot.material for slot in thing.material_slots if slot.material)


def _collection_parents() -> dict[bpy.types.Collection, list[bpy.types.Collection]]:
    parents: dict[bpy.types.Collection, list[bpy.types.Collection]] = {}
    for collection in (*(scene.collection for scene in bpy.data.scenes), *bpy.data.collections):
        for child in collection.children:
            parents.setdefault(child, []).append(collection)
    return parents


def _name(key: Key) -> str:
    names, numbers = key
    return "/".join(names) + (("#" + ".".join(map(str, numbers))) if numbers else "")


def _spread(times_s: list[float]) -> list[float]:
    """First, middle, last."""
    return sorted({times_s[0], times_s[len(times_s) // 2], times_s[-1]})
