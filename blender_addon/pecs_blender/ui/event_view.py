# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated events in Blender: over the 3-D viewport, and as an image, both of the current frame of the timeline.
Without events to show there is no handler."""

from __future__ import annotations

from pathlib import Path

import blf
import bpy
import gpu
import numpy as np
import pecs
from bpy.props import BoolProperty, EnumProperty
from gpu_extras.batch import batch_for_shader
from gpu_extras.presets import draw_texture_2d

from ..truth import LAYERS
from . import disk, live_view, operators, paths
from .interface import Action, redraw

IMAGE = "PECS Events"
GROUND, BORDER, TEXT = (0.05, 0.055, 0.06, 0.6), (0.6, 0.6, 0.6, 1), (1, 1, 1, 1)  # of the inset


class EventView:
    """Runs from its construction to `stop`. Raises PecsError for an invalid file."""

    def __init__(self, path: Path):
        self.path, self.events = path, pecs.events.read(path)
        self._drawn: tuple | None = None  # frame and texture of the last redraw
        self._handle = None
        if not bpy.app.background:
            self._handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        bpy.app.handlers.frame_change_post.append(self.update_image)
        redraw("VIEW_3D")

    def stop(self) -> None:
        if self._handle:
            bpy.types.SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
        bpy.app.handlers.frame_change_post.remove(self.update_image)
        redraw("VIEW_3D")

    def picture(self, scene) -> np.ndarray:
        """Events of the current frame, [height, width, 4], row 0 at the bottom; transparent where there are none."""
        frame_us = 1e6 * scene.render.fps_base / scene.render.fps
        begin_us = (scene.frame_current_final - scene.frame_start) * frame_us
        first, last = np.searchsorted(self.events["t"], (begin_us, begin_us + frame_us))
        now, size = self.events[first:last], (self.events.width, self.events.height)
        rgba = np.zeros((*size[::-1], 4), np.float32)
        rgba[..., :3] = pecs.event_picture(now, *size, theme="dark") / 255
        rgba[now["y"], now["x"], 3] = 1
        return rgba[::-1]

    def update_image(self, scene, *_) -> None:
        """The image, where it exists."""
        if image := bpy.data.images.get(IMAGE):
            rgba = self.picture(scene)
            rgba[..., 3] = 1
            if tuple(image.size) != rgba.shape[1::-1]:  # of other events, or saved in the .blend
                image.scale(*rgba.shape[1::-1])
            image.pixels.foreach_set(rgba.ravel())
            image.pack()  # otherwise Blender asks at its end whether to save the image
            image.update()

    def image(self, scene) -> bpy.types.Image:
        if IMAGE not in bpy.data.images:
            bpy.data.images.new(IMAGE, self.events.width, self.events.height)
        self.update_image(scene)
        return bpy.data.images[IMAGE]

    def _draw(self) -> None:
        context = bpy.context
        scene, space, region = context.scene, context.space_data, context.region
        if not scene.camera or scene.camera.type != "CAMERA" or not space.overlay.show_overlays:
            return
        if live_view.state.view and live_view.state.view.is_in(space):  # two clouds of the same colours
            return
        at = scene.frame_current_final, scene.frame_start
        if not self._drawn or self._drawn[0] != at:
            rgba = self.picture(scene)
            buffer = gpu.types.Buffer("FLOAT", rgba.size, rgba.ravel())
            self._drawn = at, gpu.types.GPUTexture((rgba.shape[1], rgba.shape[0]), format="RGBA32F", data=buffer)
        gpu.state.blend_set("ALPHA")
        image = _camera_image(context, scene, space, region, self.events)
        x, y, width, height = image or live_view.inset(self.events.width, self.events.height, region)
        if not image:
            name = f"{self.path.name}, {self.events.width} x {self.events.height}, frame {scene.frame_current}"
            _draw_ground((x, y, width, height), name)
        draw_texture_2d(self._drawn[1], (x, y), width, height)
        gpu.state.blend_set("NONE")


def _draw_ground(rectangle: live_view.Rectangle, name: str) -> None:
    """Ground, border and name of the inset."""
    x, y, width, height = rectangle
    corners = (x, y), (x + width, y), (x + width, y + height), (x, y + height)
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.bind()
    for kind, positions, colour in (("TRI_FAN", corners, GROUND), ("LINE_STRIP", (*corners, corners[0]), BORDER)):
        shader.uniform_float("color", colour)
        batch_for_shader(shader, kind, {"pos": positions}).draw(shader)
    blf.size(0, 12 * bpy.context.preferences.system.ui_scale)
    blf.color(0, *TEXT)
    blf.position(0, x, y + height + 6, 0)
    blf.draw(0, name)


def _camera_image(context, scene, space, region, events) -> live_view.Rectangle | None:
    """The camera's image in a viewport that looks through the camera."""
    if space.region_3d.view_perspective == "CAMERA" and (space.camera or scene.camera) == scene.camera:
        depsgraph = context.view_layer.depsgraph
        camera = scene.camera.evaluated_get(depsgraph)
        projection = camera.calc_matrix_camera(depsgraph, x=events.width, y=events.height)
        matrix = camera.matrix_world.normalized()
        return live_view.of_camera(matrix, projection, region, space.region_3d)
    return None


