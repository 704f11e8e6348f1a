#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""How well `pecs fit` finds chips that it does not know: drawn chips, recorded by the sensor with all noise, and fitted
from the stock profile.

    scripts/studies/fit_hidden.py [lamp|screen|disk|davis] [--chips 20] [--first-seed 100] [--output fit_hidden.json]

Each chip is drawn in the ranges of published parts (RANGES), and stands before a lamp that switches through four
levels, and before still light; before a screen that plays the page of `pecs stimulus`, with the cap on at the end; or
before a turning disk (4 to 12 sectors, either direction); or takes frames of a texture that moves and then stays
(folder of PNG and exposures). The photocurrent of level 1 is drawn as well, and not known to
the fit. Events are written as RAW or AEDAT4 and read back. Printed are, for each value, how often its 95 % interval has
the truth, and the median of the relative error. One to two minutes a chip on two cores.
"""

import json
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pecs
from pecs.fit import Davis, Steps, Still, Stimulus, fit, fit_davis, stimulus
from pecs.fit import Disk as Recording
from pecs_lab import computed_disk, davis_scene
from pecs_lab.disk import Disk
from pecs_lab.measure import command
from pecs_lab.report import table

OUTPUT = Path("fit_hidden.json")
CHIP = "imx636"  # overridden by the drawn values
SIDE = 48
LEVELS, LENGTH_US, CYCLES = (1.0, 0.1, 1.0, 0.02), 5e4, 8
STILLS = {1.0: 3.0, 0.05: 3.0, 0.0: 40.0}  # level -> s
STEP_US = 1000.0  # between frames
ELECTRON_C = 1.602176634e-19
WARM_S = 600  # the camera has been on
# A screen: refresh, time constant of its pixels, groups of rows that are written one after the other.
REFRESH_HZ, RESPONSE_S, ROWS = 59.94, 0.004, 16
SCREEN_US = 500.0  # between values of its light, which are its frames
# A disk.
SIZE, RADIUS_PX, DISK_US = {"width": 160, "height": 128}, 50.0, {"duration_us": 4e5, "step_us": 100.0}
PERIOD_US, CONTRAST = (4e4, 1.2e5), (8.0, 20.0)
SLOWNESS = 1.0, 1.8  # the corner in white, times the period / ON threshold: about 1.5 in R_360_L
LIGHT_RATIO = 1.5  # over the disk
# Frames: exposure and what follows it [s], width and height; chip, and value of white before saturation (10 bits).
EXPOSURE_S, REST_S, WIDTHS, HEIGHTS = (0.005, 0.08), (0.02, 0.06), (100, 200), (80, 150)
FRAME_CHIP, WHITE_DN = "davis240c", 700
KEPT = ("amplifier_cutoff_hz", "corner_hz_per_a", "refractory_period_s", "leak_rate_hz")
FRAME_RATIOS, FRAME_RANGES = {"frame_step": (0.3, 0.8)}, {"frame_step_spread": (0.3, 0.6)}
# Low and high, drawn evenly in the logarithm.
RANGES = {
    "contrast_threshold_on": (0.12, 0.4),
    "threshold_mismatch": (0.04, 0.2),
    "amplifier_cutoff_hz": (1e3, 1e4),
    "corner_hz_per_a": (6e14, 4e15),
    "refractory_period_s": (3e-6, 5e-4),
    "background_on_hz": (0.005, 0.05),
    "background_off_hz": (0.005, 0.05),
    "hot_pixel_hz": (5.0, 50.0),
}
RATIOS = {"contrast_threshold_off": (0.9, 1.4), "noise_std": (0.1, 0.24)}  # to contrast_threshold_on
EVENLY = {"leak_rate_hz": (0.0, 0.1), "hot_pixel_fraction": (0.0, 0.005)}
CORNER_HZ = 200.0, 3000.0  # of the photoreceptor at level 1


def between(rng: np.random.Generator, pair: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(pair))))


def draw(seed: int) -> tuple[dict[str, float], float]:
    """A chip's values, and the photocurrent of level 1."""
    rng = np.random.default_rng(seed)
    values = {key: between(rng, pair) for key, pair in RANGES.items()}
    values |= {key: values["contrast_threshold_on"] * between(rng, pair) for key, pair in RATIOS.items()}
    values |= {key: float(rng.uniform(*pair)) for key, pair in EVENLY.items()}
    return values, between(rng, CORNER_HZ) / values["corner_hz_per_a"]


def simulate(values: dict, light_a: float, light: np.ndarray, t_us: np.ndarray, seed: int) -> np.ndarray:
    """Events before light [time] or [time, row]."""
    frames = np.broadcast_to(light.reshape(len(light), -1, 1), (len(light), SIDE, SIDE))
    return pecs.simulate(frames, t_us, CHIP, overrides=values, photocurrent_a=light_a, seed=seed, time_unit="us")


