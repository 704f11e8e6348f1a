#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""`pecs fit` on a real camera: NIST's published medians of first-event latencies (pecs_lab/over_light.py), as steps of
light at five irradiances, beside the values of the shipped profile, which were fitted to the same medians together with
a recording of a disk.

    scripts/studies/fit_nist.py [--pixels 256]

Medians alone do not tell thresholds from the corner, so thresholds, mismatch and noise are kept, and the corner per
ampere and the second stage are fitted; then also the OFF threshold. Some minutes on two cores.
"""

import numpy as np
import pecs
from pecs.fit.estimate import Estimate
from pecs.fit.model import Model
from pecs.fit.recordings import StepEvents
from pecs.fit.search import Problem
from pecs_lab import over_light
from pecs_lab.measure import command

CYCLES = 4
SD = 0.03  # of the logarithm of a median: spread over regions
KEEP = ("contrast_threshold_on", "threshold_mismatch", "noise_std", "refractory_period_s")
KEPT = (*KEEP, "contrast_threshold_off"), KEEP
FOUND = ("corner_hz_per_a", "amplifier_cutoff_hz", "contrast_threshold_off")


def square_wave(irradiance: float) -> StepEvents:
    """The lamp against dark, without events."""
    none = np.array([])
    return StepEvents(
        f"{irradiance:g} W/m2", (irradiance, 0.0), none.astype(int), none, none.astype(bool), 60,
        over_light.HALF_US * np.arange(2 * CYCLES + 1), np.full(2, over_light.HALF_US), True,
    )  # fmt: skip


def fit(keep: tuple[str, ...], pixels: int) -> None:
    chip = pecs.Chip()
    ampere = float(over_light.nist_fa(chip)[0] * 1e-15 / over_light.IRRADIANCE_W_M2[0])  # per W/m2
    data = [square_wave(e) for e in over_light.IRRADIANCE_W_M2]
    problem = Problem(Model("imx636", pixels), data, ampere)
    problem.unknown[:] = 1e3  # of statistics that were not published
    for i, (recording, switch, name) in enumerate(problem.names):
        if name == "first event, quantile 50 %, ln us":
            light = [data.name for data in data].index(recording)
            polarity = "on" if switch.startswith("0 to") else "off"
            problem.measured[i] = np.log(over_light.MEDIANS_US[polarity][light] + 1)
            problem.unknown[i] = SD
    found = Estimate(chip, problem, ["NIST CAM1"], keep=keep).run()
    print(f"kept: {', '.join(keep)}")
    for key in FOUND:
        of, shipped = found.values[key], getattr(chip, key)
        interval = f"{of.interval[0]:.3g} to {of.interval[1]:.3g}" if of.fitted else of.why
        print(f"{key}: {of.value:.4g} ({interval}), shipped {shipped:.4g}, ratio {of.value / shipped:.3f}")
    for c in found.compared:
        if c.name == "first event, quantile 50 %, ln us":
            print(f"{c.recording}, {c.switch}: {np.expm1(c.measured):.1f} us, model {np.expm1(c.simulated):.1f} us")


def main(*, pixels: int = 256) -> None:
    for keep in KEPT:
        fit(keep, pixels)


if __name__ == "__main__":
    command(main)
