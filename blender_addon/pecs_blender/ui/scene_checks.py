# SPDX-License-Identifier: GPL-3.0-or-later
"""Before the render: what a person would see in the events only hours later. By a button, since it looks at the whole
scene and moves it through its time; what is quick and stops a job stands in checks.py."""

from __future__ import annotations

import math
from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..render.needs import missing_files, python_drivers
from ..render.spectral import beyond_reach
from . import light_probe, settings
from .checks import Problem
from .interface import say

LOOKS = 8  # over the rendered range, at how far things move
MOST_PX = 1.0  # from instant to instant: beyond it light jumps between pictures
MOST_NOISE, NOISE_TARGET = 0.3, 0.1  # contrast thresholds: one that is seen in the events, one that is not
GRID = 32, 24  # rays
SHOWN = 5  # of a list


class _State:
    found: dict[str, list[Problem]] = {}  # by the scene's name


state = _State()


def look(scene, view_layer) -> list[Problem]:
    """Half a second and more; the scene's frame is then as before."""
    parts = _files(scene), _lamps(scene), _nodes(), _noise(scene), _clip(scene, view_layer), _motion(scene, view_layer)
    return [one for part in parts for one in part]


def _files(scene) -> Iterator[Problem]:
    if missing := list(missing_files()):
        yield Problem(_list(say("Missing"), missing), mend="file.find_missing_files")
    if not scene.pecs.allow_scripts and (drivers := list(python_drivers())):
        yield Problem(_list(say("Python to run"), drivers), mend="pecs.allow_scripts")


def _lamps(scene) -> Iterator[Problem]:
    lamps = sorted({o.data.name for o in scene.objects if o.type == "LIGHT" and not o.hide_render and _bare(o.data)})
    if lamps:
        yield Problem(
            _list(say("Lamps without a spectrum, lit as {spectrum}", spectrum=scene.pecs.illuminant), lamps),
            is_error=False,
        )


def _bare(light) -> bool:
    return "pecs_spectrum" not in light and not getattr(light, "use_temperature", False)


def _nodes() -> Iterator[Problem]:
    owners = [one for kind in (bpy.data.materials, bpy.data.lights, bpy.data.worlds) for one in kind if one.users]
    trees = [(one.name, one.node_tree) for one in owners if one.node_tree]
    trees += [(group.name, group) for group in bpy.data.node_groups if group.users]
    found = [words for name, tree in trees for node in tree.nodes for words in beyond_reach(node, name)]
    if found:
        yield Problem(_list(say("Approximated"), found), is_error=False)


def _noise(scene) -> Iterator[Problem]:
    """Samples are the same from picture to picture, so noise flickers where something moves; denoised, everywhere."""
    s = scene.pecs
    if s.denoise:
        text = "Denoising flickers from picture to picture, also in pixels that see nothing move, and makes events"
        yield Problem(say(text), is_error=False, mend="pecs.no_denoise")
    found = light_probe.state.found.get(scene.name)
    if s.noise_target or not found or found["noise_thresholds"] is None:
        return
    noise = found["noise_thresholds"] * math.sqrt(found["samples"] / s.samples)
    if noise > MOST_NOISE:
        wanted = math.ceil(s.samples * (noise / MOST_NOISE) ** 2)
        text = (
            "Noise of about {noise:.2g} contrast thresholds flickers where something moves, and makes events. Take "
            "{samples} samples or more, or a noise target of {target:g}"
        )
        text = say(text, noise=noise, samples=wanted, target=NOISE_TARGET)
        yield Problem(text, is_error=False, mend="pecs.take_noise_target")


def _clip(scene, view_layer) -> Iterator[Problem]:
    """Of the scene's own camera; a lens has none."""
    camera = scene.camera
    if not camera or camera.type != "CAMERA" or settings.has_lens(scene.pecs):
        return
    ahead = -(np.array(camera.matrix_world.normalized().inverted()) @ _corners(view_layer))[2]
    if ahead.size and ahead.max() > camera.data.clip_end:
        text = "The camera sees nothing beyond {end:g}, and things reach {far:.4g} units far"
        text = say(text, end=camera.data.clip_end, far=ahead.max())
        yield Problem(text, is_error=False, mend="pecs.clip_far")


def _things(view_layer) -> list:
    shown = (o for o in view_layer.objects if o.visible_get(view_layer=view_layer) and not o.hide_render)
    return [o for o in shown if o.type in ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "VOLUME")]


def _corners(view_layer) -> np.ndarray:
    """[4, n] of all boxes in the world, as the depsgraph has them now."""
    corners = [np.array(o.matrix_world) @ np.vstack([np.array(o.bound_box).T, np.ones(8)]) for o in _things(view_layer)]
    return np.concatenate(corners, axis=1) if corners else np.empty((4, 0))


def _motion(scene, view_layer) -> Iterator[Problem]:
    """How far surfaces in view move between two instants, at some instants of the range."""
    s = scene.pecs
    if s.time != "uniform" or not scene.camera or scene.camera.type != "CAMERA":
        return
    frame, subframe = scene.frame_current, scene.frame_subframe
    instants = np.unique(np.linspace(0, max(0, settings.instants(scene) - 2), LOOKS).astype(int))
    try:
        fastest = max(_motion_px(scene, view_layer, i / s.fps, (i + 1) / s.fps) for i in instants.tolist())
    finally:
        scene.frame_set(frame, subframe=subframe)
    if fastest > MOST_PX:
        text = (
            "Things move up to {pixels:.3g} pixels from instant to instant, so their light jumps. Render keyframes and "
            "the motion between them (Steps: adaptive), or {times} times as many instants per second"
        )
        yield Problem(say(text, pixels=fastest, times=math.ceil(fastest)), is_error=False, mend="pecs.take_adaptive")


