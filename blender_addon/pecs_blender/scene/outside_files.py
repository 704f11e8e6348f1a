# SPDX-License-Identifier: GPL-3.0-or-later
"""Files other than the .blend from which Blender reads what it renders, by data-block, modifier and node."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import bpy
from pecs._platform import discarded

BUILT_IN = "<builtin>"  # path of Blender's own font


def files(thing: bpy.types.bpy_struct, scene: bpy.types.Scene) -> list[Path]:
    """Files that `thing` reads in the scene's range of frames."""
    read = next((read for kind, read in _READ.items() if isinstance(thing, kind)), None)
    owner = thing.id_data or thing
    library = None if isinstance(owner, bpy.types.Library) else getattr(owner, "library", None)
    return [Path(bpy.path.abspath(path, library=library)) for path in (read(thing, scene) if read else ()) if path]


def missing_files(scene: bpy.types.Scene) -> Iterator[str]:
    """Lines on files that do not exist, with their owner."""
    for thing in things(scene):
        for file in files(thing, scene):
            if not file.exists():
                owner = thing.id_data or thing
                kind = owner.bl_rna.name.lower()
                part = "" if thing == owner else f": {thing.name or thing.bl_rna.name}"
                yield f"{kind} {owner.name!r}{part}: {file}: no such file"


def unreadable_pictures() -> Iterator[str]:
    """Lines on files that are no pictures, in whose place Cycles renders one colour. Reads them."""
    for image in bpy.data.images:
        if image.users and image.source == "FILE" and image.filepath and not image.packed_file:
            with discarded(2):
                found = all(image.size)
            if not found:
                path = bpy.path.abspath(image.filepath, library=image.library)
                yield f"image {image.name!r}: {path}: got no picture that Blender can read, wanted one"


def things(scene: bpy.types.Scene) -> Iterator[bpy.types.bpy_struct]:
    """Data-blocks, nodes and modifiers that read files."""
    yield from bpy.data.libraries
    blocks = chain(bpy.data.images, bpy.data.volumes, bpy.data.cache_files, bpy.data.fonts)
    yield from (block for block in [*blocks, *bpy.data.cameras] if block.users)
    trees = [
        one.node_tree for kind in ("materials", "lights", "worlds") for one in getattr(bpy.data, kind) if one.users
    ]
    for tree in (*filter(None, trees), *(group for group in bpy.data.node_groups if group.users)):
        yield from tree.nodes
    for thing in (one for one in bpy.data.objects if one.users):
        for modifier in thing.modifiers:
            if modifier.show_render:
                yield modifier
                yield from filter(None, [getattr(modifier, "point_cache", None)])
        yield from (system.point_cache for system in thing.particle_systems)
    if scene.rigidbody_world:
        yield scene.rigidbody_world.point_cache


def _image(image: bpy.types.Image, _scene: bpy.types.Scene) -> list[str]:
    if image.packed_file or len(image.packed_files):
        return []
    if image.source == "TILED":
        return [_tile(image.filepath, tile.number) for tile in image.tiles]
    return [image.filepath] if image.source in ("FILE", "SEQUENCE", "MOVIE") else []


def _tile(path: str, number: int) -> str:
    down, across = divmod(number - 1001, 10)
    return path.replace("<UDIM>", str(number)).replace("<UVTILE>", f"u{across + 1}_v{down + 1}")


def _volume(volume: bpy.types.Volume, scene: bpy.types.Scene) -> list[str]:
    if volume.packed_file:
        return []
    if not volume.is_sequence:
        return [volume.filepath]
    count, numbers = volume.frame_duration, set()
    for frame in range(scene.frame_start, scene.frame_end + 1):
        at = frame - volume.frame_start
        if volume.sequence_mode == "CLIP" and not 0 <= at < count:
            continue
        at = {"REPEAT": at % count, "PING_PONG": _to_and_fro(at, count)}.get(volume.sequence_mode, at) if count else 0
        numbers.add(min(max(at, 0), count - 1) + 1 + volume.frame_offset)
    return [_numbered(volume.filepath, number) for number in sorted(numbers)]


def _to_and_fro(at: int, count: int) -> int:
    turn = at % max(1, 2 * count - 2)
    return min(turn, 2 * count - 2 - turn) if count > 1 else 0


def _numbered(path: str, number: int) -> str:
    """With this number in place of the last one in the file's name."""
    return re.sub(r"(\d+)(?=[^\d/\\]*$)", lambda match: f"{number:0{len(match[0])}d}", path, count=1)


def _cache(cache: bpy.types.CacheFile, scene: bpy.types.Scene) -> list[str]:
    layers = [layer.filepath for layer in cache.layers if not layer.hide_layer]
    if not cache.is_sequence:
        return [cache.filepath, *layers]
    frames = [int(cache.frame)] if cache.override_frame else range(scene.frame_start, scene.frame_end + 1)
    return [*(_numbered(cache.filepath, frame) for frame in frames), *layers]


def _modifier_inputs(modifier: bpy.types.NodesModifier, _scene: bpy.types.Scene) -> list[str]:
    items = modifier.node_group.interface.items_tree if modifier.node_group else ()
    named = [item for item in items if item.bl_rna.identifier == "NodeTreeInterfaceSocketStringFilePath"]
    return [modifier[item.identifier] for item in named if isinstance(modifier.get(item.identifier), str)]


def _node_inputs(node: bpy.types.Node, _scene: bpy.types.Scene) -> list[str]:
    free = (one for one in node.inputs if one.bl_rna.identifier == "NodeSocketStringFilePath" and not one.is_linked)
    return [] if node.mute else [one.default_value for one in free]


def _own(reads: Callable[[Any], bool], name: str = "filepath") -> Callable[[Any, bpy.types.Scene], list[str]]:
    return lambda thing, _scene: [getattr(thing, name)] if reads(thing) else []


def _is_external(node: bpy.types.Node) -> bool:
    return node.mode == "EXTERNAL"


def _domain(modifier: bpy.types.FluidModifier, _scene: bpy.types.Scene) -> list[str]:
    domain = modifier.domain_settings
    return [domain.cache_directory] if domain and domain.has_cache_baked_any else []


_READ: dict[type, Callable[[Any, bpy.types.Scene], list[str]]] = {
    bpy.types.Library: _own(lambda library: not getattr(library, "packed_file", None)),
    bpy.types.Image: _image,
    bpy.types.Volume: _volume,
    bpy.types.CacheFile: _cache,
    bpy.types.VectorFont: _own(lambda font: not font.packed_file and font.filepath != BUILT_IN),
    bpy.types.Camera: _own(lambda c: c.type == "CUSTOM" and c.custom_mode == "EXTERNAL", "custom_filepath"),
    bpy.types.MeshCacheModifier: _own(lambda _: True),
    bpy.types.MultiresModifier: _own(lambda modifier: modifier.is_external),
    bpy.types.OceanModifier: _own(lambda modifier: modifier.is_cached),
    bpy.types.FluidModifier: _domain,
    bpy.types.NodesModifier: _modifier_inputs,
    bpy.types.PointCache: _own(lambda cache: cache.use_external),
    bpy.types.ShaderNodeScript: _own(_is_external),
    bpy.types.ShaderNodeTexIES: _own(_is_external),
    bpy.types.GeometryNode: _node_inputs,
}
