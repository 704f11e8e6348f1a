# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated events in Blender: over the 3-D viewport, and as an image, both of the current frame of the timeline.
Without events to show there is no handler."""

from __future__ import annotations

from pathlib import Path

import bpy
import gpu
import numpy as np
import pecs
from bpy.props import BoolProperty
from gpu_extras.presets import draw_texture_2d

from . import disk, live_view, operators, paths
from .interface import Action, redraw

IMAGE = "PECS Events"


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
        at = scene.frame_current_final, scene.frame_start
        if not self._drawn or self._drawn[0] != at:
            rgba = self.picture(scene)
            buffer = gpu.types.Buffer("FLOAT", rgba.size, rgba.ravel())
            self._drawn = at, gpu.types.GPUTexture((rgba.shape[1], rgba.shape[0]), format="RGBA32F", data=buffer)
        gpu.state.blend_set("ALPHA")
        place = _place(context, scene, space, region, self.events)
        draw_texture_2d(self._drawn[1], *place)
        gpu.state.blend_set("NONE")


def _place(context, scene, space, region, events) -> tuple[tuple[float, float], float, float]:
    """Corner, width and height: the camera's image, or an inset if the viewport does not look through the camera."""
    rectangle = None
    if space.region_3d.view_perspective == "CAMERA" and (space.camera or scene.camera) == scene.camera:
        depsgraph = context.view_layer.depsgraph
        camera = scene.camera.evaluated_get(depsgraph)
        projection = camera.calc_matrix_camera(depsgraph, x=events.width, y=events.height)
        matrix = camera.matrix_world.normalized()
        rectangle = live_view.of_camera(matrix, projection, region, space.region_3d)
    x, y, width, height = rectangle or live_view.inset(events.width, events.height, region)
    return (x, y), width, height


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


@bpy.app.handlers.persistent
def _on_load(*_) -> None:
    """Runs when another file is opened."""
    hide()


def register() -> None:
    bpy.app.handlers.load_pre.append(_on_load)


def unregister() -> None:
    hide()
    bpy.app.handlers.load_pre.remove(_on_load)
