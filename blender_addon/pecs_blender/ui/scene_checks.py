# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of the whole scene for causes of wrong events, by a button since they take 0.5 s and step through the
animation. checks.py has the fast checks for errors that would stop a job."""

from __future__ import annotations

import math
from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix, Vector
from pecs._text import counted

from ..job.options import SAMPLES
from ..scene.blend import notes, python_drivers
from ..scene.outside_files import missing_files
from ..spectral.spectral_scene import beyond_reach
from . import settings
from .background import state
from .checks import Problem
from .interface import Action, Edit

TIMES = 8  # sampled times of the rendered range
MOST_PX = 1.0  # motion between frames above which the light jumps
MOST_NOISE, NOISE_EVENTS = 0.3, 0.1  # in contrast thresholds: visible in the events; not visible
GRID = 32, 24  # rays across and down
SHOWN = 5  # names listed
SOLID = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "VOLUME")


def check(scene, view_layer) -> list[Problem]:
    """All checks; restores the current frame. Takes 0.5 s or more."""
    parts = (
        files(scene),
        _left_out(scene),
        _lamps(scene),
        _nodes(),
        _noise(scene),
        _clip(scene, view_layer),
        _motion(scene, view_layer),
    )
    return [one for part in parts for one in part]


def files(scene) -> Iterator[Problem]:
    if missing := list(missing_files(scene)):
        yield Problem(_list("Missing files", missing), fix="file.find_missing_files")
    if not scene.pecs.allow_scripts and (drivers := list(python_drivers())):
        yield Problem(_list("Python scripts to run", drivers), fix="pecs.allow_scripts")


def _left_out(scene) -> Iterator[Problem]:
    for note in notes(scene):
        yield Problem(note, is_error=False)


def _lamps(scene) -> Iterator[Problem]:
    lights = {o.data for o in scene.objects if o.type == "LIGHT" and not o.hide_render}
    white = [light for light in lights if "pecs_spectrum" not in light and not getattr(light, "use_temperature", False)]
    if white:
        text = f"Lamps without a spectrum, rendered as {scene.pecs.illuminant}"
        yield Problem(_list(text, sorted(light.name for light in white)), is_error=False)


def _nodes() -> Iterator[Problem]:
    owners = [one for kind in (bpy.data.materials, bpy.data.lights, bpy.data.worlds) for one in kind if one.users]
    trees = [(one.name, one.node_tree) for one in owners if one.node_tree]
    trees += [(group.name, group) for group in bpy.data.node_groups if group.users]
    kinds = [words for name, tree in trees for node in tree.nodes for words in beyond_reach(node, name)]
    if kinds:
        yield Problem(_list("Approximated", kinds), is_error=False)


def _noise(scene) -> Iterator[Problem]:
    """Frames share their samples, so noise flickers only at moving objects."""
    s = scene.pecs
    measured = state.light.get(scene.name)
    if s.engine != "cycles" or s.noise_events or not measured or measured["noise_thresholds"] is None:
        return
    samples = s.samples or SAMPLES[s.time]
    noise = measured["noise_thresholds"] * math.sqrt(measured["samples"] / samples)
    if noise > MOST_NOISE:
        wanted = math.ceil(samples * (noise / MOST_NOISE) ** 2)
        text = (
            f"Render noise of about {noise:.2g} contrast thresholds flickers at moving objects and causes false events."
            f" Use at least {wanted} samples, or limit the noise events"
        )
        yield Problem(text, is_error=False, fix="pecs.set_noise_events")


def _clip(scene, view_layer) -> Iterator[Problem]:
    """Objects beyond the clip end of the scene's camera; a lens has no clip end."""
    camera = scene.camera
    if not camera or camera.type != "CAMERA" or settings.has_lens(scene.pecs):
        return
    far = _farthest(camera, view_layer)
    if far > camera.data.clip_end:
        text = f"The camera's clip end is {camera.data.clip_end:g}, but objects extend to {far:.4g}"
        yield Problem(text, is_error=False, fix="pecs.extend_clip_end")


def _farthest(camera, view_layer) -> float:
    """Greatest depth of a bounding box's corner at the current frame; 0 if nothing is ahead."""
    solid = [o for o in view_layer.objects if o.type in SOLID and not o.hide_render]
    shown = [o for o in solid if o.visible_get(view_layer=view_layer)]
    back = camera.matrix_world.normalized().inverted()
    return max((-(back @ o.matrix_world @ Vector(corner)).z for o in shown for corner in o.bound_box), default=0.0)


