# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of a render: its options, with the defaults that depend on scene and chip filled in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pecs
from pecs._arguments import flag
from pecs._errors import UsageError

from ..camera.plan import Plan, View, lower_threshold
from ..camera.tiles import Box
from ..scene.camera_path import read_camera_path
from ..scene.cycles import LEAST_PX, Sampling
from ..scene.open import open_scene
from ..scene.source import Source
from ..scene.timeline import Instants, timeline
from ..spectral.bands import TOLERANCE, Bands
from ..spectral.spectra import spectrum
from .options import CYCLES_ONLY, DEFAULTS, LENS_ONLY, MOST_PX, Options

TIME_TOLERANCE = 0.5  # of ln(photocurrent) between keyframes, in contrast thresholds


def opened(scene: Path, options: Options, **how: Any) -> tuple[Source, Plan]:
    """A scene and the plan of its render. how: arguments of open_scene."""
    if options.lux and scene.suffix != ".blend":
        raise UsageError("--lux requires a .blend; a scene folder has --set illuminance_lux=…")
    source = open_scene(scene, options.illuminant, **how)
    return source, resolve(options, source)


def resolve(options: Options, source: Source) -> Plan:
    """Fills in the defaults that depend on the scene, on the chip and on other options. Throws PecsError for options
    that exclude each other."""
    _check(options)
    chip = pecs.Chip(options.chip)
    view = _view(options, source, chip)
    bands = _bands(options, source, chip)
    instants = Instants(
        grid=timeline(options.frames, options.fps, source.period_s, source.duration_s),
        only=options.only,
        step_px=options.step_px if options.is_adaptive else None,
        tolerance=TIME_TOLERANCE * lower_threshold(chip),
    )
    source.check_times(instants.grid.times_ns)
    if view.path:
        view.path.check(instants.grid)
    recorded = options.recorded() | {"film_width_mm": view.film_width_mm, "subpixels": view.subpixels}
    if not _has_pinhole(options, source):
        del recorded["focal_mm"]
    needs_motion = options.is_adaptive and "motion" not in options.layers
    return Plan(
        view=view,
        bands=bands,
        sampling=_sampling(options, source, view.subpixels),
        instants=instants,
        light=not options.no_light,
        layers=(*options.layers, "motion") if needs_motion else options.layers,
        recorded=recorded,
        verbosity={"quiet": options.quiet, "verbose": options.verbose},
    )


def _view(options: Options, source: Source, chip: pecs.Chip) -> View:
    subpixels = options.subpixels or (2 if options.is_adaptive else 1)
    width, height = pixels = _pixels(source.size, options.width, options.height)
    if max(pixels) * subpixels > MOST_PX or min(pixels) < LEAST_PX:
        each = f" of {subpixels} x {subpixels} subpixels" if subpixels > 1 else ""
        raise UsageError(f"--width: got {width} x {height} pixels{each}, wanted {LEAST_PX} to {MOST_PX} each way")
    return View(
        pixels=pixels,
        subpixels=subpixels,
        film_width_mm=options.film_width_mm or film_width_mm_of(chip, width),
        film_shift_mm=tuple(options.film_shift_mm),
        film_tilt_deg=tuple(options.film_tilt_deg),
        lens=options.lens,
        stop_diameter_mm=options.stop_diameter_mm,
        fnumber=options.fnumber,
        focus_m=options.focus_m,
        focus_bands_nm=options.focus_bands_nm,
        focal_mm=options.focal_mm,
        moving_px=_moving_px(options.moving_px, pixels, subpixels),
        path=read_camera_path(Path(options.camera_path)) if options.camera_path else None,
    )


def _has_pinhole(options: Options, source: Source) -> bool:
    """Whether the renderer makes a pinhole. Refuses options of a lens without one, and those of a pinhole."""
    through_lens = (options.lens or source.lens["lens"]) != "none"
    pinhole = not through_lens and source.own_camera is None
    for name in LENS_ONLY if not through_lens else ():
        if given(options, name):
            raise UsageError(f"{flag(name)} requires a --lens: the render has none")
    if not pinhole and given(options, "focal_mm"):
        raise UsageError("--focal requires a scene folder with --lens none: the render has no pinhole")
    return pinhole


def given(options: Options, name: str) -> bool:
    value = getattr(options, name)
    return (tuple(value) if isinstance(value, list) else value) != DEFAULTS[name]


def _bands(options: Options, source: Source, chip: pecs.Chip) -> Bands:
    return Bands(
        chip=chip,
        count=options.bands,
        placement=options.placement,
        per_pass=options.bands_per_pass,
        min_nm=options.min_nm,
        max_nm=options.max_nm,
        illuminant=spectrum(options.illuminant, source.folder),
        light_scale=options.light_scale,
        lux=options.lux,
        tolerance=TOLERANCE * lower_threshold(chip),
    )


def _sampling(options: Options, source: Source, subpixels: int) -> Sampling:
    denoise = options.is_adaptive and not options.no_denoise and options.engine == "cycles"
    least = 2 if denoise else 1
    return Sampling(
        samples=least * -(-options.samples_per_pixel // (least * subpixels**2)),
        seed=options.seed,
        bounces=source.bounces,
        threads=options.threads,
        device=options.device,
        denoise=denoise,
        light_tree=options.light_tree,
        noise_events=options.noise_events,
        engine=options.engine,
    )


def film_width_mm_of(chip: pecs.Chip, width: int) -> float:
    """Film width of the whole chip; that of `width` pixels if the profile has no size."""
    return round((chip.width or width) * chip.pixel_pitch_m * 1e3, 6)


def _check(options: Options) -> None:
    for name in CYCLES_ONLY if options.engine != "cycles" else ():
        if given(options, name):
            raise UsageError(f"{flag(name)} requires --engine cycles")
    if options.bands is None and options.placement != "means":
        raise UsageError(f"--placement {options.placement} requires a number of --bands")
    if options.lux and options.no_light:
        raise UsageError("--lux cannot be combined with --no-light")
    if options.lux and options.light_scale != 1:
        raise UsageError("--lux and --light-scale exclude each other")
    if options.no_light:
        if not options.layers:
            raise UsageError("--no-light requires --layers")
        if options.is_adaptive:
            raise UsageError("--time adaptive cannot be combined with --no-light")
    if options.noise_events and (not options.is_adaptive or options.no_denoise):
        raise UsageError("--noise-events requires --time adaptive without --no-denoise")
    if options.is_adaptive and options.moving_px:
        raise UsageError("--moving-px requires --time uniform; adaptive steps find what moves by themselves")


def _pixels(own: tuple[int, int], width: int | None, height: int | None) -> tuple[int, int]:
    """A width or a height alone keeps the scene's aspect ratio."""
    if width:
        return width, height or max(1, round(width * own[1] / own[0]))
    if height:
        return max(1, round(height * own[0] / own[1])), height
    return own


def _moving_px(box: Box | None, pixels: tuple[int, int], subpixels: int) -> Box | None:
    if not box:
        return None
    (left, top, right, bottom), (width, height) = box, pixels
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise UsageError(f"--moving-px: got {box}, wanted a part of {width} x {height} pixels")
    return tuple(n * subpixels for n in box)