class _State:
    view: EventView | None = None


state = _State()


def hide() -> None:
    if state.view:
        state.view.stop()
        state.view = None


def show(path: Path) -> None:
    hide()
    state.view = EventView(path)


class PECS_OT_show_events(Action, bpy.types.Operator):
    """Draw the simulated events of the current frame over the 3-D viewport. Press again to hide them"""

    bl_label = "Events in Viewport"

    in_editor: BoolProperty(name="In Image Editor", options={"SKIP_SAVE"})

    @classmethod
    def why_not(cls, context) -> str:
        events = paths.events(context.scene)
        return "" if disk.is_file(events) else f"{events}: does not exist; simulate the events first"

    @classmethod
    def description(cls, _context, properties) -> str:
        if properties.in_editor:
            return "Show an image of the events that follows the timeline in the image editor"
        return cls.__doc__

    def act(self, context) -> str | None:
        if state.view and not self.in_editor:
            hide()
            return None
        if not state.view:
            show(paths.events(context.scene))
        return operators.show_image(state.view.image(context.scene)) if self.in_editor else None


def layer_picture(name: str, layer: np.ndarray) -> np.ndarray:
    """[height, width, 3] of a layer [channels, height, width]: near is white, linear in 1 / distance; normals and
    directions of motion are colours, black is no motion; each object has a colour, black is none."""
    if name == "depth":
        near = 1 / layer[0]
        return np.repeat((near / max(float(near.max()), 1e-9))[..., None], 3, axis=-1)
    if name == "normal":
        return (1 + layer.transpose(1, 2, 0)) / 2
    if name == "motion":
        x, y = np.nan_to_num(layer[6:8])  # x_end, y_end
        length = np.hypot(x, y)[..., None]
        hue = np.arctan2(y, x)[..., None] + 2 * np.pi / 3 * np.arange(3)
        return (1 + np.cos(hue)) / 2 * np.minimum(1, length / max(float(np.percentile(length, 99)), 1e-6))
    number = layer[0].astype(int)
    colours = np.random.default_rng(4).uniform(0.2, 1, (1 + number.max(), 3))
    colours[0] = 0
    return colours[number]


class PECS_OT_show_layer(Action, bpy.types.Operator):
    """Show a ground-truth layer of the stack, of the rendered frame nearest to the current one, in the image editor"""

    bl_label = "Show Layer"

    layer: EnumProperty(name="Layer", items=[(name, name.capitalize(), "") for name in LAYERS])

    @classmethod
    def why_not(cls, context) -> str:
        stack = paths.rendered(context.scene)
        return "" if disk.is_file(stack / "stack.json") else f"{stack}: does not exist; render the stack first"

    def act(self, context) -> str:
        scene = context.scene
        time_s = (scene.frame_current_final - scene.frame_start) * scene.render.fps_base / scene.render.fps
        with pecs.StackReader(paths.rendered(scene)) as stack:
            if self.layer not in (one["name"] for one in stack.layers):
                raise RuntimeError(f"The stack has no layer {self.layer}. Select it above and render again")
            times_ns = stack.info["times_ns"][:-1] if self.layer == "motion" else stack.info["times_ns"]
            index = min(range(len(times_ns)), key=lambda i: abs(times_ns[i] - 1e9 * time_s))
            picture = layer_picture(self.layer, stack.read_layer(self.layer, index))
        return operators.show_image(operators.image_of(f"PECS {self.layer}", picture))


@bpy.app.handlers.persistent
def on_load(*_) -> None:
    """Runs when another file is opened."""
    hide()


unregister = hide