def _motion(scene, view_layer) -> Iterator[Problem]:
    """Maximum motion of visible surfaces between frames, at TIMES times of the range."""
    s = scene.pecs
    if s.time != "uniform" or not scene.camera or scene.camera.type != "CAMERA":
        return
    frame, subframe = scene.frame_current, scene.frame_subframe
    instants = np.unique(np.linspace(0, max(0, settings.frame_count(scene) - 2), TIMES).astype(int))
    try:
        fastest = max(_motion_px(scene, view_layer, i / s.fps, (i + 1) / s.fps) for i in instants.tolist())
    finally:
        scene.frame_set(frame, subframe=subframe)
    if fastest > MOST_PX:
        text = (
            f"Objects move up to {fastest:.3g} pixels between frames, so their light jumps. Use adaptive steps, or a "
            f"frame rate {math.ceil(fastest)} times as high"
        )
        yield Problem(text, is_error=False, fix="pecs.use_adaptive")


def _motion_px(scene, view_layer, from_s: float, to_s: float) -> float:
    """Maximum image motion of the surface points hit by a grid of rays; they move with their objects."""
    width, height = settings.size(scene)
    clip_from_world = _set_time(scene, from_s, width, height)
    depsgraph, world_from_clip = view_layer.depsgraph, clip_from_world.inverted()
    points = []
    for y in np.linspace(-0.98, 0.98, GRID[1]):
        for x in np.linspace(-0.98, 0.98, GRID[0]):
            near, far = (point.xyz / point.w for point in (world_from_clip @ Vector((x, y, z, 1)) for z in (-1, 1)))
            hit, at, _, _, thing, matrix = scene.ray_cast(depsgraph, near, (far - near).normalized())
            if hit:
                # An instance has another matrix; its points do not move.
                rigid = (matrix.translation - thing.matrix_world.translation).length < 1e-6
                points.append((x, y, thing.original if rigid else None, matrix.inverted() @ at if rigid else at.copy()))
    before = scene.camera
    clip_from_world, longest = _set_time(scene, to_s, width, height), 0.0
    if scene.camera != before:  # by a marker: a cut is no motion
        return 0.0
    for x, y, thing, at in points:
        now = clip_from_world @ (thing.matrix_world @ at if thing else at).to_4d()
        if now.w > 0:
            longest = max(longest, math.hypot((now.x / now.w - x) * width / 2, (now.y / now.w - y) * height / 2))
    return longest


def _set_time(scene, t_s: float, width: int, height: int) -> Matrix:
    """Sets the scene to this time; returns clip_from_world of the camera."""
    at = scene.frame_start + t_s * scene.render.fps / scene.render.fps_base
    scene.frame_set(int(at // 1), subframe=at % 1)
    camera = scene.camera
    projection = camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=width, y=height)
    return projection @ camera.matrix_world.normalized().inverted()


def _list(what: str, names: list[str]) -> str:
    text = f"{what}: {', '.join(names[:SHOWN])}"
    return text if len(names) <= SHOWN else f"{text}, and {len(names) - SHOWN} more"


class PECS_OT_check_scene(Action, bpy.types.Operator):
    """Check the scene for causes of wrong events: fast motion, missing files, lamps without a spectrum, noise, …"""

    bl_label = "Check Scene"

    def act(self, context) -> str:
        scene = context.scene
        state.problems[scene.name] = problems = check(scene, context.view_layer)
        return f"{counted(len(problems), 'problem')} found" if problems else "No problems found"


class _Fix(Edit):
    """Applies a fix, then repeats the checks."""

    def execute(self, context):
        result = super().execute(context)
        if context.scene.name in state.problems:
            state.problems[context.scene.name] = check(context.scene, context.view_layer)
        return result


class PECS_OT_use_adaptive(_Fix, bpy.types.Operator):
    """Render keyframes and the motion between them"""

    bl_label = "Use Adaptive Steps"
    setting = "time", "adaptive"


class PECS_OT_allow_scripts(_Fix, bpy.types.Operator):
    """Run the file's Python scripts in the render"""

    bl_label = "Allow Scripts"
    setting = "allow_scripts", True


class PECS_OT_set_noise_events(_Fix, bpy.types.Operator):
    """Let the render choose the samples so that at most a tenth of the events comes from its noise"""

    bl_label = "Limit Noise Events"
    setting = "noise_events", NOISE_EVENTS


class PECS_OT_extend_clip_end(_Fix, bpy.types.Operator):
    """Extend the camera's clip end to the farthest object"""

    bl_label = "Extend Clip End"

    def act(self, context) -> None:
        camera = context.scene.camera
        camera.data.clip_end = max(camera.data.clip_end, 1.1 * _farthest(camera, context.view_layer))
