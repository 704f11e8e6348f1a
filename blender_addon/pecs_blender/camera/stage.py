# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene that is set up for rendering: posed, spectral, lit, with a camera for each pass."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from pecs._errors import UsageError

from ..scene import cycles, raster
from ..scene.lamps import Lamps
from ..scene.source import Source
from ..spectral.palette import choose, words
from ..spectral.spectral_scene import SpectralScene
from . import lens
from .plan import Plan
from .probe import light_scale


class Stage:
    """size: rendered pixels, width and height, `subpixels` in x and y for each of the sensor's. bands: as stack.json
    lists them; lambda_nm: their wavelengths. weights: photocurrent per light in each band. lens: None for the scene's
    own camera. unit: per band, the film irradiance (without a lens: radiance) of a rendered 1. radiance_per_unit:
    spectral radiance per rendered 1 and relative power of the lamps. moving_px: the only part that changes, None for
    all. rays_per_sample: so that each band gets its samples. lamps: those of animated strength, whose light adaptive
    steps render apart; factors: their strengths at the current instant.
    """

    def __init__(self, source: Source, plan: Plan, scratch: Path):
        view, bands, scene = plan.view, plan.bands, source.scene
        self.source, self.scratch, self._engine = source, scratch, plan.sampling.engine
        self.size, self.subpixels, self.moving_px = view.size, view.subpixels, view.moving_px
        self.lens = lens.choose(source, view)
        self.devices = cycles.device_names(plan.sampling.device)
        if self._engine == "eevee" and plan.light:
            raster.check_graphics()
        if self.lens and self._engine == "eevee":
            raise UsageError("--engine eevee has no --lens: --lens none takes a pinhole or the .blend's camera")
        cycles.configure(scene, *self.size, plan.sampling)
        self.spectral = SpectralScene(bands.illuminant, source.folder, source.unit_m)
        self._chosen = choose(bands, self.spectral)
        self.bands, self.lambda_nm = self._chosen.entries, self._chosen.bands.lambda_nm
        self.weights = np.array(bands.chip.amperes_per_unit(self.bands))
        apart = plan.instants.step_px and plan.light and self._engine == "cycles"  # EEVEE has no light groups
        self.lamps = Lamps(source, [t * 1e-9 for t in plan.instants.grid.bounds_ns] if apart else [])
        if view.path:
            source.follow(view.path)
        source.set_time(0.0)
        self.factors = self.lamps.factors(0.0)
        self.light_scale = light_scale(source, self.spectral, bands.lux) if bands.lux else bands.light_scale
        self.radiance_per_unit = source.radiance_per_unit(self.spectral) * self.light_scale if plan.light else 1.0
        if self.lens:
            cameras = lens.cameras(self.lens, self._chosen, view, bands.per_pass, source.unit_m, scratch)
        else:
            source.make_camera(view.focal_mm, view.film_width_mm)
            cameras = lens.own_camera(self._chosen.bands, bands.per_pass)
        self.passes, self.rays_per_sample, self.lens_record = cameras.passes, cameras.rays_per_sample, cameras.record
        self._place()
        self.unit = self.spectral.emitters.norm(self._chosen.bands) * self.radiance_per_unit * cameras.e0

    def set_time(self, t_s: float) -> None:
        self.spectral.before_instant()
        self.source.set_time(t_s)
        self.lamps.hold()
        self.spectral.after_instant()
        self.factors = self.lamps.factors(t_s)
        self._place()

    def _place(self) -> None:
        if self.lens:
            self.source.place([one.camera for one in self.passes])

    def camera_of(self, one: lens.Pass) -> bpy.types.Object:
        """The camera that renders a pass now."""
        return one.camera or self.source.own_camera

    def film(self, samples: int) -> cycles.Film | raster.Film:
        """Renders what the scene's camera sees. samples: of each rendered pixel, for the raster engine."""
        scene = self.source.scene
        return raster.Film(scene, samples, self.scratch) if self._engine == "eevee" else cycles.Film(scene)

    @property
    def _approximated(self) -> list[str]:
        own = [raster.approximated(self.spectral.emitting)] if self._engine == "eevee" else []
        return self.spectral.approximated + own

    def print_choices(self) -> None:
        """The bands' number, their estimated error, and what is approximated."""
        chosen = [words(self._chosen, len(self.passes))] if self._chosen.edges_nm else []
        for line in chosen + [f"approximated: {text}" for text in self._approximated]:
            print(f"render: {line}", file=sys.stderr)

    def record(self, plan: Plan) -> dict[str, Any]:
        """Entries of stack.json's "render" that the scene decides."""
        source, bands = self.source, plan.bands
        return {
            **self._chosen.record,
            "light_scale": self.light_scale,
            **({"lux": bands.lux} if bands.lux else {}),
            **({"camera_path_sha256": source.path.sha256} if source.path else {}),
            **({"placed": source.placed.record} if source.placed else {}),
            **({"sky": source.sky.record} if source.sky else {}),
            "emitters": [s.name for s in self.spectral.emitters.spectra],
            "lamps": [[nm, float(f"{power:.6g}")] for nm, power in self.spectral.emitters.mean_pairs() or []],
            "radiance_per_relative_power": self.radiance_per_unit if plan.light else None,
            "approximated": self._approximated,
            **({"eevee": raster.SETTINGS} if self._engine == "eevee" else {"cycles": plan.sampling.settings}),
            "device": ", ".join(self.devices),
        }
