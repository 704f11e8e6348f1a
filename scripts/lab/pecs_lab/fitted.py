"""Pixel models fitted to the computed disk of a recording (scripts/studies/fits.py).

The disk is computed, not rendered. Its light is that of a long lamp above it (lamp_fit.py), normalised to a mean of 1
in white; each model has the lamp's place, its brightness and the disk's contrast as values of its own, so that no
model sees the light that was found with another one. The search is alike for all: points of a Sobol sequence over the
ranges, then CMA-ES from the best of them.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pecs
from scipy.stats import qmc

from . import computed_disk, lamp_fit
from .disk import Disk
from .disk_scores import RING, Part, Scored, Slowness, between, deviance, on_grid

CHIP = "imx636"
FIT_COARSER, SCORE_COARSER = 6, 2  # of the sensor's pixels, in x and y
WARMUP_PERIODS = 8  # the last one in steps of 2 * STEP_US
COARSE_STEP_US, STEP_US = 4000.0, 500.0
DISK_RADIUS_MM, DISK_RIGHT_MM, DISTANCE_MM = 153.0, 160.1, 1560.0  # scenes/rotating_disk
LAMP = {"lamp_length_mm": 1200.0, "lamp_width_mm": 120.0}  # its length hardly shows (scripts/tools/fit_lamp.py)
WALLS = 0.05  # light from the walls / mean light from the lamp

# (low, high) of each free value; searched in its logarithm where low > 0
SCENE = {
    "lamp_right_mm": (-600.0, 600.0),
    "lamp_up_mm": (160.0, 900.0),
    "lamp_before_mm": (60.0, 900.0),
    "contrast": (4.0, 40.0),
}
THRESHOLDS = {"contrast_threshold_on": (0.1, 0.8), "contrast_threshold_off": (0.1, 0.8)}
MISMATCH, REFRACTORY = {"threshold_mismatch": (0.01, 0.299)}, {"refractory_period_s": (1e-6, 0.02)}
BOXES = {
    "pecs": THRESHOLDS | MISMATCH | {"noise_std": (0.01, 0.2), "white_fa": (0.3, 10.0)},
    "esim": THRESHOLDS | REFRACTORY | {"log_eps": (1e-4, 1.0)},
    "v2e": THRESHOLDS
    | MISMATCH
    | REFRACTORY
    | {"white_grey": (2.0, 2550.0), "cutoff_hz": (0.5, 100.0), "linear_below": (1.0, 100.0)},
    "voltmeter": {
        "k1": (0.3, 20.0),
        "k2": (0.1, 200.0),
        "k3": (1e-5, 0.1),
        "k4": (1e-9, 1e-4),
        "k5": (1e-12, 1e-6),
        "k6": (1e-6, 0.02),
    },
    "icns": THRESHOLDS
    | MISMATCH
    | REFRACTORY
    | {"white_lux": (0.1, 1e4), "tau_us": (1.0, 1e4), "latency_us": (1.0, 1e4), "jitter_us": (1.0, 1e4)},
}
STARTS, SOBOL, POPULATION = 2, 256, 16
OF_CHIP = {*THRESHOLDS, *MISMATCH, *REFRACTORY, "noise_std"}
ICNS_LUX = 1e4  # of a frame's 1


def sensor(model: str, values: dict, width: int, height: int, **options: object) -> tuple[pecs.Sensor, float]:
    """The sensor, and what its frames are multiplied by, so that a frame's 1 is the recording's mean white."""
    overrides = {k: v for k, v in values.items() if k in OF_CHIP}
    known = OF_CHIP | SCENE.keys() | {"white_fa", "white_grey", "white_lux"}
    parameters = {k: v for k, v in values.items() if k not in known}
    scale = values["white_fa"] if model == "pecs" else values.get("white_grey", 255.0) / 255
    if model == "icns":  # its parameter white_lux is at least 1 lux
        parameters["white_lux"], scale = ICNS_LUX, values["white_lux"] / ICNS_LUX
    ampere = 1e-15 if model == "pecs" else 1.0  # a peer's frame is in units of its white, whatever its photocurrent
    made = pecs.Sensor(
        width, height, CHIP, model=model, parameters=parameters, overrides=overrides, photocurrent_a=ampere,
        readout="ideal", **options,
    )  # fmt: skip
    return made, scale


@dataclass
class Stage:
    """The pixels of the ring on every `coarser`-th pixel of the sensor, packed, from the warm-up on."""

    disk: Disk
    coarser: int
    duration_us: float

    def __post_init__(self):
        self.width, self.height = 1280 // self.coarser, 720 // self.coarser
        yy, xx = np.mgrid[0 : self.height, 0 : self.width]
        angle, radius = self.disk.polar(xx.astype(float), yy.astype(float))
        inside = (radius > (RING[0] - 0.02) * self.disk.radius_px) & (radius < self.disk.radius_px)
        columns = min(1280, int(np.ceil(np.sqrt(inside.sum()))))
        rows = -(-inside.sum() // columns)
        fill = np.resize(
            np.flatnonzero(inside), rows * columns
        )  # what is left of the last row repeats the first pixels
        self.pixels, self.shape = int(inside.sum()), (int(rows), columns)
        self.x, self.y = xx.ravel()[fill], yy.ravel()[fill]
        angle, radius = angle.ravel()[fill], radius.ravel()[fill]
        mm = DISK_RADIUS_MM / self.disk.radius_px * radius
        self.x_mm, self.up_mm = mm * np.cos(np.radians(angle)), mm * np.sin(np.radians(angle))
        period_us = computed_disk.period_us(self.disk)
        self.warmup_us = WARMUP_PERIODS * period_us
        coarse = np.arange(-self.warmup_us, -period_us, COARSE_STEP_US)
        last, counted = np.arange(-period_us, 0, 2 * STEP_US), np.arange(0, self.duration_us + 2 * STEP_US, STEP_US)
        self.t_us = np.concatenate([coarse, last, counted])
        self.white = np.empty((len(self.t_us), len(fill)), bool)
        for white, t in zip(self.white, self.t_us, strict=True):
            on, off = (self.disk.past_deg(angle, t, e) for e in (self.disk.on_edge_deg, self.disk.off_deg))
            white[:] = on < off

    def light(self, values: dict) -> np.ndarray:
        """Light of each pixel in white; mean 1."""
        lamp = {k: values[k] for k in SCENE if k.startswith("lamp")} | LAMP
        cos4 = (1 + ((self.x_mm + DISK_RIGHT_MM) ** 2 + self.up_mm**2) / DISTANCE_MM**2) ** -2
        light = lamp_fit.illuminance(self.x_mm, self.up_mm, lamp, WALLS) * cos4
        return (light / light.mean()).astype(np.float32)

    def events(self, model: str, values: dict, seed: int, threads: int = 0) -> np.ndarray:
        """Of the pixels at their places in the picture, without the warm-up."""
        made, scale = sensor(model, values, *self.shape[::-1], seed=seed, threads=threads)
        white = np.float32(scale) * self.light(values)
        frames = np.where(self.white, white, white / np.float32(values["contrast"])).reshape(-1, *self.shape)
        with made:
            found = np.concatenate([made.push(frames, self.t_us + self.warmup_us), made.finish()])
        found["t"] -= round(self.warmup_us)
        pixel = found["y"].astype(np.int64) * self.shape[1] + found["x"]
        kept = (found["t"] >= 0) & (found["t"] < self.duration_us) & (pixel < self.pixels)
        found, pixel = found[kept], pixel[kept]
        found["x"], found["y"] = self.x[pixel], self.y[pixel]
        return found[np.argsort(found["t"], kind="stable")]


class Box:
    """Free values as points of the unit cube; in their logarithm where a range's low end is above 0."""

    def __init__(self, ranges: dict):
        self.names = list(ranges)
        low, high = np.array(list(ranges.values())).T
        self.log = low > 0
        self.low, self.high = (np.where(self.log, np.log(np.maximum(v, 1e-300)), v) for v in (low, high))

    def values(self, x: np.ndarray) -> dict:
        at = self.low + np.clip(x, 0, 1) * (self.high - self.low)
        at = np.where(self.log, np.exp(np.where(self.log, at, 0)), at)
        return {k: float(f"{v:.4g}") for k, v in zip(self.names, at.tolist(), strict=True)}


