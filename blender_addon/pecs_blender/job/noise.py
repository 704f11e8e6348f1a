# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples for a share of noise events.

`pecs sense` estimates the share of a stack (docs/reference/motion.md). With n times the samples the noise is
1/sqrt(n) of it, so a pilot stack with few samples tells the share of stacks with more.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import pecs

from ..scene.cycles import Sampling

PILOT_KEYFRAMES = 4
PILOT_SAMPLES = 4  # per rendered pixel
MOST_SAMPLES = 4096  # per rendered pixel
FNUMBER = 2.8  # of a camera that has none


def pilot_sampling(sampling: Sampling) -> Sampling:
    return replace(sampling, samples=PILOT_SAMPLES, noise_events=None)


def samples_for(share: float, stack: Path, chip: pecs.Chip, fnumber: float | None) -> int:
    """Smallest power of two of samples per rendered pixel, from 2 on, for at most this share of noise events. stack: of
    the pilot."""
    low, high = 2, MOST_SAMPLES
    while low < high:  # all smaller numbers are too few; `high` is enough, or the most
        middle = 2 ** ((low.bit_length() + high.bit_length() - 2) // 2)
        if _share(stack, chip, fnumber, (PILOT_SAMPLES / middle) ** 0.5) > share:
            low = 2 * middle
        else:
            high = middle
    return high


def _share(stack: Path, chip: pecs.Chip, fnumber: float | None, factor: float) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the share, and of the readout
        report = pecs.sense(stack, stack / "pilot.npz", chip=chip, fnumber=fnumber, render_noise=factor)
    return report["results"]["render_noise"]["share"] or 0.0
