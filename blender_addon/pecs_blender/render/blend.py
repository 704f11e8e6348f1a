# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend file as a source of renders: opened and checked, never written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
from pecs._errors import ExitCode, PecsError, PecsInputError, PecsNotFoundError, bad_input

from . import content, cycles
from .source import Source
from .spectra import Spectrum

FOLDER_KEY = "pecs_folder"  # custom property of the scene in a temporary copy: folder of the original


class BlendScene(Source):
    def __init__(self, path: Path, scene_name: str | None, illuminant: Spectrum, allow_scripts: bool):
        if not path.is_file():
            raise PecsNotFoundError(f"{path}: no such file")
        try:
            with cycles.quiet(2):
                bpy.ops.wm.open_mainfile(filepath=str(path.absolute()), load_ui=False, use_scripts=allow_scripts)
        except RuntimeError as e:
            raise PecsInputError(f"{path}: {' '.join(str(e).split())}") from None
        if scene_name and scene_name not in bpy.data.scenes:
            names = ", ".join(s.name for s in bpy.data.scenes)
            raise bad_input(path, "--scene-name", repr(scene_name), f"one of {names}")
        self.scene = bpy.data.scenes[scene_name] if scene_name else bpy.context.scene
        if bpy.context.window:
            bpy.context.window.scene = self.scene
        self.folder = Path(self.scene.get(FOLDER_KEY, path.absolute().parent))
        for driver in () if allow_scripts else python_drivers():
            raise PecsError(f"{path}: {driver}; --allow-scripts runs it", ExitCode.UNSUPPORTED)
        for missing in missing_files():
            raise PecsNotFoundError(f"{path}: {missing}")
        if not self.scene.camera:
            raise bad_input(path, f"scene {self.scene.name!r}", "no camera", "an active camera")
        if self.scene.frame_end < self.scene.frame_start:
            raise bad_input(path, f"scene {self.scene.name!r}", "zero frames", "an end after the start")
        render = self.scene.render
        self.size = tuple(n * render.resolution_percentage // 100 for n in (render.resolution_x, render.resolution_y))
        self._fps = render.fps / render.fps_base
        self.duration_s = (self.scene.frame_end - self.scene.frame_start + 1) / self._fps
        self.unit_m = self.scene.unit_settings.scale_length
        self.lens = {"lens": "none", "stop_diameter_mm": None, "focus_m": None}
        self.bounces = {key: getattr(self.scene.cycles, key) for key in cycles.BOUNCES}
        self.record = {
            "name": path.stem,
            "scene": self.scene.name,
            "content_sha256": content.digest(self.scene),
            "illuminant": illuminant.name,
        }
        self._illuminant, self._camera = illuminant, self.scene.camera
        # Blender would replace a lens camera by a marker's camera at every render.
        self._cuts = [(m.frame, m.camera) for m in self.scene.timeline_markers if m.camera and not m.camera.hide_render]
        self._cuts.sort(key=lambda cut: cut[0])
        self.scene.timeline_markers.clear()
        for layer in self.scene.view_layers:
            layer.use = layer == self.scene.view_layers[0]

    def set_time(self, t_s: float) -> None:
        """t = 0 is the scene's first frame."""
        frame = round(self.scene.frame_start + t_s * self._fps, 6)
        if self._cuts:  # the last marker's camera; before the first marker, its camera
            self._camera = [self._cuts[0], *(cut for cut in self._cuts if cut[0] <= frame)][-1][1]
        self.scene.camera = self._camera
        if self.path:
            self._camera.matrix_world = self.on_path(t_s)
        if self.placed:
            self.placed.pose(t_s)
        self.scene.frame_set(int(frame // 1), subframe=frame % 1)
        if not self.fnumber:  # t = 0 comes first
            fstop = self._camera.data.dof.aperture_fstop
            self.fnumber = float(f"{fstop:.6g}") if 0.1 <= fstop <= 1e4 else None

    def follow(self, path) -> None:
        super().follow(path)
        for camera in {self._camera, *(camera for _, camera in self._cuts)}:  # nothing else may move them
            camera.animation_data_clear()
            camera.constraints.clear()
            camera.parent = None

    def camera(self, focal_mm: float, film_width_mm: float):
        return self._camera  # unchanged, with its depth of field

    def place(self, cameras) -> None:
        location, rotation, _ = self._camera.matrix_world.decompose()
        for camera in cameras:
            camera.rotation_mode = "QUATERNION"
            camera.location, camera.rotation_quaternion = location, rotation

    def radiance_per_unit(self, spectral) -> float:
        """Blender's watts are radiant watts of the illuminant: radiance 1 is 1 W m^-2 sr^-1 over the illuminant's
        table."""
        return self._illuminant.luminous() / self._illuminant.power()


def python_drivers() -> Iterator[str]:
    """Drivers beyond Blender's simple expressions."""
    for block in _all_ids():
        for holder in (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None)):
            for curve in getattr(getattr(holder, "animation_data", None), "drivers", ()):
                driver = curve.driver
                if driver.type == "SCRIPTED" and not driver.is_simple_expression:
                    yield f"{block.name}: {curve.data_path}: Python driver {driver.expression!r}"


def missing_files() -> Iterator[str]:
    for library in bpy.data.libraries:
        if not Path(bpy.path.abspath(library.filepath)).is_file():
            yield f"library {library.filepath}: no such file"
    for image in bpy.data.images:
        if image.source in ("FILE", "SEQUENCE", "MOVIE") and image.users and not image.packed_file:
            if image.filepath and not Path(bpy.path.abspath(image.filepath, library=image.library)).is_file():
                yield f"image {image.name!r}: {image.filepath}: no such file"


def _all_ids():
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION":
            for block in getattr(bpy.data, prop.identifier):
                if isinstance(block, bpy.types.ID):
                    yield block
