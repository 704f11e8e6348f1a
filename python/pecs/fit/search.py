"""Least squares between the statistics of recordings and those of the model, as a function of the profile's values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import optional_module
from . import disk, statistics
from .disk import DiskEvents
from .model import Model
from .recordings import StepEvents, StillEvents

LIGHT = "light_a"  # photocurrent of level 1
FLICKER, PHASE = "flicker_depth", "flicker_phase"  # of a lamp: 1 + depth cos(2 pi f t - phase)
# How a value becomes a coordinate of the search, in which the statistics are nearly linear, and back: rates add up, and
# delays are proportional to refractory periods and to the inverse of a cut-off.
COORDINATES: dict[str, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "logarithm": (lambda v: float(np.log(v)), lambda x: float(np.exp(x))),
    "in 0.1 Hz": (lambda v: 10 * v, lambda x: 0.1 * x),
    "in 0.1 ms": (lambda v: 1e4 * v, lambda x: 1e-4 * x),
    "inverse in ms": (lambda v: 1e3 / v, lambda x: 1e3 / x),
    "in 0.2": (lambda v: 5 * v, lambda x: 0.2 * x),
}
# Key -> coordinate, least, most, and the start of a value that the profile has at 0.
FREE = {
    LIGHT: ("logarithm", 1e-16, 1e-8, 1e-12),
    "corner_hz_per_a": ("logarithm", 1e12, 1e18, 2e15),
    "amplifier_cutoff_hz": ("inverse in ms", 50.0, 1e6, 1e4),
    "contrast_threshold_on": ("logarithm", 0.02, 1.5, 0.2),
    "contrast_threshold_off": ("logarithm", 0.02, 1.5, 0.2),
    "threshold_mismatch": ("logarithm", 0.003, 0.3, 0.05),
    "noise_std": ("logarithm", 0.003, 0.3, 0.03),
    "refractory_period_s": ("in 0.1 ms", 1e-6, 0.1, 1e-5),
    "leak_rate_hz": ("in 0.1 Hz", 0.0, 10.0, 0.0),
    "background_on_hz": ("in 0.1 Hz", 0.0, 10.0, 0.0),
    "background_off_hz": ("in 0.1 Hz", 0.0, 10.0, 0.0),
    "frame_step": ("logarithm", 0.003, 2.0, 0.1),
    "frame_step_spread": ("logarithm", 0.02, 2.0, 0.4),
    FLICKER: ("in 0.2", 0.0, 1.0, 0.05),
    PHASE: ("in 0.2", -20.0, 20.0, 0.0),
}
DAVIS_KEYS = ("frame_step", "frame_step_spread", FLICKER, PHASE)  # of recordings with frames alone
STILL_KEYS = tuple(key for key, (kind, *_) in FREE.items() if kind == "in 0.1 Hz")
PRIOR_SD = 2.0  # of a logarithm, about the starting profile
HISTORY = 0.7  # of the rate of noise in still light, which depends for minutes on what the pixels saw before
STEP = (0.03, 0.3)  # least and most of a coordinate, for derivatives
SEEN = 20.0  # length of the change of the statistics, in deviations, that a step for a derivative should cause
DAMPING = (0.0, 0.1, 1.0, 10.0)  # of a step that does not help
SETTLED = 0.2  # longest step, in standard deviations, that is not worth taking

Floats = NDArray[np.float64]
Pixels = NDArray[Any] | None  # numbers of some; None: all


def forward(key: str, value: float) -> float:
    return COORDINATES[FREE[key][0]][0](value)


def back(key: str, x: float) -> float:
    return COORDINATES[FREE[key][0]][1](x)


@dataclass
class Problem:
    """Statistics of the recordings, and those of the model with `values`: the free ones, LIGHT among them unless
    `light_a` is known, and `fixed` ones."""

    model: Model
    data: list[StepEvents | StillEvents | DiskEvents]
    light_a: float | None
    progress: Callable[[int], object] | None = None

    def __post_init__(self) -> None:
        self.fixed: dict[str, float] = {}
        self.names: list[tuple[str, str, str]] = []  # recording, switch, statistic
        self.recording_of: list[int] = []
        self.later: list[list[list[int]]] = []
        self.evaluations = 0
        measured: list[float] = []
        for number, of in enumerate(self.data):
            tables = statistics.tables(of) if isinstance(of, StepEvents) else []
            self.later.append([statistics.later_events(t) for t in tables])
            for switch, found in self._of_recording(number, of, tables):
                measured += found.values()
                self.names += [(of.name, switch, name) for name in found]
                self.recording_of += [number] * len(found)
        self.measured = np.array(measured)
        ramps = [isinstance(d, StepEvents) and d.ramps_us is not None for d in self.data]
        rows = zip(self.names, measured, self.recording_of, strict=True)
        self.unknown = np.array([statistics.unknown(name, value, ramps[of]) for (_, _, name), value, of in rows])

    def _of_recording(
        self,
        number: int,
        of: StepEvents | StillEvents | DiskEvents,
        tables: list[statistics.Table],
        pixels: Pixels = None,
    ) -> list[tuple[str, dict[str, float]]]:
        if isinstance(of, DiskEvents):
            values = iter(disk.measured(of, pixels))
            return [(edge, {name: next(values) for name in names}) for edge, names in disk.names(of)]
        if isinstance(of, StillEvents):
            return [("", statistics.of_still(of, pixels))]
        out = []
        for j, table in enumerate(tables):
            mine = table if pixels is None else table.select(pixels)
            switch = f"{of.levels[j - 1]:g} to {of.levels[j]:g}"
            ramp, length_us = of.ramps_us is not None, float(of.lengths_us[j])
            found = statistics.of_switch(mine, self.later[number][j], of.exact, length_us, ramp)
            out.append((switch, found))
        return out

    def simulate(self, values: Mapping[str, float]) -> list[Any]:
        """For each recording its StepEvents or, for still light, noise and rest."""
        overrides = {**self.fixed, **values}
        light_a = overrides.pop(LIGHT, None) or self.light_a or 0.0
        model = self.model
        return [
            model.turning(of, overrides)
            if isinstance(of, DiskEvents)
            else (model.switches if isinstance(of, StepEvents) else model.still_events)(of, light_a, overrides)  # type: ignore[operator]
            for of in self.data
        ]

    def focus(self, values: Mapping[str, float], share: float) -> None:
        """From here on, disks are simulated in the light that they have with these values, with a share of the
        pixels."""
        overrides = {key: v for key, v in {**self.fixed, **values}.items() if key != LIGHT}
        for of in self.data:
            if isinstance(of, DiskEvents):
                self.model.focus(of, overrides, share)

    def _still_rates(
        self, noise: StillEvents, rest: StillEvents, pixels: Pixels = None
    ) -> tuple[Floats, Floats, NDArray[Any]]:
        """ON and OFF: rates of noise, and of the rest; numbers of the rest's ON events."""
        some = slice(None) if pixels is None else pixels
        count = self.model.still_pixels
        of_noise = np.array([n[some].mean() / noise.seconds for n in (noise.on, noise.off)])
        others = [n.reshape(count, -1)[some] for n in (rest.on, rest.off)]
        return of_noise, np.array([n.mean() / rest.seconds for n in others]), others[0]

    def _still_statistics(
        self, of: StillEvents, noise: StillEvents, rest: StillEvents, pixels: Pixels = None
    ) -> list[float]:
        of_noise, others, counts = self._still_rates(noise, rest, pixels)
        out: list[float] = np.sqrt(of_noise + others).tolist()
        if of.level == 0:  # regular events have less variance
            mean, shot = counts.mean(), of_noise[0] * rest.seconds
            out.append(float((counts.var() + shot) / (mean + shot)) if mean + shot else 1.0)
        return out

    def _function(self, number: int, sim: Any) -> Callable[[Pixels], list[float]]:
        """Statistics of what `simulate` gave, or of a recording."""
        of = self.data[number]
        if isinstance(sim, disk.DiskStatistics):
            return lambda pixels: disk.predicted(of, sim, simulated=pixels)  # type: ignore[arg-type]
        if isinstance(sim, tuple):
            return lambda pixels: self._still_statistics(of, *sim, pixels)  # type: ignore[arg-type]
        tables = statistics.tables(sim) if isinstance(sim, StepEvents) else []
        return lambda pixels: [
            v for _, found in self._of_recording(number, sim, tables, pixels) for v in found.values()
        ]

    def simulated(self, values: Mapping[str, float]) -> Floats:
        self.evaluations += 1
        if self.progress:
            self.progress(self.evaluations)
        return np.concatenate([self._function(i, sim)(None) for i, sim in enumerate(self.simulate(values))])

    def covariance(self, values: Mapping[str, float] | None = None) -> Floats:
        """Covariance of the measured statistics or, with values, of the simulated ones; recordings are independent."""
        sims = self.data if values is None else self.simulate(values)
        out = np.zeros((len(self.measured),) * 2)
        done = 0
        for number, (of, sim) in enumerate(zip(self.data, sims, strict=True)):
            part = statistics.jackknife(self._function(number, sim), self._groups(sim))
            if isinstance(sim, disk.DiskStatistics):
                part += self._light_covariance(of, sim)  # type: ignore[arg-type]
            if isinstance(sim, tuple):
                of_noise, others, _ = self._still_rates(*sim)
                part[[0, 1], [0, 1]] += (HISTORY * of_noise) ** 2 / 4 / np.maximum(of_noise + others, 1e-6)
            count = self.recording_of.count(number)
            assert part.shape == (count, count), of.name
            out[done : done + count, done : done + count] = part
            done += count
        return out

    def _groups(self, sim: Any) -> int:
        """Pixels, or groups of them, that a jackknife leaves out."""
        if isinstance(sim, tuple):
            return self.model.still_pixels
        if isinstance(sim, (disk.DiskStatistics, DiskEvents)):
            return len(sim.per_edge if isinstance(sim, disk.DiskStatistics) else sim.count)
        return int(sim.pixels)

    def _light_covariance(self, of: DiskEvents, sim: disk.DiskStatistics) -> Floats:
        """The light comes from the recording's own events: its part of the recording's covariance."""

        def miss(some: NDArray[Any]) -> Floats:
            return np.subtract(disk.predicted(of, sim, some), disk.measured(of, some))

        groups = len(of.count)
        return statistics.jackknife(miss, groups) - statistics.jackknife(lambda some: disk.measured(of, some), groups)


