# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the light of a scene: a small render of the first instant with the scene's own camera gives the illuminance
of the surfaces in view, and a chip's photocurrent.

Cycles' diffuse light, direct and indirect, is the radiance of a perfectly white surface there: E = pi L (Lambert). So
every pixel whose surface scatters light is a light meter. The photocurrent is that of the radiance seen: through a lens
by its irradiance per radiance on the axis, else by the camera's f-number.

The event rate is that of some small pictures of the range's beginning: what an edge sweeps grows with the pixels, so a
pixel fires as often in a small picture as in a large one, except where texture is too fine for the small one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
import pecs
from pecs._errors import PecsInputError

from ..scene import cycles
from ..scene.source import Source
from ..spectral.bands import BandSet, points
from ..spectral.palette import choose
from ..spectral.spectra import illuminance_lux
from ..spectral.spectral_scene import SpectralScene
from . import lens
from .plan import Plan, View, lower_threshold

WIDTH, SAMPLES = 32, 16
METER_NM = np.array([430.0, 480.0, 530.0, 580.0, 630.0, 680.0])  # between them light per emitter is smooth
DIFFUSE = 1e-3  # of a colour: below it a surface is no light meter
EVENT_WIDTH, EVENT_LOOKS, EVENT_S = 96, 12, 0.1  # pixels; pictures over so much of the range, at most
MEDIAN_OF_NORMAL = 0.6745  # of its absolute value, in standard deviations
PERCENT = {"p5": 5, "median": 50, "p95": 95}


def probe(source: Source, plan: Plan) -> dict[str, Any]:
    """lux (None if no surface in view scatters light), luminance_cd_m2, photocurrent_a and corner_hz (None without an
    f-number; no corner of a chip that follows at once), each {p5, median, p95} over the pixels; `light_scale`, at which
    they were measured; `fnumber`; `noise_thresholds` of the light with `samples`; `events_per_s` over the first
    `events_over_s` (None of a single instant)."""
    chip, own = plan.bands.chip, plan.sampling
    cycles.device_names(own.device)
    sampling = replace(own, samples=SAMPLES, denoise=False, light_tree=False, noise_events=None)
    cycles.configure(source.scene, *_size(source), sampling)
    spectral = SpectralScene(plan.bands.illuminant, source.folder, source.unit_m)
    if plan.view.path:
        source.follow(plan.view.path)
    source.set_time(0.0)
    source.make_camera(plan.view.focal_mm, plan.view.film_width_mm)
    wanted_lux = plan.bands.lux
    factor = light_scale(source, spectral, wanted_lux) if wanted_lux else plan.bands.light_scale
    scale = source.radiance_per_unit(spectral) * factor
    lux, luminance = _photometry(source.scene, spectral)
    measured = {"lux": _spread(lux * scale), "luminance_cd_m2": _spread(luminance * scale)}

    chosen = choose(replace(plan.bands, count=3), spectral)
    amperes, fnumber = _amperes(source, plan.view, chip, chosen.entries)
    current = rate = noise = None
    times_ns = plan.instants.grid.times_ns
    over_s = min(EVENT_S, (times_ns[-1] - times_ns[0]) * 1e-9)
    all_samples = own.samples * plan.view.subpixels**2
    if amperes is not None:
        weights = amperes * spectral.emitters.norm(chosen.bands) * scale

        def look() -> np.ndarray:
            return _current(source.scene, spectral, chosen.bands, weights)

        current = look()
        # Measured with the render's samples up to SAMPLES: at few samples, noise exceeds 1 / sqrt(samples).
        samples, pair = min(SAMPLES, all_samples), []
        for seed in (own.seed, own.seed + 1):
            with cycles.picture_size(source.scene, *_size(source), samples=samples, seed=seed):
                pair.append(look())
        noise = _noise(*pair)
        rate = _event_rate(source, plan, over_s, look, spectral) if over_s > 0 else None
    measured["photocurrent_a"] = _spread(current)
    corner = None
    if current is not None and chip.corner_hz_per_a:
        corner = chip.corner_hz_per_a * (current + chip.dark_current_a)
    measured |= {"corner_hz": _spread(corner), "events_per_s": rate, "events_over_s": over_s}
    if noise is not None:
        noise = float(f"{noise * math.sqrt(samples / all_samples) / lower_threshold(chip):.3g}")
    measured |= {"noise_thresholds": noise, "samples": all_samples}
    return measured | {"fnumber": fnumber, "light_scale": factor}


