"""The readout's values from a recording in which more pixels fire at once than can be sent at once: the events of a row
have one time stamp, and the next row follows as soon as this one is sent (docs/reference/sensor.md)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError
from ..events import Events
from .recordings import Flash, events_of

WINDOW = 16  # rows whose total time counts
ROUNDED_US = 0.41  # standard deviation of the difference of two stamps, of whole us
PAUSE_US = 0.5 * ROUNDED_US / WINDOW  # per row: pauses that rounding hides
LEAST = 40  # windows in which the readout was busy
MAX_SD = 0.3  # of a value; one that is known less well is kept

Floats = NDArray[np.float64]
Found = dict[str, tuple[float, float]]  # value and standard deviation


def measure(of: Flash, profile: Mapping[str, float]) -> Found:
    """Raises PecsInputError where the readout was not busy."""
    events = events_of(of.file)
    vector_px = profile["readout_vector_px"]
    time_us, vectors = _served(events, vector_px)
    windows = np.arange(0, max(len(time_us) - WINDOW, 0), WINDOW)
    took_us = time_us[windows + WINDOW] - time_us[windows]
    sent = np.add.reduceat(vectors, windows)[: len(windows)] if len(windows) else vectors[:0]
    a = np.stack([np.full(len(windows), float(WINDOW)), sent], axis=1)
    vector_us = 1e6 * vector_px / profile["readout_rate_hz"] if profile["readout_rate_hz"] > 0 else 0.0
    busy = took_us - vector_us * sent
    busy = busy <= np.quantile(busy, 0.1) + 6 * ROUNDED_US if len(windows) else busy > 0
    for _ in range(20):
        if busy.sum() < LEAST:
            raise PecsInputError(
                f"{of.file}: got {int(busy.sum())} times {WINDOW} rows that follow each other without a pause, "
                f"wanted {LEAST} (brighter light, more pixels or more flashes)"
            )
        differ = np.ptp(sent[busy]) > 0
        if differ:
            found, spread = _least_squares(a[busy], took_us[busy])
            spread += np.diag([PAUSE_US**2, (PAUSE_US / vectors.mean()) ** 2])
        if not differ or found[1] <= 0 or np.sqrt(spread[1, 1]) > MAX_SD * found[1]:  # rows are alike: the rate stays
            found, spread = _least_squares(a[busy, :1], took_us[busy] - vector_us * sent[busy])
            found, spread = np.append(found, vector_us), np.pad(spread + PAUSE_US**2, (0, 1))
        before, busy = busy, np.abs(took_us - a @ found) < 4 * ROUNDED_US
        if (busy == before).all():
            break
    out = {"readout_row_s": (1e-6 * float(found[0]), 1e-6 * float(np.sqrt(spread[0, 0])))}
    if spread[1, 1] > 0:
        rate_hz = 1e6 * vector_px / float(found[1])
        out["readout_rate_hz"] = rate_hz, rate_hz * float(np.sqrt(spread[1, 1])) / float(found[1])
    return out


def _served(events: Events, vector_px: float) -> tuple[Floats, NDArray[np.int64]]:
    """Time of each row that was served, and the number of its vectors."""
    y, t, vector = (events[key].astype(np.int64) for key in ("y", "t", "x"))
    vector //= int(vector_px)
    row = np.r_[True, (np.diff(y) != 0) | (np.diff(t) != 0)]
    begin = np.flatnonzero(row)
    return t[begin].astype(float), np.add.reduceat((row | np.r_[True, np.diff(vector) != 0]).astype(np.int64), begin)


def _least_squares(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    inverse = np.linalg.inv(a.T @ a)
    found = inverse @ a.T @ b
    misses = b - a @ found
    return found, inverse * max(ROUNDED_US**2, float(misses @ misses) / len(b))
