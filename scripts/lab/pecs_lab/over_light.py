"""Two published measurements of an imx636 over light, and the same of any sensor: the delay of the first event behind
a step, and the noise in still light.

NIST: Chassagnol, Blattner, Litorja, Bajcsy, IEEE TIM 74 (2025), doi 10.1109/tim.2025.3623767 (public domain). A red LED
in a square wave against dark, W/m2 at the chip, no lens; per region of 10x10 pixels the median delay of a pixel's first
event of one polarity, mean of some triggers. Here 1 Hz, as about five triggers in 5 s. Behind the edge before, the
pixel has stopped anywhere between two thresholds; so has the simulated one.
"""

from collections.abc import Callable

import numpy as np
import pecs

IRRADIANCE_W_M2 = (0.006, 0.046, 0.166, 0.277, 0.398)
LAMBDA_NM = 680.61
MEDIANS_US = {"on": (537.1, 93.3, 41.5, 29.8, 26.9), "off": (623.0, 113.8, 48.3, 36.6, 31.7)}  # CAM1, factory biases
REGION, REGIONS, CYCLES, HALF_US, FRAMES = 100, 9, 4, 5e5, 70
EDGES_US = 1000 + HALF_US * np.arange(2 * CYCLES + 2)

# The published fit of Noise2Params (arXiv 2605.16317) to an EVK4, Hz per pixel.
LUX = np.array([0.15, 0.5, 1, 2, 5, 10, 20, 30, 50, 100])
PUBLISHED_HZ = {
    "on": (0.18, 0.40, 0.56, 0.64, 0.44, 0.17, 0.035, 0.015, 0.010, 0.010),
    "off": (0.31, 0.48, 0.59, 0.67, 0.55, 0.31, 0.11, 0.057, 0.035, 0.032),
}
FA_PER_LUX = 58.6  # of 3000 K light at the focal plane, with the quantum efficiency of imx636
SECONDS, WARM_UP_S, PIXELS = 0.8, 0.1, (20, 1000)  # rows and columns of each light
NOISE_STEP_US, BATCH = 1000.0, 50


def nist_fa(chip: str | pecs.Chip = "imx636") -> np.ndarray:
    """Photocurrent at NIST's irradiances, fA."""
    chip = chip if isinstance(chip, pecs.Chip) else pecs.Chip(chip)
    ampere = chip.amperes_per_unit([{"lambda_nm": LAMBDA_NM, "weight_nm": 1.0}])[0]
    return 1e15 * ampere * np.array(IRRADIANCE_W_M2)


def square_wave(light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames [T, light, pixel] of the lamp switched on and off, and their times, us."""
    behind = np.geomspace(2, HALF_US - 10, FRAMES)
    behind = np.concatenate([[0, 1], 1 + behind])
    t_us = np.concatenate([[0.0], *(edge + behind for edge in EDGES_US)])
    lit = np.concatenate([[0], *(np.r_[k % 2, np.full(len(behind) - 1, 1 - k % 2)] for k in range(len(EDGES_US)))])
    return np.repeat(np.outer(lit, light)[:, :, None], REGION * REGIONS, axis=2).astype(np.float32), t_us


def first_delays_us(events: np.ndarray) -> dict[str, np.ndarray]:
    """[light, pixel, cycle] before square_wave: delay of the first event, us."""
    pixels, levels = REGION * REGIONS, len(IRRADIANCE_W_M2)
    pixel, found = events["y"].astype(int) * pixels + events["x"], {}
    for polarity, name in ((1, "on"), (0, "off")):
        delays = np.full((levels * pixels, CYCLES), np.nan)
        for cycle in range(CYCLES):
            edge = EDGES_US[2 * cycle + 2 - (polarity == 0)]
            mine = (events["p"] == polarity) & (events["t"] >= edge) & (events["t"] < edge + HALF_US)
            which, first = np.unique(pixel[mine], return_index=True)  # events are in order of time
            delays[which, cycle] = events["t"][mine][first] - edge - 0.5
        found[name] = delays.reshape(levels, pixels, CYCLES)
    return found


def delays_us(chip: str, biases: dict[str, int] | None = None) -> dict[str, np.ndarray]:
    """[irradiance, pixel, cycle] of a chip."""
    frames, t_us = square_wave(nist_fa(chip))
    events = pecs.simulate(frames, t_us, chip, photocurrent_a=1e-15, seed=1, readout="ideal", biases=biases or {})
    return first_delays_us(events)


def median_delays_us(sensor: Callable[[int, int], pecs.Sensor], per_fa: float) -> dict[str, np.ndarray]:
    """Median delays of the pixels' first events at each irradiance, not a number where half of the pixels are silent.
    Frames of sensor(width, height) are in units of fA * per_fa."""
    frames, t_us = square_wave(nist_fa() * per_fa)
    with sensor(*frames.shape[:0:-1]) as made:
        found = np.concatenate([made.push(frames, t_us), made.finish()])
    delays = first_delays_us(np.sort(found, order="t"))
    each = {p: d.reshape(len(d), -1) for p, d in delays.items()}
    enough = {p: np.isfinite(d).mean(axis=1) > 0.5 for p, d in each.items()}
    return {p: np.where(enough[p], np.nanmedian(np.nan_to_num(d, nan=2e6), axis=1), np.nan) for p, d in each.items()}


def ratios(delays: dict[str, np.ndarray]) -> dict[str, list[float | None]]:
    """Simulated / measured; None: half of the pixels are silent."""
    out = {}
    for p, medians in delays.items():
        ratio = np.maximum(medians, 0.5) / MEDIANS_US[p]
        out[p] = [float(f"{r:.3g}") if np.isfinite(r) else None for r in ratio]
    return out


def over_regions(delays: np.ndarray) -> dict[str, list[float]]:
    regions = delays.reshape(len(delays), REGIONS, REGION, CYCLES)
    of = {"median": np.nanmedian, "min": np.nanmin, "max": np.nanmax}
    return {name: np.round(f(regions, axis=2).mean((1, 2)), 1).tolist() for name, f in of.items()}


def noise_hz(sensor: Callable[[int, int], pecs.Sensor], per_fa: float) -> dict[str, list[float]]:
    """Rates per pixel in still light at LUX; sensor(width, height), whose frames are in units of fA * per_fa."""
    rows, columns = PIXELS
    light = np.repeat((LUX * FA_PER_LUX * per_fa).astype(np.float32), rows)[:, None]
    batch = np.broadcast_to(light, (BATCH, len(light), columns))
    counts = np.zeros((len(LUX), 2))
    with sensor(columns, len(light)) as made:
        for k in range(0, int((SECONDS + WARM_UP_S) * 1e6 / NOISE_STEP_US), BATCH):
            events = made.push(batch, NOISE_STEP_US * (k + np.arange(BATCH)))
            events = events[(events["t"] > WARM_UP_S * 1e6) & (events["t"] < (WARM_UP_S + SECONDS) * 1e6)]
            np.add.at(counts, (events["y"] // rows, events["p"].astype(int)), 1)
    rates = counts / (rows * columns) / SECONDS
    return {"on": rates[:, 1].tolist(), "off": rates[:, 0].tolist()}
