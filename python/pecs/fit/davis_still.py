"""What still windows of a DAVIS with frames show: noise, background, and the step of the photoreceptor by an exposure.

`pecs.Sensor` simulates some pixels in the light of the mean still frame, times the flicker of a lamp if the events show
one, and takes frames at the recording's clock; least squares over the statistics of both give the values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..sensor import Sensor
from .davis import consecutive, some_pixels
from .davis_recording import DavisEvents
from .recordings import CHANCE
from .search import FLICKER, LIGHT, PHASE
from .statistics import GROUPS

STILL_PX = 0.2  # largest shift of the picture between the frames of a still window
MOST_WINDOWS = 6
COLUMNS = 120
BURST_US, AFTER_US = (-1200.0, 2000.0), 6000.0  # about begin and end of an exposure; and what follows
CLASSES = (0.33, 0.67)  # of the pixels, by brightness
RANKS = (0.5, 0.75, 0.9, 0.97, 0.99, 0.999)  # of pixels, by their number of events
STEP_US, CALM_STEP_US = 1000.0, 5000.0  # of the simulated light, with and without flicker
LAMP_HZ, LAMP_SCALE = (80.0, 250.0), 3.0  # searched; weight of the events' mean turn
DARKEST = 0.02  # of white
WHITE = 0.97  # quantile of the still frame
MODEL_SD = 0.1  # ln of a number of events: what the model may be wrong by

Floats = NDArray[np.float64]


def still_windows(of: DavisEvents) -> NDArray[np.int64]:
    """Some frames k that are followed by a frame of the same picture: at edges, changes are small against the slope."""
    smooth = [_boxed(f) for f in of.frames]
    out, followed = [], consecutive(of, exposed=False)
    for k in followed:
        slope = np.hypot(*np.gradient(smooth[k]))
        edges = slope > np.quantile(slope, 0.95)
        if np.abs(smooth[k + 1] - smooth[k])[edges].sum() < STILL_PX * slope[edges].sum():
            out.append(k)
    complete = [k for k in out if k - 1 in followed] or out  # the begin of their first exposure is recorded
    return np.array(complete[len(complete) // 3 :], np.int64)  # pixels settle for a while after motion


def _boxed(frame: NDArray[np.float32]) -> Floats:
    """Means of 3x3 pixels."""
    padded = np.pad(frame.astype(float), 1, mode="edge")
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9


@dataclass
class StillStatistics:
    """Events of some pixels over still windows: window, time since the begin of its exposure, pixel, direction."""

    window: NDArray[np.int64]
    phase_us: Floats
    t_us: Floats  # of the lamp
    pixel: NDArray[np.int64]
    on: NDArray[np.bool_]

    def select(self, kept: NDArray[np.bool_]) -> StillStatistics:
        return StillStatistics(self.window[kept], self.phase_us[kept], self.t_us[kept], self.pixel[kept], self.on[kept])


@dataclass
class StillProblem:
    """For Search: `measured` and `simulated(values)` are numbers of events as logarithms, and parts of the flicker."""

    of: DavisEvents
    windows: NDArray[np.int64]
    black: float
    chip: str | Path
    fixed: dict[str, float]  # values that are not searched, exposure and period among them
    pixels: int
    seed: int
    progress: Callable[[int], object] | None = None
    evaluations: int = 0
    lamp_hz: float = 0.0
    _known: dict[tuple[tuple[str, float], ...], StillStatistics] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        of = self.of
        some, self.block = some_pixels(of.shape, self.pixels)
        some = some[: len(some) // COLUMNS * COLUMNS]
        self.block = self.block[: len(some)]
        frame = np.mean([of.frames[k].ravel() for k in (*self.windows, self.windows[-1] + 1)], axis=0) - self.black
        light = np.clip(frame / np.quantile(frame, WHITE), DARKEST, None)
        self.light, self.kind = light[some], np.searchsorted(np.quantile(light[some], CLASSES), light[some])
        self.recorded = self._of_recording(some)
        typical = np.bincount(self.recorded.pixel, minlength=len(some))
        self.hot = typical > max(8.0, 6 * float(np.quantile(typical, 0.9)))
        self.recorded = self.recorded.select(~self.hot[self.recorded.pixel])
        self._find_lamp()
        self.measured = np.array(list(self.statistics(self.recorded).values()))
        self.names = list(self.statistics(self.recorded))

    @property
    def name(self) -> str:
        return f"{self.of.name}: still windows"

    @property
    def exposure_us(self) -> float:
        return float(np.median(self.of.end_us - self.of.begin_us))

    def _of_recording(self, some: NDArray[np.int64]) -> StillStatistics:
        of, e = self.of, self.of.events
        number = np.full(of.shape[0] * of.shape[1], -1)
        number[some] = np.arange(len(some))
        parts = []
        for i, k in enumerate(self.windows):
            begin_us = of.begin_us[k] + BURST_US[0]
            mine = e[slice(*np.searchsorted(e["t"], (begin_us, begin_us + of.period_us)))]
            pixel = number[mine["y"].astype(np.int64) * of.shape[1] + mine["x"]]
            t_us = mine["t"].astype(float)
            full = np.full(len(mine), i)
            part = StillStatistics(
                full, t_us - of.begin_us[k], t_us - of.begin_us[self.windows[0]], pixel, mine["p"] == 1
            )
            parts.append(part.select(pixel >= 0))
        columns = zip(*([p.window, p.phase_us, p.t_us, p.pixel, p.on] for p in parts), strict=True)
        return StillStatistics(*(np.concatenate(c) for c in columns))

    def places(self, of: StillStatistics) -> dict[str, NDArray[np.bool_]]:
        period_us = self.of.period_us
        since = {"begin": of.phase_us, "end": of.phase_us - self.exposure_us}
        out = {}
        for name, t_us in since.items():
            t_us = (t_us - BURST_US[0]) % period_us + BURST_US[0]
            out[f"{name} of exposures"] = t_us < BURST_US[1]
            out[f"after the {name}"] = (t_us >= BURST_US[1]) & (t_us < AFTER_US)
        out["between"] = ~np.any(list(out.values()), axis=0)
        return out

    def _find_lamp(self) -> None:
        """The frequency that the differences of ON and OFF events follow, in bright pixels between bursts."""
        of = self.recorded.select(self.places(self.recorded)["between"] & (self.kind[self.recorded.pixel] == 2))
        hz = np.arange(*LAMP_HZ, 0.1)
        sign, t_s = np.where(of.on, 1.0, -1.0), of.t_us * 1e-6
        if len(sign) < 100:
            return
        some = np.random.default_rng(1).permutation(len(sign))[:4000]
        power = np.abs(np.exp(-2j * np.pi * hz[:, None] * t_s[some]) @ (sign[some] - sign.mean())) ** 2
        if power.max() / len(some) > CHANCE:
            self.lamp_hz = float(hz[int(power.argmax())])

    def statistics(self, of: StillStatistics, pixels: NDArray[np.bool_] | None = None) -> dict[str, float]:
        if pixels is not None:
            of = of.select(pixels[of.pixel])
        counted = ~self.hot if pixels is None else ~self.hot & pixels
        share = counted.mean()  # numbers are those of all pixels
        of = of.select(~self.hot[of.pixel])
        out = {}
        for place, inside in self.places(of).items():
            kind = self.kind[of.pixel[inside]]
            for direction, mine in (("ON", of.on[inside]), ("OFF", ~of.on[inside])):
                if place.startswith("after"):
                    out[f"{place}, {direction}"] = float(np.log(mine.sum() / share + 3))
                    continue
                for c, name in enumerate(("dim", "middle", "bright")):
                    out[f"{place}, {direction}, {name} pixels"] = float(np.log((mine & (kind == c)).sum() / share + 3))
        inside = self.places(of)["between"]
        rank = np.sort(np.bincount(of.pixel[inside], minlength=len(self.light))[counted])
        at = [int(r * (len(rank) - 1)) for r in RANKS]
        for low, high, r in zip(at, [*at[1:], len(rank)], RANKS, strict=True):
            out[f"events of pixels above {100 * r:g} %"] = float(np.log(rank[low : max(high, low + 1)].mean() + 0.1))
        if self.lamp_hz:
            bright = inside & (self.kind[of.pixel] == 2)
            for direction, mine in (("ON", bright & of.on), ("OFF", bright & ~of.on)):
                turn = np.exp(2j * np.pi * self.lamp_hz * 1e-6 * of.t_us[mine])
                wave = turn.mean() if len(turn) else 0j
                parts = {"cosine": wave.real, "sine": wave.imag}
                out |= {f"lamp, {direction}, {name}": LAMP_SCALE * float(part) for name, part in parts.items()}
        return out

    def simulate(self, values: Mapping[str, float]) -> StillStatistics:
        key = tuple(sorted(values.items()))
        if key not in self._known:
            self.evaluations += 1
            if self.progress:
                self.progress(self.evaluations)
            if len(self._known) > 100:
                self._known.clear()
            self._known[key] = self._simulate({**self.fixed, **values})
        return self._known[key]

    def _simulate(self, values: dict[str, float]) -> StillStatistics:
        light_a, depth, turn = values.pop(LIGHT), values.pop(FLICKER, 0.0), values.pop(PHASE, 0.0)
        period_us, number = self.of.period_us, len(self.windows)
        step_us = STEP_US if self.lamp_hz else CALM_STEP_US
        t_us = np.arange(0.0, (number + 1) * period_us + 2 * step_us, step_us)
        lamp = 1 + depth * np.cos(2e-6 * np.pi * self.lamp_hz * self._recorded_us(t_us - period_us) - turn)
        still = self.light.reshape(-1, COLUMNS).astype(np.float32)
        found = []
        with Sensor(
            COLUMNS, len(still), str(self.chip), overrides=values, seed=self.seed, photocurrent_a=light_a,
            chip_frames=True, time_unit="us",
        ) as sensor:  # fmt: skip
            for i in range(0, len(t_us), 64):
                found.append(sensor.push(still * lamp[i : i + 64, None, None].astype(np.float32), t_us[i : i + 64]))
                sensor.take_frames()
            events = np.concatenate([*found, sensor.finish()])
        since_us = events["t"] - period_us
        events, since_us = events[since_us >= BURST_US[0]], since_us[since_us >= BURST_US[0]]
        window = ((since_us - BURST_US[0]) / period_us).astype(np.int64)
        pixel = events["y"].astype(np.int64) * COLUMNS + events["x"]
        t_us = self._recorded_us(since_us)
        of = StillStatistics(window, since_us - period_us * window, t_us, pixel, events["p"] == 1)
        return of.select(window < number)

    def _recorded_us(self, t_us: Floats) -> Floats:
        """Since the first still window of the recording; simulated windows follow each other, recorded ones may not."""
        window = np.clip((t_us - BURST_US[0]) // self.of.period_us, 0, len(self.windows) - 1).astype(np.int64)
        begin_us = self.of.begin_us[self.windows]
        return t_us - window * self.of.period_us + begin_us[window] - begin_us[0]  # type: ignore[no-any-return]

    def simulated(self, values: Mapping[str, float]) -> Floats:
        return np.array(list(self.statistics(self.simulate(values)).values()))

    def covariance(self, of: StillStatistics) -> Floats:
        """By a jackknife over groups of blocks of pixels."""
        _, block = np.unique(self.block, return_inverse=True)
        group = np.random.default_rng(1).permutation(int(block.max()) + 1)[block] % GROUPS
        left = np.array([list(self.statistics(of, group != g).values()) for g in range(int(group.max()) + 1)])
        left -= left.mean(axis=0)
        out: Floats = (len(left) - 1) / len(left) * left.T @ left
        return out
