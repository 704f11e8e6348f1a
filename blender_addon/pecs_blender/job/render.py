# SPDX-License-Identifier: GPL-3.0-or-later
"""One render job: a scene and a plan in, an EXR stack (docs/reference/exr_stack.md) out."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from pecs._progress import Line

from .. import stop
from ..adaptive.keyframes import Keyframes, choose_keyframes
from ..camera.plan import Plan
from ..camera.stage import Stage
from ..output import is_stack
from ..scene.source import Source
from . import cost, noise
from .stack import Render


def render(
    source: Source, folder: Path, plan: Plan, exists: str = "continue", cost_since_s: float | None = None
) -> Path:
    """The stack's folder. exists: what to do if the folder contains another job's stack: "continue" (an error),
    "overwrite", or "new" (use the next free name). cost_since_s: prints the cost, and writes nothing; the start is
    counted from this value of time.perf_counter."""
    for note in source.notes if not plan.verbosity["quiet"] else ():
        print(f"render: {note}", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix="pecs_", ignore_cleanup_errors=True) as scratch:
        stop.remove_at_exit(Path(scratch))
        stage = Stage(source, plan, Path(scratch))
        job = (_continued(stage, plan, folder, exists) if cost_since_s is None else None) or _planned(stage, plan)
        if cost_since_s is not None:
            cost.print_cost(job, time.perf_counter() - cost_since_s)
            return folder
        return job.write(folder, exists)


def _continued(stage: Stage, plan: Plan, folder: Path, exists: str) -> Render | None:
    """The render that the stack in the folder belongs to, with its keyframes and samples. With "continue", that of any
    stack: Output refuses it if it differs."""
    try:
        stack = json.loads((folder / "stack.json").read_bytes())
        samples = stack["render"]["samples"] // plan.view.subpixels**2
        keyframes = Keyframes.at(plan.instants.grid, stack["times_ns"], stack["render"].get("partial_keyframes", []))
    except (OSError, ValueError, KeyError, TypeError):  # not a stack of this job
        return None
    sampling = replace(plan.sampling, samples=samples) if plan.sampling.noise_events else plan.sampling
    job = Render(stage, plan, sampling, keyframes if plan.instants.step_px else None)
    return job if exists == "continue" or is_stack(folder, job.stack) else None


def _planned(stage: Stage, plan: Plan) -> Render:
    """Chooses keyframes for adaptive steps, and samples for a share of noise events."""
    instants, sampling = plan.instants, plan.sampling
    if not instants.step_px:
        return Render(stage, plan, sampling)
    job = Render(stage, plan, sampling, choose_keyframes(stage, instants, Line(task="motion", **plan.verbosity)))
    share = sampling.noise_events
    if not share:
        return job
    with job.pilot(noise.PILOT_KEYFRAMES, noise.pilot_sampling(sampling), ("motion",)) as (pilot, folder):
        pilot.write(folder)
        samples = noise.samples_for(share, pilot, folder)
    if not plan.verbosity["quiet"]:
        per_pixel = samples * plan.view.subpixels**2
        print(f"render: {per_pixel} samples per pixel for {share:.3g} noise events", file=sys.stderr)
    return Render(stage, plan, replace(sampling, samples=samples), job.keyframes)
