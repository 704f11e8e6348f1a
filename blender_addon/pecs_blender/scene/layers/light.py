# SPDX-License-Identifier: GPL-3.0-or-later
"""The light: film irradiance, or radiance, in every band.

Radiance in Cycles is relative so that values are O(1): in band k every lamp is divided by the strongest lamp's value
n_k there (core/light.py). Absolute radiance = rendered * n_k * s, where s is the scene's (Source.radiance_per_unit).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .. import cycles
from .. import lens as lenses
from ..job import Job


class Light:
    name, unit, at = "light", "as stack.json's quantity", "instant"

    def __init__(self, job: Job, sampling: cycles.Sampling):
        """Chooses samples and seed, and renders with them what is the same in every frame."""
        scene = job.source.scene
        self.channels = tuple(f"{nm:g} nm" for nm in job.lambda_nm)
        self._job, self._film = job, cycles.Film(scene)
        self._shape = (len(job.lambda_nm), *job.size[::-1])
        rays = replace(sampling, samples=sampling.samples * job.rays_per_sample)
        scene.cycles.samples, scene.cycles.seed = rays.samples, rays.seed
        to_film = job.unit[:, None, None]
        if job.lens and not any(job.lens.tilt_deg):  # tables of flat films
            to_film = to_film * lenses.even_out(job.lens, job.passes, job.lambda_nm, job.size, rays)
        self._to_film = to_film.astype(np.float32)
        if job.moving_px:
            cycles.set_border(scene, None)
            job.set_time(0.0)
            self._still = self._passes()
            cycles.set_border(scene, job.moving_px)

    def render(self, t_s: float) -> np.ndarray:
        frame = self._passes()
        if self._job.moving_px:
            left, top, right, bottom = self._job.moving_px
            fresh, frame = frame, self._still.copy()
            frame[:, top:bottom, left:right] = fresh[:, top:bottom, left:right]
        frame *= self._to_film
        for one in self._job.passes:
            for picture, blur in zip(frame[one.bands], one.blurs, strict=False):  # none without diffraction
                blur(picture)
        return frame

    def _passes(self) -> np.ndarray:
        job, frame = self._job, np.empty(self._shape, np.float32)
        for one in job.passes:
            if job.lens:
                job.source.scene.camera = one.camera
            job.spectral.set_pass(one.rgb_nm)
            frame[one.bands] = self._film.render()[: one.bands.stop - one.bands.start]
        return frame
