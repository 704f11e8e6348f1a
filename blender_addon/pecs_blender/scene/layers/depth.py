# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the surface is that is seen at a pixel's centre: Cycles' Position pass of one sample, along chief rays.

Cycles takes Position from the first sample, which goes through the pixel's centre, whatever the filter. A lens's camera
would send it anywhere through the pupil; so another camera sends each pixel's chief ray from the pupil's centre, in the
direction that the prescription says (pecs.Lens.directions).
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from .. import cycles
from ..job import Job

NO_SURFACE = 1e10  # what Cycles' Depth pass says there

CHIEF_RAYS = """
shader chief_rays(output point position = 0, output vector direction = 0, output color throughput = 1) {{
  vector raster = camera_shader_raster_position();
  color d = texture("{path}", raster[0], 1 - raster[1], "interp", "closest");
  direction = vector(d[0], d[1], d[2]);
}}
"""


class Depth:
    name, channels, unit, at = "depth", ("distance", "z"), "m", "instant"

    def __init__(self, job: Job, scratch: Path):
        self._job, self._film = job, cycles.Film(job.source.scene)
        self._chief_rays = self._lens_camera(scratch) if job.lens else None

    def _lens_camera(self, scratch: Path) -> bpy.types.Object:
        lens, (width, height) = self._job.lens, self._job.size
        pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)
        directions = lens.lens.directions(
            pixels,
            width=width,
            height=height,
            pixel_pitch_mm=lens.pixel_pitch_mm,
            lambda_nm=float(self._job.lambda_nm.mean()),
            focus_bands_nm=self._job.lambda_nm.tolist(),
            film_shift_mm=lens.shift_mm,
            film_tilt_deg=lens.tilt_deg,
            **lens.setting,
        )
        seen = np.nan_to_num(directions * (1, -1, 1))  # Cycles' camera axes: y up; no chief ray, no surface
        path = scratch / "chief_rays.exr"
        cycles.save_picture(seen.astype(np.float32), path, self._job.source.scene)
        return cycles.osl_camera("chief_rays", CHIEF_RAYS.format(path=path), scratch)

    def render(self, t_s: float) -> np.ndarray:
        scene = self._job.source.scene
        with self._camera() as camera, cycles.for_one_sample(scene, camera):
            location, rotation, _ = camera.matrix_world.decompose()
            parallel = camera.data.type == "ORTHO"
            passes = self._film.passes("Position", "Depth")
        ray = passes["Position"].astype(float) - np.array(location)[:, None, None]
        z = -np.einsum("c,cyx->yx", np.array(rotation.to_matrix())[:, 2], ray)
        depth = np.stack([z if parallel else np.linalg.norm(ray, axis=0), z]) * self._job.source.unit_m
        return np.where(passes["Depth"] < NO_SURFACE, depth, np.inf).astype(np.float32)

    @contextmanager
    def _camera(self):
        """The lens's chief rays, or the scene's camera with all in focus."""
        source = self._job.source
        if self._chief_rays:
            source.place([self._chief_rays])
            bpy.context.view_layer.update()
            yield self._chief_rays
            return
        own = source.scene.camera
        sharp = own.copy()
        sharp.data = own.data.copy()
        for block in (sharp, sharp.data):
            block.animation_data_clear()
        sharp.constraints.clear()
        sharp.parent, sharp.matrix_world = None, own.matrix_world.copy()
        sharp.data.dof.use_dof = False
        source.scene.collection.objects.link(sharp)
        try:
            bpy.context.view_layer.update()
            yield sharp
        finally:
            data = sharp.data
            bpy.data.objects.remove(sharp)
            bpy.data.cameras.remove(data)
