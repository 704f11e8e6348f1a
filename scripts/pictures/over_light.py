#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/studies/latency_over_light.png and noise_over_light.png: imx636 beside what others measured of its kind.

scripts/pictures/over_light.py
"""

import json
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pecs

ROOT = Path(__file__).resolve().parents[2]
COLOURS = {"on": "#c0392b", "off": "#2471a3"}
IRRADIANCE_W_M2 = (0.006, 0.046, 0.166, 0.277, 0.398)
# The published fit of Noise2Params (arXiv 2605.16317) to an EVK4, Hz per pixel.
LUX = np.array([0.15, 0.5, 1, 2, 5, 10, 20, 30, 50, 100])
PUBLISHED_HZ = {
    "on": (0.18, 0.40, 0.56, 0.64, 0.44, 0.17, 0.035, 0.015, 0.010, 0.010),
    "off": (0.31, 0.48, 0.59, 0.67, 0.55, 0.31, 0.11, 0.057, 0.035, 0.032),
}
FA_PER_LUX = 58.6  # of 3000 K light at the focal plane, with the profile's quantum efficiency
STEP_US, SECONDS, WARM_UP_S, PIXELS, BATCH = 10.0, 0.8, 0.1, 1000, 512


def noise_hz() -> dict[str, np.ndarray]:
    """Rates in still light; frames are closer than the amplifier's time constant."""
    plane = np.repeat((LUX * FA_PER_LUX).astype(np.float32)[:, None], PIXELS, axis=1)
    batch = np.broadcast_to(plane, (BATCH, *plane.shape))
    counts = np.zeros((len(LUX), 2))
    with pecs.Sensor(PIXELS, len(LUX), photocurrent_a=1e-15, seed=3, readout="ideal") as sensor:
        for k in range(0, int((SECONDS + WARM_UP_S) * 1e6 / STEP_US), BATCH):
            events = sensor.push(batch, STEP_US * (k + np.arange(BATCH)))
            events = events[events["t"] > WARM_UP_S * 1e6]
            np.add.at(counts, (events["y"], events["p"].astype(int)), 1)
    return {"on": counts[:, 1] / PIXELS / SECONDS, "off": counts[:, 0] / PIXELS / SECONDS}


def save(fig, name: str) -> None:
    fig.savefig(ROOT / "docs/studies" / name, dpi=110)
    plt.close(fig)


def main() -> None:
    command = [sys.executable, ROOT / "scripts/bench/latency.py"]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    fig, axes = plt.subplots(figsize=(5.4, 3.4), layout="constrained")
    for name, colour in COLOURS.items():
        ours = report[name]["simulated"]
        axes.fill_between(IRRADIANCE_W_M2, ours["min"], ours["max"], color=colour, alpha=0.12, lw=0)
        axes.plot(IRRADIANCE_W_M2, ours["median"], color=colour, label=f"{name.upper()}, imx636")
        axes.plot(IRRADIANCE_W_M2, report[name]["measured"]["median"], "o", color=colour, label=f"{name.upper()}, NIST")
    axes.set(xscale="log", yscale="log", xlabel="irradiance at the chip, W/m²", ylabel="delay of the first event, µs")
    axes.legend(frameon=False)
    save(fig, "latency_over_light.png")

    fig, axes = plt.subplots(figsize=(5.4, 3.4), layout="constrained")
    for name, rates in noise_hz().items():
        axes.plot(LUX, rates, color=COLOURS[name], label=f"{name.upper()}, imx636")
        axes.plot(LUX, PUBLISHED_HZ[name], "o", color=COLOURS[name], label=f"{name.upper()}, Noise2Params")
        print(name, np.round(rates / PUBLISHED_HZ[name], 2).tolist())
    axes.set(xscale="log", yscale="log", xlabel="lux at the focal plane", ylabel="noise events per pixel, Hz")
    axes.legend(frameon=False)
    save(fig, "noise_over_light.png")


if __name__ == "__main__":
    main()