def search(loss: Callable[[dict], float], ranges: dict, evaluations: int) -> dict:
    """The values of the least loss, and how they were found."""
    import cma

    warnings.filterwarnings("ignore", module="cma")
    box, done, began = Box(ranges), [], time.process_time()

    def tried(x: np.ndarray) -> float:
        done.append((loss(box.values(x)), np.clip(x, 0, 1)))
        return done[-1][0]

    points = qmc.Sobol(len(box.names), seed=1).random(SOBOL)
    starts = points[np.argsort([tried(x) for x in points])[:STARTS]]
    after_first, rest, ends = min(miss for miss, _ in done), (evaluations - len(done)) // len(starts), []
    for i, x in enumerate(starts):
        options = {"bounds": [0, 1], "popsize": POPULATION, "seed": i + 1, "verbose": -9, "maxfevals": rest}
        before = len(done)
        cma.fmin2(tried, x, 0.2, options)
        ends.append(min(miss for miss, _ in done[before:]))
    miss, x = min(done, key=lambda d: d[0])
    at_bound = [k for k, v in zip(box.names, x.tolist(), strict=True) if min(v, 1 - v) < 0.01]
    spent = {"evaluations": len(done), "cpu_s": round(time.process_time() - began)}
    row = {"parameters": len(box.names), "objective": miss, "objective_after_sobol": after_first}
    return row | {"objective_of_starts": ends, "at_bound": at_bound} | spent | {"values": box.values(x)}


