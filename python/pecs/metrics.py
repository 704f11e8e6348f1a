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
    realism: bool = False,
) -> dict[str, Any]:
    """Score simulated events against recorded ones. docs/reference/metrics.md defines the scores.

        pecs.compare(pecs.read("real.raw"), pecs.read("sim.raw"))["chamfer"]

    Parameters
    ----------
    real, sim : structured array
        Recorded and simulated events, as in `pecs.read`.
    width, height : int
        Size of the sensor [pixels]. Default 0: that of each stream; a stream without one has that of `real`.
    normalisation : str
        "shared" (default), "eq16" or "paper".
    window_us : int, optional
        Length [us] of the window of both. Default: all.
    origin : str
        Begin of the window: "first-event" (default) of each, or "zero": t = 0 of both.
    split_half : bool
        Also score random halves of `real` against each other. Default True.
    seed : int
        Of the halves, and of `realism`. Default 1.
    disk : dict, optional
        Output of `pecs align detect --json` for `real`, to compare the delays behind the edges of a disk.
    realism : bool
        Also train classifiers to tell the streams apart (seconds). Default False.

    Returns
    -------
    dict
        The scores, as `pecs compare --json` prints them.

    Raises
    ------
    PecsInputError
        A stream is empty, an event lies outside the sensor, or the sizes differ (except "eq16" and "paper").
    """
    (width, height), (sim_width, sim_height) = (
        (width or getattr(events, "width", 0), height or getattr(events, "height", 0)) for events in (real, sim)
    )
    real, sim = as_events(real), as_events(sim)
    options = {
        "width": width,
        "height": height,
        "sim_width": sim_width or None,
        "sim_height": sim_height or None,
        "normalisation": normalisation,
        "window_us": window_us,
        "origin": origin,
        "split_half": split_half,
        "seed": seed,
        "disk": disk,
        "realism": realism,
    }
    scores: dict[str, Any] = _compare(real.ctypes.data, len(real), sim.ctypes.data, len(sim), options)
    return scores


def delays(
    events: NDArray[np.void], *, disk: dict[str, Any], duration_us: int, width: int = 0, height: int = 0
) -> dict[str, Any]:
    """Delays of events behind the edges of a rotating disk, as `delays` of `compare` for one stream.

    `events` are sorted by t in [0, duration_us); `disk` is the output of `pecs align detect --json`, its
    `phase_time_us` in their clock. By polarity also `passes`, [region, bin], pixels times passing edges; `regions`: how
    many around (counter-clockwise from the left) and along the radius, and the events of each.
    """
    width, height = width or getattr(events, "width", 0), height or getattr(events, "height", 0)
    events = as_events(events)
    options = {"width": width, "height": height, "duration_us": duration_us, "disk": disk}
    found: dict[str, Any] = _delays(events.ctypes.data, len(events), options)
    return found
