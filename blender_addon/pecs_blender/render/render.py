# SPDX-License-Identifier: GPL-3.0-or-later
"""One render job: a scene, a lens, bands and instants in; an EXR stack (docs/reference/exr_stack.md) out."""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import bpy  # before pecs: both carry libtbb.so.12
import numpy as np
import pecs
from pecs._progress import Progress

from . import adaptive, cycles, layers, lens, noise, stop
from .camera_path import read_camera_path
from .chip import Chip, load_chip
from .errors import USAGE, RenderError
from .job import Job
from .judge import Judge
from .options import Options
from .output import Output
from .plan import Timeline, passes, timeline
from .probe import light_scale
from .resources import BYTES_PER_VALUE, Restart, check_disk, peak_mb, readable, resident_mb
from .source import Source
from .spectra import spectrum
from .spectral import SpectralScene
from .surfaces import Look


def render(source: Source, folder: Path, options: Options, exists: str = "continue", plan_only: bool = False) -> Path:
    """The stack's folder: `folder`, or beside it (see Output). plan_only: prints what would be rendered, how long that
    takes here and how much it writes."""
    options = _resolved(options)
    if options.camera_path:
        source.follow(read_camera_path(Path(options.camera_path)))
    pixels = _size(source, options)
    width, height = size = tuple(n * options.subpixels for n in pixels)
    chip = load_chip(options.chip)
    options = replace(options, film_width_mm=options.film_width_mm or chip.film_width_mm(pixels[0]))
    _check_moving(options, *pixels)
    illuminant = spectrum(options.illuminant, source.folder)
    devices = cycles.device_names(options.device)
    rays = -(-options.samples // options.subpixels**2)
    sampling = cycles.Sampling(
        rays, options.seed, source.bounces, options.threads, options.device, options.denoise, options.light_tree
    )
    cycles.configure(source.scene, width, height, sampling)
    spectral = SpectralScene(illuminant, source.folder, source.unit_m)
    lamps = spectral.emitters.mean_pairs()
    bands = pecs.bands(options.chip, options.bands, options.placement, lamps, options.min_nm, options.max_nm)
    channels = sum(len(layers.KINDS[name].channels) for name in options.layers)
    channels += 0 if options.no_light else len(bands)
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        stop.remove_at_exit(Path(scratch))
        grid = timeline(options.frames, options.fps, source.period_s, source.duration_s)
        if source.path:
            source.path.check(grid)
        source.set_time(0.0)
        if options.lux:
            options = replace(options, light_scale=light_scale(source, spectral, options.lux))
        scale = 1.0 if options.no_light else source.radiance_per_unit(spectral) * options.light_scale
        job, record = _job(source, spectral, options, bands, size, scale, Path(scratch))
        if options.noise_target:
            samples = noise.samples(job, sampling, chip.weights(bands), _wanted(options, chip))
            sampling = replace(sampling, samples=samples)
        keys = adaptive.plan(job, grid, options.step_px, Path(scratch)) if options.is_adaptive else None
        plan = keys.timeline if keys else grid
        values = len(plan.times_ns[options.only or slice(None)]) * channels * width * height
        if not plan_only:
            check_disk(folder, values)
        light = [] if options.no_light or plan_only else [layers.Light(job, sampling)]
        look = Look(job, Path(scratch), [t * 1e-9 for t in plan.times_ns])
        beside = [layers.KINDS[name](look) for name in options.layers]
        if plan_only:
            each_s = _layers_s(job, plan, beside) if options.no_light else _light_s(job, plan)
            pictures = 2 * options.share + 8 if keys else 4  # that are held at a time
            memory_mb = peak_mb() + pictures * channels * width * height * BYTES_PER_VALUE * 1e-6
            words = f"{_estimate(plan, grid, each_s, values)}, about {readable(memory_mb * 1e6)} of memory"
            print(f"render: {words}", file=sys.stderr)
            return folder
        settings = _settings(options, source, scale, spectral)
        settings |= {"samples": sampling.samples * options.subpixels**2, "device": ", ".join(devices)}
        stack = _stack(source, plan, bands, pixels, options, record, settings)
        if beside:
            stack["layers"] = [layers.entry(layer) for layer in beside]
        with Output(folder, stack, options.only, exists) as output:
            if keys:
                tolerance = options.time_tolerance * chip.contrast_threshold
                judge = Judge(chip.weights(bands), tolerance, options.subpixels)
                adaptive.Adaptive(job, keys, *light, beside, judge, options).render(output)
            else:
                _render_frames(job, plan, [*beside, *light], output, options)
            return output.folder


def _layers_s(job: Job, plan: Timeline, made: list[layers.Layer]) -> float:
    """How long the first instant takes, once scene and shaders are built."""
    for _ in range(2):
        start = time.perf_counter()
        job.set_time(plan.times_ns[0] * 1e-9)
        for layer in _due(made, plan, 0):
            layer.render(*_times_s(layer, plan, 0))
    return time.perf_counter() - start


def _light_s(job: Job, plan: Timeline) -> float:
    """How long an instant takes, from a strip of a sixteenth of the picture in the first pass."""
    scene, film, (width, height) = job.source.scene, cycles.Film(job.source.scene), job.size
    job.set_time(plan.times_ns[0] * 1e-9)
    scene.camera = job.passes[0].camera
    scene.cycles.samples *= job.rays_per_sample
    job.spectral.set_pass(job.passes[0].rgb_nm)
    strip = 0, height * 15 // 32, width, max(height * 15 // 32 + 1, height * 17 // 32)
    cycles.set_border(scene, strip)
    film.render()  # scene and shaders are built
    start = time.perf_counter()
    film.render()
    return (time.perf_counter() - start) * height / (strip[3] - strip[1]) * len(job.passes)


def _estimate(plan: Timeline, grid: Timeline, each_s: float, values: int) -> str:
    count, all_of = len(plan.times_ns), len(grid.times_ns)
    what = f"{count} keyframes of {all_of} instants" if count < all_of else f"{count} instants"
    beside = ", and what lies between; what stands still costs nothing" if count < all_of else ""
    room = readable(values * BYTES_PER_VALUE)
    return f"{what}, {_duration(each_s)} each: {_duration(count * each_s)}{beside}; up to {room} on the disk"


def _duration(seconds: float) -> str:
    """In the unit that one reads best."""
    unit, factor = next(((u, f) for u, f in (("h", 3600), ("min", 60)) if seconds >= 2 * f), ("s", 1))
    value = seconds / factor
    return f"{value:.2g} {unit}" if value < 10 else f"{value:.0f} {unit}"


def _resolved(options: Options) -> Options:
    """What an option's default depends on."""
    if options.lux and (options.light_scale != 1 or options.no_light):
        given = "--no-light" if options.no_light else "--light-scale as well"
        raise RenderError(USAGE, f"--lux: got {given}, wanted light that it sets")
    if options.no_light:
        if not options.layers:
            raise RenderError(USAGE, "--no-light: got no --layers, wanted some, or light")
        for name, given in (("--time adaptive", options.is_adaptive), ("--noise-target", options.noise_target)):
            if given:
                raise RenderError(USAGE, f"{name}: got --no-light, wanted light")
    if not options.is_adaptive:
        return replace(options, subpixels=options.subpixels or 1)
    if options.moving_px:
        raise RenderError(USAGE, "--moving-px: got --time adaptive, wanted uniform: what stands still is found")
    with_motion = options.layers if "motion" in options.layers else (*options.layers, "motion")
    return replace(options, subpixels=options.subpixels or 2, layers=with_motion)


def _check_moving(options: Options, width: int, height: int) -> None:
    if moving := options.moving_px:
        if not (0 <= moving[0] < moving[2] <= width and 0 <= moving[1] < moving[3] <= height):
            raise RenderError(USAGE, f"--moving-px: got {moving}, wanted a part of {width} x {height} pixels")


def _job(source, spectral, options, bands, size, scale, scratch) -> tuple[Job, dict | None]:
    """The job, and what stack.json says of its lens."""
    lambda_nm = np.array([b["lambda_nm"] for b in bands])
    slices = passes(len(bands), options.bands_per_pass)
    unit = spectral.emitters.norm(lambda_nm) * scale
    moving_px = options.moving_px and tuple(n * options.subpixels for n in options.moving_px)
    common = {"moving_px": moving_px, "subpixels": options.subpixels}
    if chosen := lens.choose(source, options, *size):
        tolerance_px = options.colour_tolerance_px * options.subpixels
        made = lens.cameras(chosen, lambda_nm, slices, tolerance_px, source.unit_m, scratch)
        made.record["colour_shift_px"] /= options.subpixels
        common["rays_per_sample"] = made.rays_per_sample
        job = Job(source, spectral, size, lambda_nm, chosen, made.passes, unit * made.e0, **common)
        return job, made.record
    camera = source.camera(options.focal_mm, options.film_width_mm)
    through = tuple(lens.Pass(one, lens.rgb_nm(lambda_nm[one]), camera) for one in slices)
    return Job(source, spectral, size, lambda_nm, None, through, unit, **common), None


def _due(made: list[layers.Layer], plan: Timeline, index: int) -> list[layers.Layer]:
    """Of an instant, in their order: those of the interval that begins there move the scene on."""
    due = [layer for layer in made if layer.at == "instant" or index < len(plan.ends_ns)]
    return sorted(due, key=lambda layer: layer.at == "interval")


def _times_s(layer: layers.Layer, plan: Timeline, index: int) -> list[float]:
    bounds_s = [t * 1e-9 for t in plan.bounds_ns[index : index + 2]]
    return bounds_s[:1] if layer.at == "instant" else bounds_s


def _render_frames(job: Job, plan: Timeline, made: list[layers.Layer], output: Output, options: Options) -> None:
    """An instant is done when all its layers are there, and those of the interval that begins there."""
    wanted = range(len(plan.times_ns))[options.only or slice(None)]
    due = ((i, _due(made, plan, i)) for i in wanted)
    missing = [(i, todo) for i, of in due if (todo := [m for m in of if not output.has_layer(m.name, i)])]
    quiet, verbose = options.quiet, options.verbose
    progress = Progress("render", len(wanted), len(wanted) - len(missing), quiet=quiet, verbose=verbose)
    first_mb = None
    for done, (index, todo) in enumerate(missing, len(wanted) - len(missing) + 1):
        job.set_time(plan.times_ns[index] * 1e-9)
        for layer in todo:
            layers.write(layer, output, index, *_times_s(layer, plan, index))
        progress.at(done)
        stop.check()
        first_mb = first_mb or resident_mb()
        if resident_mb() > first_mb + options.restart_growth_mb and done < len(wanted):
            raise Restart


def _size(source: Source, options: Options) -> tuple[int, int]:
    """Pixels; a width alone keeps the scene's shape."""
    width, height = source.size
    if options.width:
        width, height = options.width, options.height or max(1, round(options.width * height / width))
    elif options.height:
        width, height = max(1, round(options.height * width / height)), options.height
    return width, height


def _wanted(options: Options, chip: Chip) -> float:
    """Variance of a subpixel's ln(light)."""
    return (options.noise_target * chip.contrast_threshold * options.subpixels) ** 2


def _stack(source, plan, bands, size, options, record, settings) -> dict:
    """stack.json."""
    fnumber = options.fnumber or source.fnumber
    return {
        "pecs_stack": 1,
        "quantity": "irradiance" if record else "radiance",
        "width": size[0],
        "height": size[1],
        "pixel_pitch_m": options.film_width_mm * 1e-3 / size[0],
        **({} if record or not fnumber else {"fnumber": fnumber}),
        **({"subpixels": options.subpixels} if options.subpixels > 1 else {}),
        **({"between": True} if options.is_adaptive else {}),
        **({"light": False} if options.no_light else {}),
        "bands": bands,
        "times_ns": plan.times_ns,
        "period_ns": plan.period_ns,
        "lens": record,
        "scene": source.record,
        "render": settings,
        "versions": {"pecs": pecs.__version__, "blender": bpy.app.version_string},
    }


def _settings(options: Options, source: Source, scale: float, spectral: SpectralScene) -> dict:
    """What decides the picture."""
    return {
        **options.recorded(),
        **({"lux": options.lux} if options.lux else {}),
        **({"camera_path_sha256": source.path.sha256} if source.path else {}),
        **({"placed": source.placed.record} if source.placed else {}),
        "emitters": [s.name for s in spectral.emitters.spectra],
        "radiance_per_relative_power": None if options.no_light else scale,
        "approximated": spectral.approximated,
        "cycles": cycles.SETTINGS | source.bounces,
    }
