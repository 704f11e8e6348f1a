# SPDX-License-Identifier: GPL-3.0-or-later
"""A stack (docs/reference/exr_stack.md) of which the instants and the samples are chosen."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import bpy
import pecs
from pecs._progress import Line, Progress

from .. import stop
from ..adaptive.frames import Adaptive
from ..adaptive.keyframes import Keyframes
from ..camera.light import Light
from ..camera.plan import Plan
from ..camera.stage import Stage
from ..output import Layer, Output, free_folder, is_stack
from ..scene.cycles import Sampling
from ..scene.timeline import Timeline
from ..truth import layer_class
from ..truth.surfaces import HitCache
from .resources import BYTES_PER_VALUE, MemoryGuard, check_disk


class Frames(Protocol):
    """Writes the frames of a stack. warm_up: frames until all caches are full."""

    warm_up: int

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
            layer.write(self._output, index, *times_s(layer, self._instants, index))

    def _missing(self, index: int) -> list[Layer]:
        layers = due(self._layers, self._instants, index)
        return [layer for layer in layers if not layer.is_written(self._output, index)]


def due(layers: list[Layer], instants: Timeline, index: int) -> list[Layer]:
    """Layers of an instant, then those of the interval after it, which move the scene on."""
    here = [layer for layer in layers if layer.at == "instant" or index + 1 < len(instants.bounds_ns)]
    return sorted(here, key=lambda layer: layer.at == "interval")


def times_s(layer: Layer, instants: Timeline, index: int) -> list[float]:
    bounds_s = [t * 1e-9 for t in instants.bounds_ns[index : index + 2]]
    return bounds_s[:1] if layer.at == "instant" else bounds_s


class Render:
    """A stack to render. keyframes: of adaptive steps; None: all instants. wanted: the instants of this process. stack:
    content of stack.json."""

    def __init__(self, stage: Stage, plan: Plan, sampling: Sampling, keyframes: Keyframes | None = None):
        self.stage, self.plan, self.sampling, self.keyframes = stage, plan, sampling, keyframes
        self.instants = keyframes.timeline if keyframes else plan.instants.grid
        self.wanted = range(len(self.instants.times_ns))[plan.instants.only or slice(None)]
        self.stack = self._stack_json()

    def write(self, folder: Path, exists: str = "continue") -> Path:
        """Writes all frames that are missing in the stack's folder, which it chooses and returns."""
        overwrite = exists == "overwrite" and not is_stack(folder, self.stack)
        folder = free_folder(folder, self.stack) if exists == "new" else folder
        check_disk(folder, self.needed_bytes(lambda file: overwrite or not (folder / file).is_file()))
        with self.opened(folder, overwrite) as frames:
            if self.plan.light and not self.plan.verbosity["quiet"]:
                self.stage.print_choices()
            _write_missing(frames, self.wanted, self.plan.verbosity)
        return folder

    @contextmanager
    def opened(self, folder: Path, overwrite: bool = False) -> Iterator[Frames]:
        """The frames of the stack in a folder; layers are finished at the end."""
        stage, hits = self.stage, HitCache(self.stage, [t * 1e-9 for t in self.instants.times_ns])
        light = Light(stage, self.sampling) if self.plan.light else None
        layers = [layer_class(name)(hits) for name in self.plan.layers]
        with Output(folder, self.stack, self.plan.instants.only, overwrite) as output:
            if self.keyframes:
                how = {"tolerance": self.plan.instants.tolerance, "step_px": self.plan.instants.step_px}
                yield Adaptive(stage, self.keyframes, light, layers, hits=hits, output=output, **how)
            else:
                yield Uniform(stage, self.instants, [*layers, *([light] if light else [])], output)
            for layer in layers:
                layer.finish(output)

    @contextmanager
    def pilot(self, count: int, sampling: Sampling, layers: tuple[str, ...]) -> Iterator[tuple[Render, Path]]:
        """A render of at most `count` typical whole keyframes, without messages, and a folder that is removed."""
        instants, verbosity = replace(self.plan.instants, only=None), {"quiet": True, "verbose": False}
        plan = replace(self.plan, layers=layers, instants=instants, verbosity=verbosity)
        with tempfile.TemporaryDirectory(prefix="pecs_pilot_") as folder:
            stop.remove_at_exit(Path(folder))
            yield Render(self.stage, plan, sampling, self.keyframes.typical(count)), Path(folder) / "stack"

    def needed_bytes(self, counts: Callable[[str], bool] = lambda file: True) -> int:
        """Upper bound of this process's frames whose file names count, without the parts that are rendered between
        keyframes."""
        channels = {"frame": len(self.stage.bands) + self.sampling.denoise} if self.plan.light else {}
        channels |= {name: len(layer_class(name).channels) for name in self.plan.layers}
        values = sum(n for name, n in channels.items() for i in self.wanted if counts(f"{name}_{i:06d}.exr"))
        return values * self.stage.size[0] * self.stage.size[1] * BYTES_PER_VALUE

    def _stack_json(self) -> dict[str, Any]:
        stage, plan, keyframes = self.stage, self.plan, self.keyframes
        layers = [layer_class(name).entry() for name in plan.layers]
        return {
            **plan.view.record(stage.lens_record is not None, stage.source.fnumber),
            **({"subpixels": plan.view.subpixels} if plan.view.subpixels > 1 else {}),
            **({"between": True} if keyframes else {}),
            **({"noise": True} if plan.light and self.sampling.denoise else {}),
            **({} if plan.light else {"light": False}),
            "bands": stage.bands,
            "times_ns": self.instants.times_ns,
            "period_ns": self.instants.period_ns,
            "lens": stage.lens_record,
            "scene": stage.source.record,
            "render": {
                **plan.recorded,
                **stage.record(plan),
                "samples": self.sampling.samples * plan.view.subpixels**2,
                **({"instants": len(keyframes.grid.times_ns)} if keyframes else {}),
                **({"partial_keyframes": list(keyframes.partial)} if keyframes and keyframes.partial else {}),
            },
            "versions": {"pecs": pecs.__version__, "blender": bpy.app.version_string},
            **({"layers": layers} if layers else {}),
        }


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