def _motion_px(scene, view_layer, from_s: float, to_s: float) -> float:
    """The longest way of the surface points that a grid of rays meets; they move with their objects."""
    width, height = settings.size(scene)
    clip_from_world = _go(scene, from_s, width, height)
    depsgraph, world_from_clip = view_layer.depsgraph, clip_from_world.inverted()
    points = []
    for y in np.linspace(-0.98, 0.98, GRID[1]):
        for x in np.linspace(-0.98, 0.98, GRID[0]):
            near, far = (_divided(world_from_clip @ Vector((x, y, z, 1))) for z in (-1, 1))
            hit, at, _, _, thing, matrix = scene.ray_cast(depsgraph, near, (far - near).normalized())
            if hit:
                rigid = (matrix.translation - thing.matrix_world.translation).length < 1e-6  # else an instance
                points.append((x, y, thing.original if rigid else None, matrix.inverted() @ at if rigid else at.copy()))
    clip_from_world, longest = _go(scene, to_s, width, height), 0.0
    for x, y, thing, at in points:
        now = clip_from_world @ (thing.matrix_world @ at if thing else at).to_4d()
        if now.w > 0:
            longest = max(longest, math.hypot((now.x / now.w - x) * width / 2, (now.y / now.w - y) * height / 2))
    return longest


def _go(scene, t_s: float, width: int, height: int) -> Matrix:
    """Moves the scene; the camera's clip coordinates from the world's."""
    at = scene.frame_start + t_s * scene.render.fps / scene.render.fps_base
    scene.frame_set(int(at // 1), subframe=at % 1)
    camera = scene.camera
    projection = camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=width, y=height)
    return projection @ camera.matrix_world.normalized().inverted()


def _divided(point: Vector) -> Vector:
    return point.xyz / point.w


def _list(what: str, names: list[str]) -> str:
    text = f"{what}: {', '.join(names[:SHOWN])}"
    return text if len(names) <= SHOWN else say("{names}, and {count} more", names=text, count=len(names) - SHOWN)


class PECS_OT_check_scene(bpy.types.Operator):
    """Look for what would spoil the events: fast motion, missing files, lamps without a spectrum, noise, and more"""

    bl_idname = "pecs.check_scene"
    bl_label = "Check the scene"

    def execute(self, context):
        scene = context.scene
        state.found[scene.name] = found = look(scene, context.view_layer)
        self.report({"INFO"}, say("{count} remarks", count=len(found)) if found else say("Nothing found"))
        return {"FINISHED"}


class _Mends:
    """Changes something, then looks again."""

    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        self.mend(context.scene, context.view_layer)
        if context.scene.name in state.found:
            state.found[context.scene.name] = look(context.scene, context.view_layer)
        return {"FINISHED"}


class PECS_OT_take_adaptive(_Mends, bpy.types.Operator):
    """Render keyframes and the motion between them"""

    bl_idname = "pecs.take_adaptive"
    bl_label = "Take adaptive steps"

    def mend(self, scene, _view_layer) -> None:
        scene.pecs.time = "adaptive"


class PECS_OT_allow_scripts(_Mends, bpy.types.Operator):
    """Run the file's Python in the render"""

    bl_idname = "pecs.allow_scripts"
    bl_label = "Allow scripts"

    def mend(self, scene, _view_layer) -> None:
        scene.pecs.allow_scripts = True


class PECS_OT_no_denoise(_Mends, bpy.types.Operator):
    """Render without denoising"""

    bl_idname = "pecs.no_denoise"
    bl_label = "Do not denoise"

    def mend(self, scene, _view_layer) -> None:
        scene.pecs.denoise = False


class PECS_OT_take_noise_target(_Mends, bpy.types.Operator):
    """Let the render choose as many samples as a noise of a tenth of the contrast threshold takes"""

    bl_idname = "pecs.take_noise_target"
    bl_label = "Take a noise target"

    def mend(self, scene, _view_layer) -> None:
        scene.pecs.noise_target = NOISE_TARGET


class PECS_OT_clip_far(_Mends, bpy.types.Operator):
    """Let the camera see as far as things reach"""

    bl_idname = "pecs.clip_far"
    bl_label = "See to the end"

    def mend(self, scene, view_layer) -> None:
        camera = scene.camera
        ahead = -(np.array(camera.matrix_world.normalized().inverted()) @ _corners(view_layer))[2]
        camera.data.clip_end = max(camera.data.clip_end, 1.1 * float(ahead.max(initial=0)))


CLASSES = (
    PECS_OT_check_scene,
    PECS_OT_take_adaptive,
    PECS_OT_allow_scripts,
    PECS_OT_no_denoise,
    PECS_OT_take_noise_target,
    PECS_OT_clip_far,
)


@bpy.app.handlers.persistent
def _forget(*_) -> None:
    """Another file is opened."""
    state.found.clear()


def register() -> None:
    bpy.app.handlers.load_pre.append(_forget)


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_forget)
