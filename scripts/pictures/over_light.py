#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/studies/latency_over_light.png and noise_over_light.png: imx636 beside what others measured of its kind.

scripts/pictures/over_light.py
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pecs
from figures import OFF, ON, plt
from pecs_lab.over_light import IRRADIANCE_W_M2, LUX, PUBLISHED_HZ, noise_hz

ROOT = Path(__file__).resolve().parents[2]
COLOURS = {"on": ON, "off": OFF}


def sensor(width: int, height: int) -> pecs.Sensor:
    return pecs.Sensor(width, height, photocurrent_a=1e-15, seed=3, readout="ideal")


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
    noise = noise_hz(sensor, 1.0)
    for name, rates in noise.items():
        axes.plot(LUX, rates, color=COLOURS[name], label=f"{name.upper()}, imx636")
        axes.plot(LUX, PUBLISHED_HZ[name], "o", color=COLOURS[name], label=f"{name.upper()}, Noise2Params")
    axes.set(xscale="log", yscale="log", xlabel="lux at the focal plane", ylabel="noise events per pixel, Hz")
    axes.legend(frameon=False)
    save(fig, "noise_over_light.png")
    both, published = np.add(noise["on"], noise["off"]), np.add(*PUBLISHED_HZ.values())
    ratios = {name: np.divide(rates, PUBLISHED_HZ[name]) for name, rates in noise.items()}
    for name, row in (ratios | {"both": both / published, "share of ON": noise["on"] / both}).items():
        print(name, np.round(row, 2).tolist())


if __name__ == "__main__":
    main()
