# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples for a share of noise events.

`pecs sense` estimates the share of a stack (docs/reference/motion.md). With n times the samples the noise is
1/sqrt(n) of it, so a pilot stack with few samples tells the share of stacks with more.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import pecs

from ..scene.cycles import Sampling
from .stack import Render

PILOT_KEYFRAMES = 4
PILOT_SAMPLES = 4  # per rendered pixel
MOST_SAMPLES = 4096  # per rendered pixel
FNUMBER = 2.8  # of a camera that has none


def pilot_sampling(sampling: Sampling) -> Sampling:
    return replace(sampling, samples=PILOT_SAMPLES, noise_events=None)


def samples_for(share: float, pilot: Render, stack: Path) -> int:
    """Smallest power of two of samples per rendered pixel, from 2 on, for at most this share of noise events. stack: of
    the pilot."""
    low, high = 2, MOST_SAMPLES
    while low < high:  # all smaller numbers are too few; `high` is enough, or the most
        middle = 2 ** ((low.bit_length() + high.bit_length() - 2) // 2)
        results = sensed(pilot, stack, render_noise=(PILOT_SAMPLES / middle) ** 0.5)
        if (results["render_noise"]["share"] or 0.0) > share:
            low = 2 * middle
        else:
            high = middle
    return high


def sensed(pilot: Render, stack: Path, **options: Any) -> dict[str, Any]:
    """Results of `pecs sense` of a pilot's stack by its chip."""
    has_fnumber = pilot.stage.lens_record or pilot.stack.get("fnumber")
    options |= {"chip": pilot.plan.bands.chip, "fnumber": None if has_fnumber else FNUMBER}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the share, and of the readout
        results: dict[str, Any] = pecs.sense(stack, stack / "pilot.npz", **options)["results"]
    return results
