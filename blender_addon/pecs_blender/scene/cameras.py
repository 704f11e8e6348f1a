# SPDX-License-Identifier: GPL-3.0-or-later
"""The cameras of a .blend over its range of frames (`pecs_blender cameras`)."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from pecs._errors import bad_input

from .blend import BlendScene
from .source import FLIP

PER_FRAME = 8  # samples
MOST_FRAMES = 10_000
MORE = 2  # frames beyond the range: a data set ends with an interval of its light
OPTICS = {"type": "type", "focal_mm": "lens", "fit": "sensor_fit", "shift_x": "shift_x", "shift_y": "shift_y"}
OPTICS |= {"sensor_width_mm": "sensor_width", "sensor_height_mm": "sensor_height"}


def describe(source: BlendScene) -> dict[str, Any]:
    """times_s: from the first frame on, PER_FRAME per frame. active: the cameras that render the range, in order.
    cameras: by name; the optics are those of the first frame, `zooms` says whether they change, `mirrored` whether a
    negative scale mirrors it; poses: rows (x y z qx qy qz qw) of world_from_camera [m], whose camera axes are x right,
    y down, z forward."""
    scene = source.scene
    fps, count = scene.render.fps / scene.render.fps_base, scene.frame_end - scene.frame_start
    if count > MOST_FRAMES:
        raise bad_input("frames", "", f"{scene.frame_start} to {scene.frame_end}", f"a range of at most {MOST_FRAMES}")
    times_s = np.arange((count + MORE) * PER_FRAME + 1) / (PER_FRAME * fps)
    things = [thing for thing in scene.objects if thing.type == "CAMERA" and not thing.hide_render]
    poses: dict[str, list[list[float]]] = {thing.name: [] for thing in things}
    optics: dict[str, list[dict[str, Any]]] = {thing.name: [] for thing in things}
    mirrored: set[str] = set()
    for thing in things:  # Blender evaluates no hidden ones, unless something depends on them
        child = bpy.data.objects.new("pecs child", None)
        child.parent = thing
        scene.collection.objects.link(child)
    active: dict[str, None] = {}
    for i, t_s in enumerate(times_s.tolist()):
        source.set_time(t_s)
        if i <= count * PER_FRAME:
            active[source.own_camera.name] = None
        for thing in things:
            poses[thing.name].append(_pose(thing, source.unit_m))
            if thing.matrix_world.determinant() < 0:
                mirrored.add(thing.name)
            if i <= count * PER_FRAME:
                optics[thing.name].append({key: getattr(thing.data, name) for key, name in OPTICS.items()})
    return {
        "scene": scene.name,
        "frames": [scene.frame_start, scene.frame_end],
        "fps": fps,
        "times_s": times_s.tolist(),
        "active": list(active),
        "cameras": {
            name: found[0]
            | {"zooms": any(one != found[0] for one in found), "mirrored": name in mirrored, "poses": poses[name]}
            for name, found in optics.items()
        },
    }


def _pose(thing: bpy.types.Object, unit_m: float) -> list[float]:
    position, rotation, _ = thing.matrix_world.decompose()
    turned = (rotation.to_matrix() @ Matrix(FLIP[:3, :3])).to_quaternion()
    return [*(position * unit_m), turned.x, turned.y, turned.z, turned.w]
