# SPDX-License-Identifier: GPL-3.0-or-later
"""How many samples a noise asks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import cycles
from .job import Job
from .layers import Light

PILOT_SAMPLES = 8


def samples(job: Job, sampling: cycles.Sampling, weights: np.ndarray, variance: float) -> int:
    """For this variance of ln(photocurrent) (`weights` of the bands), from two pilot frames with other seeds; it falls
    as 1/samples. The next power of two, so that another machine's rounding chooses the same."""
    pilots = []
    for seed in (sampling.seed + 1, sampling.seed + 2):
        light = Light(job, replace(sampling, samples=PILOT_SAMPLES, seed=seed))
        job.set_time(0.0)
        pilots.append(np.einsum("k,kyx->yx", weights, light.render(0.0)))
    lit = (pilots[0] > 0) & (pilots[1] > 0)
    difference = np.log(pilots[1][lit] / pilots[0][lit])
    seen = float(np.mean(difference**2)) / 2 if difference.size else 0.0
    return int(2 ** np.clip(np.ceil(np.log2(max(PILOT_SAMPLES * seen / variance, 1))), 0, 16))