def light_scale(source: Source, spectral: SpectralScene, lux: float) -> float:
    """Factor on all light that gives the median surface in view `lux`. Restores all settings."""
    with cycles.picture_size(source.scene, *_size(source), samples=SAMPLES):
        lit = _photometry(source.scene, spectral)[0]
    if not len(lit) or not (median := float(np.median(lit))) > 0:
        raise PecsInputError(f"--lux: got {lux:g}, wanted surfaces in view that scatter light, and light")
    # Rounded, so that a job continued on another machine finds the same number.
    return float(f"{lux / (median * source.radiance_per_unit(spectral)):.4g}")


def _current(scene, spectral: SpectralScene, bands: BandSet, weights: np.ndarray) -> np.ndarray:
    """[height, width] photocurrent [A] of what is seen now; weights: A per rendered 1 in each band."""
    spectral.set_pass(bands)
    return np.tensordot(weights, cycles.Film(scene).render().astype(float), 1)


def _noise(one: np.ndarray, other: np.ndarray) -> float | None:
    """Standard deviation of ln(light) in the median pixel, from pictures of two seeds."""
    lit = (one > 0) & (other > 0)
    if not lit.any():
        return None
    return float(np.median(np.abs(np.log(one[lit] / other[lit])))) / (MEDIAN_OF_NORMAL * math.sqrt(2))


def _event_rate(
    source: Source, plan: Plan, over_s: float, look: Callable[[], np.ndarray], spectral: SpectralScene
) -> float:
    """Events per second of a picture of the plan's size, over the first seconds."""
    width, height = plan.view.pixels
    size = EVENT_WIDTH, max(cycles.LEAST_PX, round(EVENT_WIDTH * height / width))
    count = 0
    sensor = pecs.Sensor(*size, plan.bands.chip, noise=False, readout="ideal", photocurrent_a=1e-12)
    with cycles.picture_size(source.scene, *size), sensor:
        for t_s in plan.instants.grid.times_ns[0] * 1e-9 + np.linspace(0, over_s, EVENT_LOOKS):
            spectral.before_instant()
            source.set_time(t_s)
            spectral.after_instant()
            count += len(sensor.push(look() * 1e12, t_s * 1e6))
        count += len(sensor.finish())
    return float(f"{count / over_s * width * height / (size[0] * size[1]):.3g}")


def _size(source: Source) -> tuple[int, int]:
    width, height = source.size
    return WIDTH, max(cycles.LEAST_PX, round(WIDTH * height / width))


def _photometry(scene: bpy.types.Scene, spectral: SpectralScene) -> tuple[np.ndarray, np.ndarray]:
    """Per light scale: illuminance [lux] of the pixels that scatter light, and luminance [cd/m^2] of all."""
    norm = spectral.emitters.norm
    weights = [
        illuminance_lux(cycles.interpolated(METER_NM, one), lambda nm: norm(points(nm)))
        for one in np.eye(len(METER_NM))
    ]
    names = "Combined", "Diffuse Direct", "Diffuse Indirect", "Diffuse Color"
    layer = scene.view_layers[0]
    wanted = dict.fromkeys(("use_pass_diffuse_direct", "use_pass_diffuse_indirect", "use_pass_diffuse_color"), True)
    luminance = white = colour = 0.0
    with cycles.changed(((layer, wanted),)):
        for k in range(0, len(METER_NM), 3):
            spectral.set_pass(points(METER_NM[k : k + 3]))
            seen, direct, indirect, reflects = cycles.Film(scene).passes(*names).values()
            luminance = luminance + np.tensordot(weights[k : k + 3], seen[:3].astype(float), 1)
            white = white + np.tensordot(weights[k : k + 3], direct.astype(float) + indirect, 1)
            colour = colour + reflects.sum(axis=0)
    return math.pi * white[colour > DIFFUSE], luminance


def _amperes(source: Source, view: View, chip: pecs.Chip, bands: list[dict]) -> tuple:
    """Photocurrent [A] per spectral radiance in each band, and the f-number."""
    if chosen := lens.choose(source, view):
        info = chosen.lens.info(**chosen.setting, **chosen.frame, field_rows=2)
        return info["e0_sr"] * np.array(chip.amperes_per_unit(bands)), info["fnumber"]
    fnumber = view.fnumber or source.fnumber
    if not fnumber:
        return None, None
    return np.array(chip.amperes_per_unit(bands, "radiance", fnumber=fnumber)), fnumber


def _spread(values: np.ndarray | None) -> dict[str, float] | None:
    if values is None or not values.size:
        return None
    return {name: float(f"{np.percentile(values, p):.4g}") for name, p in PERCENT.items()}
