# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the lens's field of view in the 3-D viewport: rays around the film, from the entrance pupil to the focus plane.
Tracing takes 0.25 s, so a thread traces and a timer redraws."""

from __future__ import annotations

import threading

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from . import field, library, settings
from .interface import redraw

POLL_S = 0.1
LINES, PLANE = (0.337, 0.706, 0.914, 0.9), (0.337, 0.706, 0.914, 0.08)
FAR_M = 10.0  # depth of the drawing if no focus is set


def setting(scene) -> field.Setting | None:
    """None without a lens. Raises pecs.PecsError for an invalid chip."""
    s = scene.pecs
    if not settings.has_lens(s):
        return None
    focus_m, fnumber = (settings.plain(v) if v else None for v in (settings.focus_m(scene), s.fnumber))
    film_width_mm = settings.plain(settings.film_mm(scene)[0])
    return field.Setting(*library.version("lens", s.lens), focus_m, fnumber, film_width_mm, *settings.size(scene))


class Fields:
    """Cache of the field for the last requested setting, computed in a thread so that redraws do not wait."""

    def __init__(self) -> None:
        self._wanted: field.Setting | None = None
        self._known: tuple[field.Setting, field.Field | None, str] | None = None
        self._thread: threading.Thread | None = None

    def ask(self, wanted: field.Setting) -> tuple[field.Field | None, str]:
        """The field, or None and the error; (None, "") while it is being computed."""
        if self._known and self._known[0] == wanted:
            return self._known[1:]
        self._wanted = wanted
        if not self._thread:
            self._thread = threading.Thread(target=self._compute, args=(wanted,), daemon=True)
            self._thread.start()
            if not bpy.app.timers.is_registered(_show):
                bpy.app.timers.register(_show, first_interval=POLL_S)
        return None, ""

    def _compute(self, wanted: field.Setting) -> None:
        try:
            self._known = (wanted, field.field(wanted), "")
        except Exception as e:  # from the library
            self._known = (wanted, None, str(e))

    def computing(self) -> bool:
        """Whether a computation runs; starts another one if the requested setting has changed."""
        if self._thread and self._thread.is_alive():
            return True
        self._thread = None
        if self._wanted and (not self._known or self._known[0] != self._wanted):
            self.ask(self._wanted)
            return True
        return False


fields = Fields()


def _show() -> float | None:
    if fields.computing():
        return POLL_S
    redraw("VIEW_3D", "PROPERTIES")
    return None


def lines(view: field.Field, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Segments [n, 3] and triangles [n, 3] in Blender's camera axes; `distance` in the scene's units."""
    border = np.concatenate([view.border, np.ones((len(view.border), 1))], axis=1) * (1, -1, -1) * distance
    following = np.roll(border, -1, axis=0)
    origin = np.zeros_like(border)
    corners = border[:: field.SIDE]
    segments = np.concatenate(
        [np.stack([border, following], 1).reshape(-1, 3), np.stack([np.zeros_like(corners), corners], 1).reshape(-1, 3)]
    )
    middle = origin + (0, 0, -distance)
    triangles = np.stack([border, following, middle], 1).reshape(-1, 3)
    return _unblocked(segments, 2), _unblocked(triangles, 3)


def _unblocked(points: np.ndarray, each: int) -> np.ndarray:
    """Without segments or triangles that contain a blocked ray."""
    parts = points.reshape(-1, each * 3)
    return parts[np.isfinite(parts).all(axis=1)].reshape(-1, 3).astype(np.float32)


def draw() -> None:
    """Handler of the 3-D viewport, POST_VIEW."""
    context = bpy.context
    scene = context.scene
    if not scene.pecs_camera.show_field or not scene.camera or not context.space_data.overlay.show_overlays:
        return
    try:
        wanted = setting(scene)
    except RuntimeError:  # invalid chip: reported in the panel
        return
    view = fields.ask(wanted)[0] if wanted else None
    if not view:
        return
    distance = (wanted.focus_m or FAR_M) / scene.unit_settings.scale_length
    segments, triangles = lines(view, distance)
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(scene.camera.matrix_world.normalized())
        gpu.state.blend_set("ALPHA")
        gpu.state.depth_test_set("LESS_EQUAL")
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        drawn = [("LINES", segments, LINES)]
        if context.space_data.region_3d.view_perspective != "CAMERA":  # in camera view it would cover the image
            drawn.append(("TRIS", triangles, PLANE))
        for kind, points, colour in drawn:
            shader.uniform_float("color", colour)
            batch_for_shader(shader, kind, {"pos": points}).draw(shader)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")
