# SPDX-License-Identifier: GPL-3.0-or-later
"""One render job: a scene and a plan in, an EXR stack (docs/reference/exr_stack.md) out."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import bpy
import pecs
from pecs._progress import Line, Progress, report

from .. import stop
from ..adaptive import adaptive
from ..camera.light import Light
from ..camera.plan import Plan
from ..camera.stage import Stage
from ..output import Layer, Output, free_folder, is_stack
from ..scene import cycles
from ..scene.cycles import Sampling
from ..scene.source import Source
from ..scene.timeline import Timeline
from ..truth import layer_class
from ..truth.surfaces import HitCache
from . import noise
from .resources import BYTES_PER_VALUE, MemoryGuard, check_disk, peak_mb, readable

UNIFORM_PICTURES, ADAPTIVE_PICTURES = 4, 2 * adaptive.SHARED + 8  # held in memory at a time


def render(source: Source, folder: Path, plan: Plan, exists: str = "continue", cost_only: bool = False) -> Path:
    """The stack's folder. exists: what to do if the folder contains another job's stack: "continue" (an error),
    "overwrite", or "new" (use the next free name). cost_only: prints the cost, and writes nothing."""
    job = Render(source, plan)
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        stop.remove_at_exit(Path(scratch))
        job.set_up(Path(scratch))
        if cost_only or not job.take_up(folder, exists):
            job.choose_instants()
            job.choose_samples()
        if cost_only:
            job.print_cost()
            return folder
        job.open(folder, exists)
        job.make_layers()
        job.write_frames()
        return job.folder


class Render:
    """The stages of a render, in the order in which render() calls them; each leaves its result in members."""

    def __init__(self, source: Source, plan: Plan):
        self._source, self._plan, self._sampling = source, plan, plan.sampling

    def set_up(self, scratch: Path) -> None:
        """Makes the scene spectral, measures its light, and builds a camera for each pass."""
        for note in self._source.notes if not self._plan.verbosity["quiet"] else ():
            print(f"render: {note}", file=sys.stderr)
        self._stage = Stage(self._source, self._plan, scratch)

    def take_up(self, folder: Path, exists: str) -> bool:
        """Takes keyframes and samples from the stack in the folder, if it is this job's. With "continue", from any one:
        Output refuses it if it differs."""
        try:
            stack = json.loads((folder / "stack.json").read_text())
            samples = stack["render"]["samples"] // self._plan.view.subpixels**2
            keyframes = adaptive.Keyframes.at(self._plan.instants.grid, stack["times_ns"])
        except (OSError, ValueError, KeyError, TypeError):  # not a stack of this job
            return False
        asked = self._sampling
        self._set_instants(keyframes if self._plan.instants.step_px else None)
        if asked.noise_events:
            self._sampling = replace(asked, samples=samples)
        if exists == "continue" or is_stack(folder, self._stack_json()):
            return True
        self._sampling = asked
        return False

    def choose_instants(self) -> None:
        """Keyframes for adaptive steps, or all instants."""
        asked, keyframes = self._plan.instants, None
        if asked.step_px:
            motion = Line(task="motion", **self._plan.verbosity)
            keyframes = adaptive.choose_keyframes(self._stage, asked, motion)
        self._set_instants(keyframes)

    def _set_instants(self, keyframes: adaptive.Keyframes | None) -> None:
        """`_wanted` are those that this process renders."""
        asked, self._keyframes = self._plan.instants, keyframes
        self._instants = keyframes.timeline if keyframes else asked.grid
        self._wanted = range(len(self._instants.times_ns))[asked.only or slice(None)]

    def choose_samples(self) -> None:
        """Chooses samples for the wanted share of noise events, from a pilot stack of some keyframes."""
        share = self._sampling.noise_events
        if not share:
            return
        stage, plan = self._stage, self._plan
        middle, sampling = self._keyframes.middle(noise.PILOT_KEYFRAMES), noise.pilot_sampling(self._sampling)
        with self._pilot(middle, sampling, ("motion",)) as pilot:
            pilot.write_frames()
            has_none = not stage.lens_record and not pilot._stack.get("fnumber")
            fnumber = noise.FNUMBER if has_none else None
            samples = noise.samples_for(share, pilot.folder, plan.bands.chip, fnumber)
        if not plan.verbosity["quiet"]:
            of_pixel = samples * plan.view.subpixels**2
            print(f"render: {of_pixel} samples per pixel for {share:.3g} noise events", file=sys.stderr)
        self._sampling = replace(self._sampling, samples=samples)

    @contextmanager
    def _pilot(self, keyframes: adaptive.Keyframes, sampling: Sampling, layers: tuple[str, ...]) -> Iterator[Render]:
        """This job at these keyframes, ready to write its frames to a folder that is removed."""
        plan = replace(self._plan, layers=layers, verbosity={"quiet": True, "verbose": False})
        pilot = Render(self._source, plan)
        pilot._stage, pilot._keyframes, pilot._instants = self._stage, keyframes, keyframes.timeline
        pilot._sampling, pilot._wanted = sampling, range(len(keyframes.keys))
        with tempfile.TemporaryDirectory(prefix="pecs_pilot_") as folder:
            stop.remove_at_exit(Path(folder))
            pilot.open(Path(folder) / "stack", "continue")
            pilot.make_layers()
            yield pilot

    def open(self, folder: Path, exists: str) -> None:
        """Chooses the stack's folder, and checks that the disk has room for the frames that are missing there."""
        self._stack = self._stack_json()
        self._overwrite = exists == "overwrite" and not is_stack(folder, self._stack)
        self.folder = free_folder(folder, self._stack) if exists == "new" else folder
        check_disk(self.folder, self._needed_bytes(lambda file: self._overwrite or not (self.folder / file).is_file()))

    def make_layers(self) -> None:
        self._light = Light(self._stage, self._sampling) if self._plan.light else None
        self._hits = HitCache(self._stage, [t * 1e-9 for t in self._instants.times_ns])
        self._layers = [layer_class(name)(self._hits) for name in self._plan.layers]

    def write_frames(self) -> None:
        with Output(self.folder, self._stack, self._plan.instants.only, self._overwrite) as output:
            if self._light and not self._plan.verbosity["quiet"]:
                self._stage.print_bands()
            if self._keyframes:
                frames: Frames = self._adaptive(output)
            else:
                layers = [*self._layers, *([self._light] if self._light else [])]
                frames = Uniform(self._stage, self._instants, layers, output)
            _write_missing(frames, self._wanted, self._plan.verbosity)
            for layer in self._layers:
                layer.finish(output)

    def _adaptive(self, output: Output) -> adaptive.Adaptive:
        tolerance = self._plan.instants.tolerance
        return adaptive.Adaptive(self._stage, self._keyframes, self._light, self._layers, self._hits, tolerance, output)

    def print_cost(self) -> None:
        needed_bytes, count = self._needed_bytes(lambda file: True), len(self._instants.times_ns)
        held = ADAPTIVE_PICTURES if self._keyframes else UNIFORM_PICTURES
        memory_bytes = peak_mb() * 1e6 + held * needed_bytes / max(1, len(self._wanted))
        if self._keyframes:
            each_s, each_bytes = self._keyframe_cost()
            disk_bytes, about = each_bytes * len(self._wanted), "about"
        else:
            each_s, disk_bytes, about = self._light_s() if self._plan.light else self._layers_s(), needed_bytes, "up to"
        if self._plan.light:
            self._stage.print_bands()
        of = len(self._plan.instants.grid.times_ns)
        frames = f"{count} keyframes of {of} instants" if count < of else f"{count} instants"
        between = " with the frames after it" if self._keyframes else ""
        text = (
            f"render: {frames}, {_duration(each_s)} each{between}: {_duration(count * each_s)}; {about} "
            f"{readable(disk_bytes)} on the disk, about {readable(memory_bytes)} of memory"
        )
        cost = {"frames": count, "of": of, "each_s": each_s, "disk_bytes": disk_bytes, "memory_bytes": memory_bytes}
        report(text, plan=cost)

    def _keyframe_cost(self) -> tuple[float, int]:
        """Seconds and bytes of a keyframe and its share of the intervals, measured on two keyframes in the middle."""
        with (
            self._pilot(self._keyframes.middle(2), self._sampling, self._plan.layers) as pilot,
            Output(pilot.folder, pilot._stack, None, False) as output,
        ):
            frames = pilot._adaptive(output)
            start = time.perf_counter()
            frames.keyframe(0)  # renders both, and averages them
            render_s = time.perf_counter() - start
            frames.keyframe(len(pilot._wanted) - 1)  # averages them, as each keyframe with its neighbours
            share_s = time.perf_counter() - start - render_s
            frames.write(0)
            interval_s = time.perf_counter() - start - render_s - share_s
            size = {file.name: file.stat().st_size for file in pilot.folder.glob("*.exr")}
            intervals = len(self._keyframes.ends) / len(self._keyframes.keys)  # per keyframe
            of_interval = sum(n for name, n in size.items() if name.startswith(("motion_", "between_")))
            neighbours = min(len(self._keyframes.keys) - 1, 2 * adaptive.SHARED)
            each_s = (render_s - share_s) / len(pilot._wanted) + neighbours * share_s + intervals * interval_s
            return each_s, round(sum(size.values()) + (intervals - 1) * of_interval)

    def _needed_bytes(self, counts: Callable[[str], bool]) -> int:
        """Upper bound of this process's frames, as far as `counts` says of their names."""
        channels = {"frame": len(self._stage.bands)} if self._plan.light else {}
        channels |= {name: len(layer_class(name).channels) for name in self._plan.layers}
        values = sum(n for name, n in channels.items() for i in self._wanted if counts(f"{name}_{i:06d}.exr"))
        return values * self._stage.size[0] * self._stage.size[1] * BYTES_PER_VALUE

    def _stack_json(self) -> dict[str, Any]:
        stage, view, plan = self._stage, self._plan.view, self._plan
        through_lens, fnumber = stage.lens_record is not None, view.fnumber or self._source.fnumber
        layers = [layer_class(name).entry() for name in plan.layers]
        return {
            "pecs_stack": 1,
            "quantity": "irradiance" if through_lens else "radiance",
            "width": view.pixels[0],
            "height": view.pixels[1],
            "pixel_pitch_m": view.film_width_mm * 1e-3 / view.pixels[0],
            **({} if through_lens or not fnumber else {"fnumber": fnumber}),
            **({"subpixels": view.subpixels} if view.subpixels > 1 else {}),
            **({"between": True} if self._keyframes else {}),
            **({"noise": True} if plan.light and self._sampling.denoise else {}),
            **({} if plan.light else {"light": False}),
            "bands": stage.bands,
            "times_ns": self._instants.times_ns,
            "period_ns": self._instants.period_ns,
            "lens": stage.lens_record,
            "scene": self._source.record,
            "render": {
                **plan.recorded,
                **stage.record(plan),
                "samples": self._sampling.samples * view.subpixels**2,
                **({"instants": len(self._keyframes.grid.times_ns)} if self._keyframes else {}),
            },
            "versions": {"pecs": pecs.__version__, "blender": bpy.app.version_string},
            **({"layers": layers} if layers else {}),
        }

    def _layers_s(self) -> float:
        """Time for the first instant, measured after scene and shaders are built."""
        self.make_layers()
        due = Uniform.due(self._layers, self._instants, 0)
        for _ in range(2):
            start = time.perf_counter()
            self._stage.set_time(self._instants.times_ns[0] * 1e-9)
            for layer in due:
                layer.render(*_times_s(layer, self._instants, 0))
        return time.perf_counter() - start

    def _light_s(self) -> float:
        """Time per instant, extrapolated from a strip of a sixteenth of the picture in the first pass."""
        stage, scene, film = self._stage, self._source.scene, cycles.Film(self._source.scene)
        width, height = stage.size
        stage.set_time(self._instants.times_ns[0] * 1e-9)
        scene.camera = stage.camera_of(stage.passes[0])
        scene.cycles.samples *= stage.rays_per_sample
        stage.spectral.set_pass(stage.passes[0].channels)
        strip = 0, height * 15 // 32, width, max(height * 15 // 32 + 1, height * 17 // 32)
        cycles.set_border(scene, strip)
        film.render()  # builds scene and shaders
        start = time.perf_counter()
        film.render()
        return (time.perf_counter() - start) * height / (strip[3] - strip[1]) * len(stage.passes)


