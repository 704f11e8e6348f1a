# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene that is set up for rendering: posed, spectral, lit, with a camera for each pass."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..scene import cycles
from ..scene.cycles import Sampling
from ..scene.lamps import Lamps
from ..scene.source import Source
from ..scene.timeline import passes
from ..spectral.bands import Bands
from ..spectral.palette import choose, words
from ..spectral.spectral_scene import SpectralScene
from . import lens
from .plan import Plan, View
from .probe import light_scale


class Stage:
    """Layers ask it for what they need.

    size: rendered pixels, width and height, `subpixels` in x and y for each of the sensor's. bands: as stack.json lists
    them; lambda_nm: their wavelengths. weights: photocurrent per light in each band. lens: None for the scene's own
    camera. unit: per band, the film irradiance (without a lens: radiance) of a rendered 1. radiance_per_unit: spectral
    radiance per rendered 1 and relative power of the lamps. moving_px: the only part that changes, None for all.
    rays_per_sample: so that each band gets its samples. lamps: those of animated strength, whose light adaptive steps
    render apart; factors: their strengths at the current instant.
    """

    def __init__(self, source: Source, plan: Plan, scratch: Path):
        self.source, self.scratch = source, scratch
        self.size, self.subpixels, self.moving_px = plan.view.size, plan.view.subpixels, plan.view.moving_px
        self.lens = lens.choose(source, plan.view)
        self._set_up_cycles(plan.sampling)
        self._choose_bands(plan.bands)
        apart = plan.instants.step_px and plan.light
        times_s = [t * 1e-9 for t in plan.instants.grid.bounds_ns] if apart else []
        self.lamps = Lamps(source, times_s)
        self._pose_first_instant(plan.view)
        self._measure_light(plan.bands, plan.light)
        self._build_cameras(plan.view, plan.bands.per_pass)

    def _set_up_cycles(self, sampling: Sampling) -> None:
        self.devices = cycles.device_names(sampling.device)
        cycles.configure(self.source.scene, *self.size, sampling)

    def _choose_bands(self, bands: Bands) -> None:
        self.spectral = SpectralScene(bands.illuminant, self.source.folder, self.source.unit_m)
        self._chosen = chosen = choose(bands, self.spectral)
        self.bands, self.lambda_nm = chosen.entries, chosen.bands.lambda_nm
        self.weights = np.array(bands.chip.amperes_per_unit(self.bands))

    def _pose_first_instant(self, view: View) -> None:
        if view.path:
            self.source.follow(view.path)
        self.source.set_time(0.0)

    def _measure_light(self, bands: Bands, light: bool) -> None:
        self.light_scale = light_scale(self.source, self.spectral, bands.lux) if bands.lux else bands.light_scale
        self.radiance_per_unit = self.source.radiance_per_unit(self.spectral) * self.light_scale if light else 1.0

    def _build_cameras(self, view: View, per_pass: int) -> None:
        band_set = self._chosen.bands
        self.unit = self.spectral.emitters.norm(band_set) * self.radiance_per_unit
        slices = passes(len(self.bands), per_pass)
        self.lens_record, self.rays_per_sample = None, 1
        if not self.lens:
            self.source.make_camera(view.focal_mm, view.film_width_mm)
            self.passes = tuple(lens.Pass(one, band_set.of_pass(one), None) for one in slices)
            return
        made = lens.cameras(self.lens, self._chosen, slices, view.colour_tolerance_px, self.source.unit_m, self.scratch)
        self.passes, self.rays_per_sample, self.lens_record = made.passes, made.rays_per_sample, made.record
        for key in ("colour_shift_px", "mixed_shift_px"):
            self.lens_record[key] /= self.subpixels
        self.unit = self.unit * made.e0

    def set_time(self, t_s: float) -> None:
        self.spectral.before_instant()
        self.source.set_time(t_s)
        self.lamps.hold()
        self.spectral.after_instant()
        self.factors = self.lamps.factors(t_s)
        if self.lens:
            self.source.place([one.camera for one in self.passes])

    def camera_of(self, one: lens.Pass) -> bpy.types.Object:
        """That renders a pass now."""
        return one.camera or self.source.own_camera

    def print_bands(self) -> None:
        """Their number, and the estimated error."""
        if self._chosen.edges_nm:
            print(f"render: {words(self._chosen, len(self.passes))}", file=sys.stderr)

    def record(self, plan: Plan) -> dict[str, Any]:
        """Entries of stack.json's "render" that the scene decides."""
        source, bands = self.source, plan.bands
        return {
            **self._chosen.record,
            "light_scale": self.light_scale,
            **({"lux": bands.lux} if bands.lux else {}),
            **({"camera_path_sha256": source.path.sha256} if source.path else {}),
            **({"placed": source.placed.record} if source.placed else {}),
            "emitters": [s.name for s in self.spectral.emitters.spectra],
            "lamps": [[nm, float(f"{power:.6g}")] for nm, power in self.spectral.emitters.mean_pairs() or []],
            "radiance_per_relative_power": self.radiance_per_unit if plan.light else None,
            "approximated": self.spectral.approximated,
            "cycles": cycles.SETTINGS | source.bounces,
            "device": ", ".join(self.devices),
        }
