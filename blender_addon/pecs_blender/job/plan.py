# SPDX-License-Identifier: GPL-3.0-or-later
"""A render's options, resolved once: each stage takes its part of the plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pecs
from pecs._errors import UsageError

from ..scene.camera_path import CameraPath, read_camera_path
from ..scene.timeline import Timeline, timeline
from ..spectral.bands import TOLERANCE
from ..spectral.spectra import Spectrum, spectrum
from .options import Options

if TYPE_CHECKING:
    from ..scene.source import Source

TIME_TOLERANCE = 0.5  # of ln(photocurrent) between keyframes, in contrast thresholds

Box = tuple[int, int, int, int]  # left, top, right, bottom


@dataclass(frozen=True)
class View:
    """The picture and its camera. None: the scene's own value."""

    pixels: tuple[int, int]  # of the sensor: width, height
    subpixels: int  # rendered pixels per sensor pixel, in x and in y
    film_width_mm: float
    film_shift_mm: tuple[float, float]
    film_tilt_deg: tuple[float, float]
    lens: str | None
    stop_diameter_mm: float | None
    fnumber: float | None
    focus_m: float | None
    focus_bands_nm: tuple[float, ...]  # empty: all bands
    focal_mm: float  # of a scene folder's pinhole
    colour_tolerance_px: float  # rendered pixels
    moving_px: Box | None  # rendered pixels; None: everything may move
    path: CameraPath | None

    @property
    def size(self) -> tuple[int, int]:
        """Rendered pixels: width, height."""
        return self.pixels[0] * self.subpixels, self.pixels[1] * self.subpixels


@dataclass(frozen=True)
class Bands:
    """The light and the wavelengths at which it is rendered."""

    chip: pecs.Chip
    count: int | None  # None: as many as the scene's colours and lamps require
    placement: str
    per_pass: int
    min_nm: float | None
    max_nm: float | None
    illuminant: Spectrum  # of emitters that name no spectrum
    light_scale: float
    lux: float | None  # replaces light_scale
    tolerance: float  # RMS error of ln(photocurrent), for count None


@dataclass(frozen=True)
class Sampling:
    """How Cycles samples. samples: per rendered pixel. bounces: Cycles settings. threads 0: all cores. denoise: whether
    the light is denoised (denoise.py), with adaptive steps only: the remaining noise flickers from frame to frame. The
    number of samples is even then, so that they can be halved."""

    samples: int
    seed: int
    bounces: dict[str, Any]
    threads: int = 0
    device: str = "CPU"
    denoise: bool = False
    light_tree: bool = False
    noise_events: float | None = None  # highest share of events that come from noise; replaces samples


@dataclass(frozen=True)
class Instants:
    """grid: the finest instants. only: the part of the stack's instants to render. step_px: longest motion [sensor
    pixels] between keyframes; None renders every instant. tolerance: of ln(photocurrent) between keyframes."""

    grid: Timeline
    only: slice | None
    step_px: float | None
    tolerance: float


@dataclass(frozen=True)
class Plan:
    """layers: names of the layers besides the light. recorded: options for stack.json. verbosity: for Progress."""

    view: View
    bands: Bands
    sampling: Sampling
    instants: Instants
    light: bool
    layers: tuple[str, ...]
    recorded: dict[str, Any]
    verbosity: dict[str, bool]


def resolve(options: Options, source: Source) -> Plan:
    """Fills in the defaults that depend on the scene, on the chip and on other options. Throws PecsError for options
    that exclude each other."""
    _check(options)
    chip = pecs.Chip(options.chip)
    threshold = lower_threshold(chip)
    subpixels = options.subpixels or (2 if options.is_adaptive else 1)
    pixels = _pixels(source.size, options.width, options.height)
    film_width_mm = options.film_width_mm or film_width_mm_of(chip, pixels[0])
    view = View(
        pixels,
        subpixels,
        film_width_mm,
        tuple(options.film_shift_mm),
        tuple(options.film_tilt_deg),
        options.lens,
        options.stop_diameter_mm,
        options.fnumber,
        options.focus_m,
        options.focus_bands_nm,
        options.focal_mm,
        options.colour_tolerance_px * subpixels,
        _moving_px(options.moving_px, pixels, subpixels),
        read_camera_path(Path(options.camera_path)) if options.camera_path else None,
    )
    bands = Bands(
        chip,
        options.bands,
        options.placement,
        options.bands_per_pass,
        options.min_nm,
        options.max_nm,
        spectrum(options.illuminant, source.folder),
        options.light_scale,
        options.lux,
        TOLERANCE * threshold,
    )
    denoise = options.is_adaptive and not options.no_denoise
    least = 2 if denoise else 1
    sampling = Sampling(
        least * -(-options.samples_per_pixel // (least * subpixels**2)),
        options.seed,
        source.bounces,
        options.threads,
        options.device,
        denoise,
        options.light_tree,
        options.noise_events,
    )
    instants = Instants(
        timeline(options.frames, options.fps, source.period_s, source.duration_s),
        options.only,
        options.step_px if options.is_adaptive else None,
        TIME_TOLERANCE * threshold,
    )
    if view.path:
        view.path.check(instants.grid)
    needs_motion = options.is_adaptive and "motion" not in options.layers
    layers = (*options.layers, "motion") if needs_motion else options.layers
    recorded = options.recorded() | {"film_width_mm": film_width_mm, "subpixels": subpixels}
    verbosity = {"quiet": options.quiet, "verbose": options.verbose}
    return Plan(view, bands, sampling, instants, not options.no_light, layers, recorded, verbosity)


def lower_threshold(chip: pecs.Chip) -> float:
    """The lower of the ON and OFF contrast thresholds, natural log."""
    return min(chip.contrast_threshold_on, chip.contrast_threshold_off)


def film_width_mm_of(chip: pecs.Chip, width: int) -> float:
    """Of the whole chip; of `width` pixels if the profile has no size."""
    return round((chip.width or width) * chip.pixel_pitch_m * 1e3, 6)


def _check(options: Options) -> None:
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
