"""Scores of simulated events against recorded ones (docs/reference/metrics.md defines each)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._c_types import INT64, POINTER
from ._library import json_function
from .events import as_events

_compare = json_function("pecs_compare", POINTER, INT64, POINTER, INT64)
_delays = json_function("pecs_delays", POINTER, INT64)


def compare(
    real: NDArray[np.void],
    sim: NDArray[np.void],
    *,
    width: int = 0,
    height: int = 0,
    normalisation: str = "shared",
    window_us: int | None = None,
    origin: str = "first-event",
    split_half: bool = True,
    seed: int = 1,
    disk: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Compares two event streams; the dictionary that `pecs compare --json` prints ("chamfer", "gaussian", ...).

        pecs.compare(pecs.read("real.raw"), pecs.read("sim.raw"))["chamfer"]

    Streams are arrays as `pecs.read` gives them, with x below `width` and y below `height` (pixels; if not given, those
    of `real`). `window_us` counts from each stream's first event, or with origin="zero" from t = 0 of both.
    normalisation: "shared", "eq16" or "paper". `split_half`: also score random halves of `real`
    against each other. `disk`: the output of `pecs align detect --json` for `real`, to compare the delays behind its
    edges ("delays"). Raises PecsInputError when a stream is empty or an
    event lies outside the sensor.
    """
    width, height = width or getattr(real, "width", 0), height or getattr(real, "height", 0)
    real, sim = as_events(real), as_events(sim)
    options = {
        "width": width,
        "height": height,
        "normalisation": normalisation,
        "window_us": window_us,
        "origin": origin,
        "split_half": split_half,
        "seed": seed,
        "disk": disk,
    }
    scores: dict[str, Any] = _compare(real.ctypes.data, len(real), sim.ctypes.data, len(sim), options)
    return scores


def delays(
    events: NDArray[np.void], *, disk: dict[str, Any], duration_us: int, width: int = 0, height: int = 0
) -> dict[str, Any]:
    """How long after the edges of a turning disk its events come, in time order and with t in [0, duration_us).

    `width`, `height` (pixels): those of `events` if not given.
    `disk`: what `pecs align detect --json` found, its phase_time_us in the clock of `events`. The dictionary is
    `compare`'s "delays" for one stream, with what a model of the pixel needs to predict it: by polarity "passes",
    `[region][bin]` pixels times passing edges; "regions": how many around (counter-clockwise from the left) and along
    the radius (inner_px to outer_px), and the events of each (docs/reference/metrics.md).
    """
    width, height = width or getattr(events, "width", 0), height or getattr(events, "height", 0)
    events = as_events(events)
    options = {"width": width, "height": height, "duration_us": duration_us, "disk": disk}
    found: dict[str, Any] = _delays(events.ctypes.data, len(events), options)
    return found
