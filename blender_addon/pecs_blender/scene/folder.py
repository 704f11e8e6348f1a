# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene folder (scene_file.py) as a source of renders."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import bpy
from pecs._errors import bad_input
from pecs._files import sha256

from ..spectral.bands import points
from ..spectral.spectra import K_CD_LM_PER_W, constant, illuminance_lux
from . import build, cycles
from .scene_file import SceneFile
from .source import Source

LOOK_ALONG_Y_DEG = (90.0, 0.0, 0.0)
METER_LAMBDA_NM = (450.0, 550.0, 650.0)
METER_REFLECTANCE = 0.5
METER_SAMPLES = 1 << 16


class FolderScene(Source):
    def __init__(self, scene_file: SceneFile):
        self.scene = cycles.empty_scene()
        self._file, self._t_s = scene_file, 0.0
        self._parts = scene_file.build()
        self.folder = scene_file.folder
        self.lens = scene_file.camera
        self.period_s, self.lamps = self._parts.period_s, self._parts.lamps
        self.size = (1280, 720)
        self.bounces = {"max_bounces": self._parts.bounces, "diffuse_bounces": self._parts.bounces}
        self.record = {
            "name": scene_file.name,
            "content_sha256": _code_sha256(scene_file.folder),
            "parameters": scene_file.parameters,
        }
        if "rotation_deg" in scene_file.camera:
            self.record["rotation_deg"] = scene_file.camera["rotation_deg"]

    def set_time(self, t_s: float) -> None:
        self._parts.pose(t_s)
        self._t_s = t_s
        if self.placed:
            self.placed.pose(t_s)
        if self.path and self.own_camera:
            self.place([self.own_camera])

    def make_camera(self, focal_mm: float, film_width_mm: float) -> None:
        self.own_camera = self.scene.camera = cycles.pinhole_camera("pinhole", focal_mm, film_width_mm)
        self.place([self.own_camera])

    def place(self, cameras) -> None:
        for camera in cameras:
            if self.path:
                camera.matrix_world = self.on_path(self._t_s)
                continue
            camera.rotation_euler = [math.radians(a) for a in self.lens.get("rotation_deg", LOOK_ALONG_Y_DEG)]

    def radiance_per_unit(self, spectral) -> float:
        """Scale for the scene's illuminance, measured on a rendered grey card at the target, so light from the walls
        counts. The card's irradiance per n_k is smooth over wavelength and interpolated."""
        scene, (x, y, z), normal = self.scene, *self._parts.target
        if normal != (0.0, -1.0, 0.0):
            raise bad_input("scene.py", "target", normal, "a normal towards the camera, (0, -1, 0)")
        size_m, gap_m = 0.01, 0.002
        card = build.diffuse("light meter", constant(METER_REFLECTANCE))
        camera = cycles.orthographic_camera("light meter", size_m / 2)
        camera.location = (x, y - 0.05, z)
        camera.rotation_euler = [math.radians(a) for a in LOOK_ALONG_Y_DEG]
        h = size_m / 2
        corners = [(x + sx * h, y - gap_m, z + sz * h) for sx, sz in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        plane = build.mesh_object("light meter card", corners, [(0, 1, 2, 3)], [card])

        if self.sky:  # the scene's illuminance is that of its lamps
            self.sky.shine(0.0)
        # The same seed in each render: cameras of a rig have seeds of their own, and see one light.
        meter = cycles.changed(((scene, {"camera": camera}),))
        with cycles.picture_size(scene, 8, 8, samples=METER_SAMPLES // 64, seed=0), meter:
            self.set_time(0.0)
            spectral.set_pass(points(METER_LAMBDA_NM))
            # Lambert: E = pi L / reflectance
            irradiance = math.pi / METER_REFLECTANCE * cycles.Film(scene).render().astype(float).mean(axis=(1, 2))
        for thing in (camera, plane):
            bpy.data.objects.remove(thing, do_unlink=True)
        norm = spectral.emitters.norm
        lux = illuminance_lux(cycles.interpolated(METER_LAMBDA_NM, irradiance), lambda nm: norm(points(nm)))
        if not lux and not self.sky:
            raise bad_input(self._file.folder / "scene.json", "parameters", "no lamp that shines", "light or a sky")
        # Rounded, so that a job continued on another machine computes the same number.
        scale = float(f"{self._parts.illuminance_lux / lux:.4g}") if lux or not self.sky else 1.0
        if self.sky:
            self.sky.shine(K_CD_LM_PER_W * scale)
        return scale


def _code_sha256(folder: Path) -> str:
    files = [*sorted(folder.glob("*.py")), folder / "scene.json"]
    return hashlib.sha256("".join(map(sha256, files)).encode()).hexdigest()