class Frames(Protocol):
    warm_up: int  # frames until all caches are full

    def is_written(self, index: int) -> bool: ...

    def write(self, index: int) -> None: ...


class Uniform:
    """Renders every instant, and the interval after it."""

    warm_up = 0

    def __init__(self, stage: Stage, instants: Timeline, layers: list[Layer], output: Output):
        self._stage, self._instants, self._layers, self._output = stage, instants, layers, output

    def is_written(self, index: int) -> bool:
        return not self._missing(index)

    def write(self, index: int) -> None:
        self._stage.set_time(self._instants.times_ns[index] * 1e-9)
        for layer in self._missing(index):
            layer.write(self._output, index, *_times_s(layer, self._instants, index))

    def _missing(self, index: int) -> list[Layer]:
        due = self.due(self._layers, self._instants, index)
        return [layer for layer in due if not layer.is_written(self._output, index)]

    @staticmethod
    def due(layers: list[Layer], instants: Timeline, index: int) -> list[Layer]:
        """Layers of an instant, then those of the interval after it, which move the scene on."""
        due = [layer for layer in layers if layer.at == "instant" or index < len(instants.ends_ns)]
        return sorted(due, key=lambda layer: layer.at == "interval")


def _times_s(layer: Layer, instants: Timeline, index: int) -> list[float]:
    bounds_s = [t * 1e-9 for t in instants.bounds_ns[index : index + 2]]
    return bounds_s[:1] if layer.at == "instant" else bounds_s


def _write_missing(frames: Frames, wanted: range, verbosity: dict[str, bool]) -> None:
    missing = [i for i in wanted if not frames.is_written(i)]
    there = len(wanted) - len(missing)
    progress, memory = Progress("render", len(wanted), there, **verbosity), MemoryGuard(frames.warm_up)
    if wanted:
        Line(task="render", **verbosity)("", there, len(wanted))
    for done, index in enumerate(missing, there + 1):
        frames.write(index)
        progress.at(done)
        stop.check()
        if done < len(wanted):
            memory.check()


def _duration(seconds: float) -> str:
    unit, factor = next(((u, f) for u, f in (("h", 3600), ("min", 60)) if seconds >= 2 * f), ("s", 1))
    value = seconds / factor
    return f"{value:.2g} {unit}" if value < 10 else f"{value:.0f} {unit}"