def screen_light(parts: list[tuple[float, float, float]], pwm: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Times [us], and the light of each group of rows, of a screen that plays levels (stimulus.timeline): a new level
    with each refresh, written row by row; a backlight pulsed with 240 Hz, that is dark for the share `pwm`."""
    ends = np.cumsum([seconds for *_, seconds in parts])
    t_s = np.arange(0, ends[-1], SCREEN_US * 1e-6)
    row_s = np.maximum(t_s[:, None] - np.arange(ROWS) / ROWS / REFRESH_HZ, 0)
    frame_s = np.floor(row_s * REFRESH_HZ) / REFRESH_HZ
    part = np.minimum(np.searchsorted(ends, frame_s, "right"), len(parts) - 1)
    first, last, seconds = np.array(parts)[part].transpose(2, 0, 1)
    drive = first * (last / first) ** ((frame_s - ends[part] + seconds) / seconds)
    drive = np.round(256 * drive) / 256
    share, light = 1 - np.exp(-SCREEN_US * 1e-6 / RESPONSE_S), drive.copy()
    for i in range(1, len(light)):
        light[i] = light[i - 1] + share * (drive[i] - light[i - 1])
    return 1e6 * t_s, light * np.where(t_s * 240 % 1 < pwm, 0.0, 1 / (1 - pwm))[:, None]


def record_screen(folder: Path, values: dict, light_a: float, seed: int, suffix: str = "raw", **of: float) -> list:
    """A recording of the screen, of which each row of pixels sees most of the rows, and one with the cap on."""
    at_us, light = screen_light(stimulus.timeline(), **of)
    across = np.arange(ROWS) / (ROWS - 1) - np.linspace(0.3, 0.7, SIDE)[:, None]
    weights = np.exp(-(across**2) / 2 / 0.3**2)
    light = light @ (weights / weights.sum(1, keepdims=True)).T
    warm_us = 1e6 * WARM_S
    lit = np.concatenate([np.repeat(light[:1], WARM_S, 0), light]).astype(np.float32)
    events = simulate(values, light_a, lit, np.concatenate([1e6 * np.arange(WARM_S), warm_us + at_us]), seed)
    path = folder / f"screen.{suffix}"
    _write(path, events)
    return [Stimulus(path), record_still(folder, values, light_a, seed, suffix, 0.0)]


def _write(path: Path, events: np.ndarray) -> None:
    events = events[events["t"] >= 1e6 * WARM_S]
    events["t"] -= round(1e6 * WARM_S)
    pecs.write(path, events, width=SIDE, height=SIDE)


def record_still(folder: Path, values: dict, light_a: float, seed: int, suffix: str, level: float) -> Still:
    shown_us = np.arange(0, STILLS[level] * 1e6, STEP_US)
    t_us = np.concatenate([1e6 * np.arange(WARM_S), 1e6 * WARM_S + shown_us])
    path = folder / f"still_{level:g}.{suffix}"
    _write(path, simulate(values, light_a, np.full(len(t_us), level, np.float32), t_us, seed))
    return Still(path, level)


def record(folder: Path, values: dict, light_a: float, seed: int, suffix: str = "raw") -> list[Steps | Still]:
    """The recordings of a camera, as its user would make them."""
    behind = np.concatenate([[0, 1], np.arange(1 + STEP_US, LENGTH_US - 0.5, STEP_US)])
    count = len(LEVELS)
    t_us = np.concatenate([[0.0], *(5e4 + c * LENGTH_US + behind for c in range(count * CYCLES + 1))])
    levels = [LEVELS[c % count] for c in range(-1, count * CYCLES + 1)]
    light = [np.r_[before, np.full(len(behind) - 1, now)] for before, now in pairwise(levels)]
    lit = np.concatenate([[LEVELS[-1]], *light]).astype(np.float32)
    events = simulate(values, light_a, lit, t_us, seed)
    pecs.write(folder / f"steps.{suffix}", events, width=SIDE, height=SIDE)
    recordings: list[Steps | Still] = [Steps(folder / f"steps.{suffix}", LEVELS)]
    return recordings + [record_still(folder, values, light_a, seed, suffix, level) for level in STILLS]


def record_disk(folder: Path, values: dict, light_a: float, seed: int, suffix: str = "raw") -> list[Recording]:
    rng = np.random.default_rng([seed, 1])
    sectors = 2 * int(rng.integers(2, 7))
    period_us, contrast = between(rng, PERIOD_US), between(rng, CONTRAST)
    speed = 720e6 / sectors / period_us * float(rng.choice((-1, 1)))
    centre = SIZE["width"] / 2 + rng.uniform(-2, 2), SIZE["height"] / 2 + rng.uniform(-2, 2)
    disk = Disk(centre, RADIUS_PX + computed_disk.STILL_PX, speed, float(rng.uniform(0, 360)), sectors)
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None]
    shape = np.exp(np.log(LIGHT_RATIO) / 2 * np.cos(around + rng.uniform(0, 2 * np.pi))) * np.ones(4)
    corner_hz = between(rng, SLOWNESS) * values["contrast_threshold_on"] / period_us * 1e6 * shape
    seen = SIZE | DISK_US | {"margin_px": computed_disk.MARGIN_PX}
    path = folder / f"disk.{suffix}"
    pecs.write(path, computed_disk.simulate("imx636", values, disk, corner_hz, contrast, **seen, seed=seed), **SIZE)
    return [Recording(path, contrast)]


def record_davis(folder: Path, values: dict, light_a: float, seed: int, suffix: str) -> list[Davis]:
    """Adds the values of frames, which are drawn here, to `values`, and takes off those that such a recording does not
    show: they are the chip's, and the fit keeps them."""
    del suffix
    light_a *= values["corner_hz_per_a"] / pecs.Chip(FRAME_CHIP).corner_hz_per_a
    for key in KEPT:
        del values[key]
    rng = np.random.default_rng([seed, 2])
    values |= {key: values["contrast_threshold_on"] * between(rng, pair) for key, pair in FRAME_RATIOS.items()}
    values |= {key: between(rng, pair) for key, pair in FRAME_RANGES.items()}
    exposure_s = between(rng, EXPOSURE_S)
    frames = {"frame_exposure_s": exposure_s, "frame_period_s": exposure_s + between(rng, REST_S)}
    frames["frame_dead_s"] = 0.001
    frames["frame_gain_e"] = float(np.clip(light_a / ELECTRON_C * exposure_s / WHITE_DN, 0.2, 1000))
    size = int(rng.integers(*WIDTHS)), int(rng.integers(*HEIGHTS))
    davis_scene.record(folder / "davis", seed, values | frames, chip=FRAME_CHIP, white_a=light_a, size=size)
    return [Davis(folder / "davis")]


def one(seed: int, make: Callable, pixels: int) -> dict:
    values, light_a = draw(seed)
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        recordings = make(Path(folder), values, light_a, seed, "aedat4" if seed % 2 else "raw")
        recorded = time.monotonic()
        try:
            davis = isinstance(recordings[0], Davis)
            found = fit_davis(recordings[0], FRAME_CHIP, pixels=pixels) if davis else fit(recordings, pixels=pixels)
        except pecs.PecsError as e:
            return {"seed": seed, "refused": str(e).replace(folder + "/", "")}
    truth = dict(values)
    if "corner_hz_per_a" in values:
        truth["corner at level 1"] = light_a * values["corner_hz_per_a"]
    estimated = found.values | {"corner at level 1": found.corner_hz}
    rows = {}
    for key, true in truth.items():
        of = estimated[key]
        if of.fitted:
            inside = of.interval[0] <= true <= of.interval[1]
            rows[key] = {"truth": true, "found": of.value, "interval_95": of.interval, "inside": inside}
    kept = {key: estimated[key].why for key in truth if not estimated[key].fitted}
    took = {"recorded_s": recorded - begin, "fitted_s": time.monotonic() - recorded}
    return {"seed": seed, "misfit": found.misfit, "values": rows, "kept": kept, **took}


def summary(chips: list[dict]) -> list[list[object]]:
    rows, everything = [], []
    names = list(dict.fromkeys(key for chip in chips for key in chip.get("values", {})))
    for name in names:
        of = [chip["values"][name] for chip in chips if name in chip.get("values", {})]
        error = [abs(v["found"] / v["truth"] - 1) for v in of if v["truth"] > 0]
        inside = [v["inside"] for v in of]
        everything += inside
        rows.append([name, len(of), f"{100 * np.mean(inside):.0f} %", f"{100 * np.median(error):.1f} %"])
    rows.append(["all", len(everything), f"{100 * np.mean(everything):.0f} %", ""])
    return rows


def main(
    before: str = "lamp", *, chips: int = 20, first_seed: int = 100, pixels: int = 1024, output: Path = OUTPUT
) -> None:
    make = {"lamp": record, "screen": record_screen, "disk": record_disk, "davis": record_davis}[before]
    found: list[dict] = []
    for seed in range(first_seed, first_seed + chips):
        found.append(one(seed, make, pixels))
        print(json.dumps(found[-1], default=float), flush=True)
        output.write_text(json.dumps({"chips": found}, indent=1, default=float) + "\n")
    print(table(["value", "fitted", "truth in the 95 % interval", "median relative error"], summary(found)))


if __name__ == "__main__":
    command(main)
