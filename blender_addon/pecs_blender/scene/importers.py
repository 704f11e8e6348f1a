# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects of model files of other programs, by Blender's importers. Lamps, cameras, skies and animations stay out."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy
from pecs._errors import ExitCode, PecsError, PecsNotFoundError, bad_input

from . import cycles

KEPT = ("frame_start", "frame_end", "frame_current", "camera", "world")  # of the scene
BLOCKS = ("objects", "collections", "images", "texts")


def _axes(up: str | None, default: str) -> dict[str, str]:
    return (
        {"up_axis": "Y", "forward_axis": "NEGATIVE_Z"}
        if (up or default) == "y"
        else {
            "up_axis": "Z",
            "forward_axis": "Y",
        }
    )


def _obj(path: str, up: str | None) -> None:
    with open(path, "rb") as file:
        for line in file:
            if line.startswith(b"v ") and b"n" in line.lower():  # Blender reads nan and inf as 0
                raise bad_input(path, "", line.decode(errors="replace").strip(), "vertices of finite numbers")
            if line.startswith(b"mtllib "):
                _check_materials(Path(path), line[7:].decode(errors="surrogateescape").strip())
    bpy.ops.wm.obj_import(filepath=path, **_axes(up, "y"))


def _check_materials(model: Path, names: str) -> None:
    """Raises PecsNotFoundError for a missing file of materials: one name, which may have blanks, or several."""
    if not (model.parent / names).is_file():
        for name in names.split():
            if not (model.parent / name).is_file():
                raise PecsNotFoundError(f"{model}: mtllib: {model.parent / name}: no such file")


def _ply(path: str, up: str | None) -> None:
    head, _, body = Path(path).read_bytes().partition(b"end_header")
    if b"format ascii" in head and (found := re.search(rb"(?i)\b(nan|inf)", body)):  # Blender reads them as 0
        raise bad_input(path, "", found[0].decode(), "vertices of finite numbers")
    bpy.ops.wm.ply_import(filepath=path, **_axes(up, "z"))


def _gltf(path: str, _up: str | None) -> None:
    bpy.ops.import_scene.gltf(filepath=path, disable_bone_shape=True)


def _fbx(path: str, _up: str | None) -> None:
    bpy.ops.wm.fbx_import(filepath=path, use_anim=False)


def _usd(path: str, _up: str | None) -> None:
    no = dict.fromkeys(("set_frame_range", "import_cameras", "import_lights", "create_world_material"), False)
    known = bpy.ops.wm.usd_import.get_rna_type().properties.keys()
    bpy.ops.wm.usd_import(filepath=path, **{key: value for key, value in no.items() if key in known})


READERS: dict[str, Callable[[str, str | None], None]] = {".obj": _obj, ".ply": _ply, ".fbx": _fbx}
READERS |= dict.fromkeys((".glb", ".gltf"), _gltf) | dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _usd)


def imported(file: Path, up: str | None) -> list[bpy.types.Object]:
    """Unlinked objects. up: the axis of an .obj or .ply that points up. Raises PecsError."""
    scene = bpy.context.scene
    kept = {key: getattr(scene, key) for key in KEPT}
    rate = scene.render.fps, scene.render.fps_base
    before = {key: set(getattr(bpy.data, key)) for key in BLOCKS}
    try:
        with tempfile.TemporaryFile() as said:
            with cycles.quiet(2, into=said):
                READERS[file.suffix.lower()](str(file.absolute()), up)
            said.seek(0)
            if missing := re.search(rb"Could not open asset @(.*?)@", said.read()):  # a warning of the USD library
                raise PecsNotFoundError(f"{file}: {missing[1].decode(errors='replace')}: no such file")
    except AttributeError as e:
        raise PecsError(f"{file}: this Blender has no importer of it: {e}", ExitCode.UNSUPPORTED) from None
    except PecsError:
        raise
    except Exception as e:  # importers in Python raise all kinds for broken files
        lines = (line.strip() for line in str(e).splitlines())
        words = [line for line in lines if line and not line.startswith("Location: ")] or [type(e).__name__]
        raise bad_input(file, "", words[-1], f"a model of {file.suffix}") from None
    finally:
        for key, value in kept.items():
            setattr(scene, key, value)
        scene.render.fps, scene.render.fps_base = rate
    fresh = {key: [one for one in getattr(bpy.data, key) if one not in before[key]] for key in BLOCKS}
    objects = fresh["objects"]
    if not any(thing.type == "MESH" and len(thing.data.polygons) for thing in objects):
        raise bad_input(file, "objects", "no surface", "a model with faces")
    for thing in objects:
        for collection in list(thing.users_collection):
            collection.objects.unlink(thing)
    for collection in fresh["collections"]:
        bpy.data.collections.remove(collection)
    for text in fresh["texts"]:
        bpy.data.texts.remove(text)
    return objects