def fit(name: str, ranges: tuple, stage: Stage, part: Part, target: np.ndarray, evaluations: int) -> dict:
    (fixed, free), model = ranges, name.split()[0]

    def loss(values: dict) -> float:
        """How far the simulation is from the recording's `target` cells."""
        return deviance(target, part.cells(stage.events(model, fixed | values, 1, threads=1), stage.disk))

    row = search(loss, free, evaluations)
    return row | {"values": fixed | row["values"]}


@dataclass
class Halves:
    """A recording, the first half to fit and the second to score."""

    recording: str

    def __post_init__(self):
        self.disk, self.events, self.duration_us = computed_disk.examine(self.recording)
        self.middle_us = float(self.duration_us // 2)
        self.first = Part(0, self.middle_us)
        self.second = Part(self.middle_us, self.duration_us)

    def stage(self, coarser: int, part: Part) -> Stage:
        return Stage(self.disk.coarser(coarser), coarser, part.end_us)

    def target(self, part: Part, coarser: int = FIT_COARSER) -> np.ndarray:
        """The recording's cells, per pixel of the stage of a fit."""
        return part.cells(self.events, self.disk) / coarser**2

    def scored(self) -> tuple[Scored, dict]:
        """The second half, and the scores of the recording's pixels between its own."""
        size, disk = (self.events.width, self.events.height), self.disk.coarser(SCORE_COARSER)
        slowness = Slowness.measure(self.events, self.disk, *size, self.duration_us)
        half = between(on_grid(self.events, SCORE_COARSER, 1), disk, self.middle_us, self.duration_us)
        small = [n // SCORE_COARSER for n in size]
        scored = Scored(*half, *small, self.duration_us - self.middle_us, slowness)
        others = between(on_grid(self.events, SCORE_COARSER, 0), disk.moved(0.5, 0.5), self.middle_us, self.duration_us)
        return scored, scored.scores(*others)

    def of_second(self, events: np.ndarray) -> np.ndarray:
        return between(events, self.disk.coarser(SCORE_COARSER), self.middle_us, self.duration_us)[0]