class Search:
    """Least squares over free keys, whose values are in a vector x (`forward`)."""

    def __init__(self, problem: Problem, start: Mapping[str, float]):
        self.problem, self.start = problem, dict(start)
        self.variance = np.ones(len(problem.measured))
        self.steps: dict[str, float] = {}
        self.known: dict[str, float] = {}  # standard deviations of coordinates about the start

    def values(self, keys: Sequence[str], x: Floats) -> dict[str, float]:
        return {key: float(np.clip(back(key, v), *FREE[key][1:3])) for key, v in zip(keys, x, strict=True)}

    def limits(self, keys: Sequence[str]) -> tuple[Floats, Floats]:
        pairs = np.array([sorted((forward(key, FREE[key][1]), forward(key, FREE[key][2]))) for key in keys])
        return pairs[:, 0], pairs[:, 1]

    def residuals(self, keys: Sequence[str], x: Floats) -> Floats:
        found: Floats = (self.problem.simulated(self.values(keys, x)) - self.problem.measured) / np.sqrt(self.variance)
        return found

    def slopes(self, keys: Sequence[str], x: Floats, both_sides: bool = False) -> Floats:
        """d statistic / d x, in deviations. Steps are large where the statistics hardly change: the simulations before
        and behind a step share their random numbers, but events that come or go let them part."""
        low, high = self.limits(keys)
        out = np.empty((len(self.variance), len(keys)))
        here = self.residuals(keys, x)
        for i, key in enumerate(keys):
            step = self.steps.setdefault(key, STEP[0])
            up, down = x.copy(), x.copy()
            up[i] = min(x[i] + step, high[i])
            down[i] = max(x[i] - step, low[i]) if both_sides or up[i] - x[i] < step / 2 else x[i]
            behind = self.residuals(keys, up) if up[i] > x[i] else here
            before = self.residuals(keys, down) if down[i] < x[i] else here
            out[:, i] = (behind - before) / (up[i] - down[i])
            wanted = float(np.clip(SEEN / (np.linalg.norm(out[:, i]) + 1e-9), *STEP))
            if not 0.5 < wanted / step < 2:  # the simulations of a step that stays are kept
                self.steps[key] = wanted
        return out

    def prior(self, keys: Sequence[str]) -> Floats:
        """Its inverse variance; very little except for logarithms, so that matrices can be inverted."""
        usual = (PRIOR_SD if FREE[key][0] == "logarithm" else 1e3 for key in keys)
        return np.diag([self.known.get(key, sd) ** -2 for key, sd in zip(keys, usual, strict=True)])

    def spread(self, keys: Sequence[str], x: Floats, slopes: Floats, covariance: Floats, wider: float) -> Floats:
        """Covariance of x, from that of the statistics; larger by wider**2, and where the model misses by more than the
        noise."""
        scale, prior = 1 / np.sqrt(self.variance), self.prior(keys)
        inverse = np.linalg.inv(slopes.T @ slopes + prior)
        misses, gain = self.residuals(keys, x), inverse @ slopes.T
        excess = max(1.0, float(misses @ misses) / max(1, len(misses) - len(keys)))
        noise = covariance * np.outer(scale, scale)
        found: Floats = wider**2 * excess * gain @ noise @ gain.T + inverse @ prior @ inverse
        return found

    def middle(self, keys: Sequence[str]) -> Floats:
        return np.array([forward(key, self.start[key]) for key in keys])

    def approach(self, keys: Sequence[str], x: Floats, loss: str, most: int) -> Floats:
        """From far away: a trust region, with slopes from one side."""
        optimize = optional_module("scipy.optimize", "SciPy", "pecs fit", "fit")
        low, high = self.limits(keys)
        middle, weight = self.middle(keys), np.sqrt(self.prior(keys))

        def residuals(at: Floats) -> Floats:
            return np.concatenate([self.residuals(keys, at), weight @ (at - middle)])

        def slopes(at: Floats) -> Floats:
            return np.vstack([self.slopes(keys, at), weight])

        inside = np.clip(x, low + 1e-6, high - 1e-6)
        found = optimize.least_squares(
            residuals, inside, slopes, (low, high), loss=loss, f_scale=3.0, max_nfev=most, xtol=2e-3, ftol=1e-4
        )
        best: Floats = found.x
        return best

    def refine(self, keys: Sequence[str], x: Floats, most: int) -> Floats:
        """Gauss-Newton steps with slopes from both sides, damped until they help (Marquardt 1963)."""
        low, high = self.limits(keys)
        middle, pull = self.middle(keys), np.diag([self.known[key] ** -2 if key in self.known else 0.0 for key in keys])

        def loss(at: Floats) -> float:
            return float(np.sum(self.residuals(keys, at) ** 2) + (at - middle) @ pull @ (at - middle))

        for _ in range(most):
            slopes, misses = self.slopes(keys, x, both_sides=True), self.residuals(keys, x)
            normal, down = slopes.T @ slopes + self.prior(keys), slopes.T @ misses + pull @ (x - middle)
            step, sd = -np.linalg.solve(normal, down), np.sqrt(np.diag(np.linalg.inv(normal)))
            if (np.abs(step) < SETTLED * sd).all():
                break
            damped = (-np.linalg.solve(normal + d * np.diag(np.diag(normal)), down) for d in DAMPING)
            tried = (np.clip(x + step, low, high) for step in damped)
            before = loss(x)
            found = next((at for at in tried if loss(at) < before), None)
            if found is None:
                break
            x = found
        return x
