# SPDX-License-Identifier: GPL-3.0-or-later
"""The interface between a scene and the renderer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np

from .camera_path import CameraPath
from .placed import Placed
from .sky import Sky

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # from x right, y down, z forward to Blender's camera axes, and back


class Source(ABC):
    """scene: the Blender scene to render. unit_m: metres per unit of its coordinates. lens: `lens` (a name or "none"),
    `stop_diameter_mm`, `focus_m`. size: pixels. bounces: Cycles settings. record: for stack.json. folder: of files with
    relative paths. path: replaces the camera's own motion. own_camera: the scene's camera since the last set_time;
    `scene.camera` may be one that renders a part of a frame. placed: objects of other files. fnumber: of own_camera at
    t = 0. lamps: not animated, but set_time changes their strength. notes: on what a render leaves out of
    the scene."""

    scene: bpy.types.Scene
    folder: Path
    lens: dict[str, Any]
    size: tuple[int, int]
    bounces: dict[str, Any]
    record: dict[str, Any]
    period_s: float | None = None
    unit_m: float = 1.0
    duration_s: float | None = None  # of `--frames all`
    path: CameraPath | None = None
    own_camera: bpy.types.Object | None = None
    placed: Placed | None = None
    sky: Sky | None = None  # of a picture
    fnumber: float | None = None
    lamps: tuple[bpy.types.Light, ...] = ()
    notes: tuple[str, ...] = ()

    def follow(self, path: CameraPath) -> None:
        """Moves the camera along a path, from the next set_time on."""
        self.path = path

    def on_path(self, t_s: float) -> mathutils.Matrix:
        """matrix_world of a camera that follows the path."""
        matrix = self.path.world_from_camera(t_s) @ FLIP
        matrix[:3, 3] /= self.unit_m
        return mathutils.Matrix(matrix)

    def check_times(self, times_ns: list[int]) -> None:  # noqa: B027 (scene folders know any time)
        """Raises PecsInputError if the scene cannot be moved to such times."""

    @abstractmethod
    def set_time(self, t_s: float) -> None:
        """Moves everything to an instant."""

    def camera_at(self, t_s: float) -> bpy.types.Object | None:
        """The scene's camera at a time."""
        return self.own_camera

    @abstractmethod
    def make_camera(self, focal_mm: float, film_width_mm: float) -> None:
        """Makes own_camera, if the scene has none yet."""

    @abstractmethod
    def place(self, cameras: list[bpy.types.Object]) -> None:
        """Moves lens cameras to own_camera."""

    @abstractmethod
    def radiance_per_unit(self, spectral) -> float:
        """Spectral radiance [W m^-2 sr^-1 nm^-1] = rendered * n_k * this (emitters.py)."""
