# SPDX-License-Identifier: GPL-3.0-or-later
"""Time, disk space and memory of a render, from renders of a few frames or of a part of one."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pecs
from numpy.typing import NDArray
from pecs._platform import resident_mb
from pecs._progress import report
from pecs.motion import CHANNELS

from ..adaptive.frames import SHARED
from ..truth import layer_class
from ..truth.motion import STILL_PX
from ..truth.surfaces import HitCache
from . import noise
from .resources import readable
from .stack import Render, due, times_s

UNIFORM_PICTURES, ADAPTIVE_PICTURES = 4, 2 * SHARED + 8  # held in memory at a time


def print_cost(job: Render, start_s: float) -> None:
    """start_s: what was taken before the first frame, which a render takes once."""
    stage, keyframes, start_cpu_s = job.stage, job.keyframes, time.process_time()
    needed_bytes, count = job.needed_bytes(), len(job.instants.times_ns)
    held = ADAPTIVE_PICTURES if keyframes else UNIFORM_PICTURES
    memory_bytes = resident_mb(peak=True) * 1e6 + held * needed_bytes / max(1, len(job.wanted))
    seen: dict[str, float] = {}
    if keyframes:
        each, each_bytes, seen = _keyframe_cost(job)
        disk_bytes, about = each_bytes * len(job.wanted), "about"
    else:
        each, disk_bytes, about = _light_s(job) if job.plan.light else _layers_s(job), needed_bytes, "up to"
    each_s, cpu_s = each[0], start_cpu_s + count * each[1]
    if job.plan.light:
        stage.print_choices()
    of = len(job.plan.instants.grid.times_ns)
    frames = f"{count} keyframes of {of} instants" if count < of else f"{count} instants"
    between = " with the frames after it" if keyframes else ""
    text = (
        f"render: {frames}, {_duration(each_s)} each{between}: {_duration(count * each_s)}, and "
        f"{_duration(cpu_s)} of CPU time with the start; {about} {readable(disk_bytes)} on the disk, about "
        f"{readable(memory_bytes)} of memory"
    )
    if seen:
        events, share = seen["events"] + seen["own_events"], seen.get("render_noise")
        by_noise = "" if share is None else f", {100 * share:.0f} % of them by the renderer's noise"
        text += (
            f"; about {events:.2g} events of {job.plan.bands.chip.name}{by_noise}, median {seen['px_per_s']:.2g} px/s"
        )
    cost = {"frames": count, "of": of, "start_s": start_s, "each_s": each_s, "cpu_s": cpu_s}
    report(text, plan=cost | {"disk_bytes": disk_bytes, "memory_bytes": memory_bytes} | seen)


def _now_s() -> NDArray[np.float64]:
    """Time, and CPU time of all threads."""
    return np.array([time.perf_counter(), time.process_time()])


def _keyframe_cost(job: Render) -> tuple[NDArray[np.float64], int, dict[str, float]]:
    """Seconds, as `_now_s`, and bytes of a keyframe and its share of the intervals, measured on two whole
    keyframes, with about as many partial ones between them as on average; and `_seen`."""
    keyframes = job.keyframes
    with job.pilot(2, job.sampling, job.plan.layers) as (pilot, folder):
        with pilot.opened(folder) as frames:
            start, last = _now_s(), len(pilot.wanted) - 1
            frames.keyframe(0)  # renders both, and averages them
            render_s = _now_s() - start
            frames.keyframe(last)  # averages them, as each keyframe with its neighbours
            share_s = _now_s() - start - render_s
            for index in range(max(1, last)):
                frames.write(index)
            intervals_s = _now_s() - start - render_s - share_s
            size = {file.name: file.stat().st_size for file in folder.glob("*.exr")}
            if last:
                frames.write(last)
        seen = _seen(job, pilot, folder) if last and job.plan.light else {}
        whole = len(keyframes.whole)
        intervals = whole - (len(keyframes.ends) < len(keyframes.keys))  # of whole keyframes
        neighbours = min(whole - 1, 2 * SHARED)
        whole_s = (render_s - share_s) / min(2, whole) + neighbours * share_s
        of_frame = sum(n for name, n in size.items() if name.startswith("frame_000000"))
        every_s = whole * whole_s + intervals * intervals_s
        every_bytes = intervals * sum(size.values()) + (whole - intervals) * of_frame
        return every_s / len(keyframes.keys), round(every_bytes / len(keyframes.keys)), seen


def _seen(job: Render, pilot: Render, folder: Path) -> dict[str, float]:
    """Events of the light, and those by the chip's noise; the share that the renderer's noise moves, if the stack has
    it; and the median speed of the picture: of a pilot's time, as if the whole render differed from it in speed alone,
    to which events of the light are proportional.

    A pixel's first event needs half a threshold more than the others, as its light starts at rest, whatever the
    threshold. With half the thresholds there are twice as many of the others, so that the difference counts these."""
    chip = job.plan.bands.chip
    values = {name: chip.info["values"][name] for name in ("contrast_threshold_on", "contrast_threshold_off")}
    half = {name: max(one["range"][0], one["value"] / 2) for name, one in values.items()}
    light, all_, finer = (
        noise.sensed(pilot, folder, **options)
        for options in ({"noise": False}, {}, {"noise": False, "overrides": half})
    )
    pilot_s, all_s = ((times[-1] - times[0]) * 1e-9 for times in (pilot.instants.bounds_ns, job.instants.bounds_ns))
    pilot_px, all_px = (sum(one.keyframes.paths_px) for one in (pilot, job))
    moves = all_px / pilot_px if pilot_px > STILL_PX else all_s / pilot_s
    ends = [CHANNELS.index(name) for name in ("x_end", "y_end")]
    with pecs.StackReader(folder) as stack:
        paths = [np.hypot(*stack.read_layer("motion", i)[ends]) for i in pilot.wanted[:-1]]
    path_px = sum(float(np.nanmedian(path)) for path in paths) / job.plan.view.subpixels
    return {
        "events": max(0, finer["events"] - light["events"]) * moves,
        "own_events": max(0, all_["events"] - light["events"]) * all_s / pilot_s,
        "px_per_s": path_px * moves / all_s,
        **({"render_noise": all_["render_noise"]["share"] or 0.0} if "render_noise" in all_ else {}),
    }


def _layers_s(job: Render) -> NDArray[np.float64]:
    """Time, as `_now_s`, for the first instant, measured after scene and shaders are built."""
    hits = HitCache(job.stage, [t * 1e-9 for t in job.instants.times_ns])
    layers = due([layer_class(name)(hits) for name in job.plan.layers], job.instants, 0)
    for _ in range(2):
        start = _now_s()
        job.stage.set_time(job.instants.times_ns[0] * 1e-9)
        for layer in layers:
            layer.render(*times_s(layer, job.instants, 0))
    return _now_s() - start


def _light_s(job: Render) -> NDArray[np.float64]:
    """Time per instant, as `_now_s`, extrapolated from a strip of a sixteenth of the picture in the first pass."""
    stage, scene = job.stage, job.stage.source.scene
    film, (width, height) = stage.film(scene.cycles.samples), stage.size
    stage.set_time(job.instants.times_ns[0] * 1e-9)
    scene.camera = stage.camera_of(stage.passes[0])
    scene.cycles.samples *= stage.rays_per_sample
    stage.spectral.set_pass(stage.passes[0].channels)
    strip = 0, height * 15 // 32, width, max(height * 15 // 32 + 1, height * 17 // 32)
    times_s = []
    for _ in range(2):  # the first builds scene and shaders
        start = _now_s()
        list(film.parts([strip], "Combined"))
        times_s.append(_now_s() - start)
    parts = 1 if job.sampling.engine == "eevee" else height / (strip[3] - strip[1])  # it draws the whole picture
    return times_s[1] * parts * len(stage.passes)


def _duration(seconds: float) -> str:
    unit, factor = next(((u, f) for u, f in (("h", 3600), ("min", 60)) if seconds >= 2 * f), ("s", 1))
    value = seconds / factor
    return f"{value:.2g} {unit}" if value < 10 else f"{value:.0f} {unit}"
