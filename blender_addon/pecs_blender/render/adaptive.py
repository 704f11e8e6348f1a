# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders keyframes, the motion between them, and where motion does not explain the light, pictures between them.

A keyframe is done when its layers are there, its light last; the interval behind it when its motion is there, which
comes after its pictures between.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pecs._progress import Progress

from . import keyframes, layers, stop
from .between import Between, Interval
from .job import Job
from .judge import Judge
from .options import Options
from .output import Output, as_written
from .plan import Timeline
from .resources import Restart, resident_mb
from .shared import shared
from .still import ANCHOR_EVERY, Frames
from .surfaces import Surfaces

PLAN_SCALE = 0.25  # of the picture that motion is measured on, for planning


@dataclass(frozen=True)
class Plan:
    """grid: the finest instants; keys: which of them are keyframes. With a period, the last interval ends at `end`."""

    grid: Timeline
    keys: list[int]

    @property
    def timeline(self) -> Timeline:
        return Timeline([self.grid.times_ns[k] for k in self.keys], self.grid.period_ns)

    @property
    def ends(self) -> list[int]:
        """Grid steps at which the intervals end."""
        return self.keys[1:] + ([len(self.grid.times_ns)] if self.grid.period_ns else [])


def plan(job: Job, grid: Timeline, step_px: float, scratch: Path) -> Plan:
    scale = PLAN_SCALE / job.subpixels
    small = Surfaces(job, scratch, scale, name="plan_rays")
    return Plan(grid, keyframes.choose(grid, keyframes.Paths(small, job.set_time, scale * job.subpixels), step_px))


class Adaptive:
    def __init__(
        self,
        job: Job,
        plan: Plan,
        light: layers.Light,
        beside: list[layers.Layer],
        judge: Judge,
        options: Options,
    ):
        self._job, self._plan, self._light, self._judge, self._options = job, plan, light, judge, options
        self._motion = next(layer for layer in beside if isinstance(layer, layers.Motion))
        self._look = self._motion.look
        self._look.keep = 2 * options.share + 2
        self._instants = [layer for layer in beside if layer.at == "instant"]
        self._frames = Frames(job, light, self._look, judge)
        self._raw: dict[int, np.ndarray] = {}
        self._clean: dict[int, np.ndarray] = {}

    def render(self, output: Output) -> None:
        count, ends = len(self._plan.keys), self._plan.ends
        wanted = range(count)[self._options.only or slice(None)]
        missing = [i for i in wanted if not self._is_done(i, output)]
        o = self._options
        progress = Progress("render", len(wanted), len(wanted) - len(missing), quiet=o.quiet, verbose=o.verbose)
        grid_s = [t * 1e-9 for t in self._plan.grid.bounds_ns]
        between = Between(self._job, self._light, self._judge, grid_s, output)
        first_mb = None
        for done, index in enumerate(missing, len(wanted) - len(missing) + 1):
            t_s = self._time_s(index)
            for layer in self._instants:
                if not output.has_layer(layer.name, index):
                    self._job.set_time(t_s)
                    layers.write(layer, output, index, t_s)
            first = self._clean_light(index, output)
            if not output.has_layer("light", index):
                output.write_layer("light", index, first)
            if index < len(ends):
                second = self._clean_light((index + 1) % count, output)
                motion = self._motion.render(t_s, grid_s[ends[index]])
                between.refine(Interval(index, self._plan.keys[index], ends[index], first, second, motion))
                output.write_layer("motion", index, motion)
            progress.at(done)
            stop.check()
            if done > len(wanted) - len(missing) + 2 * self._options.share:  # all that is kept is there
                first_mb = first_mb or resident_mb()
                if resident_mb() > first_mb + self._options.restart_growth_mb and done < len(wanted):
                    raise Restart

    def _is_done(self, index: int, output: Output) -> bool:
        due = [layer.name for layer in self._instants] + ["light"]
        due += ["motion"] if index < len(self._plan.ends) else []
        return all(output.has_layer(name, index) for name in due)

    def _time_s(self, index: int) -> float:
        return self._plan.grid.times_ns[self._plan.keys[index]] * 1e-9

    def _clean_light(self, index: int, output: Output) -> np.ndarray:
        """As it is read from the file."""
        if index not in self._clean:
            if output.has_layer("light", index):
                self._clean[index] = output.read_layer("light", index)
            else:
                self._clean[index] = as_written(self._shared_light(index))
            while len(self._clean) > 3:
                self._clean.pop(next(iter(self._clean)))
        return self._clean[index]

    def _shared_light(self, index: int) -> np.ndarray:
        count, reach = len(self._plan.keys), self._options.share
        near = range(index - reach, index + reach + 1)
        near = [i % count if self._plan.grid.period_ns else i for i in near]
        near = list(dict.fromkeys(i for i in near if 0 <= i < count))
        at_ends = {*range(reach), *range(count - reach, count)} if self._plan.grid.period_ns else set()
        self._raw = {i: frame for i, frame in self._raw.items() if i in near or i in at_ends}
        for i in near:
            if i not in self._raw:
                self._raw[i] = self._frames.render(i, self._time_s(i), self._time_s(i - i % ANCHOR_EVERY))
        if len(near) == 1:
            return self._raw[index]
        seen = {i: self._look.seen(self._time_s(i)) for i in near}
        others = [(self._raw[i], seen[i]) for i in near if i != index]
        return shared(self._raw[index], seen[index], others, self._look.surfaces, self._judge)
