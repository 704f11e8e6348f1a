"""The readout's values from a recording in which more pixels fire at once than can be sent at once: the events of a
group of rows have one time stamp, and the next group follows as soon as this one is sent (docs/reference/sensor.md)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError
from ..events import Events, read
from .recordings import Flash

WINDOW = 16  # groups of rows whose total time counts
ROUNDED_US = 0.41  # standard deviation of the difference of two stamps, of whole us
PAUSE_US = 0.5 * ROUNDED_US / WINDOW  # per group: pauses that rounding hides
LEAST = 40  # windows in which the readout was busy
MOST_ROWS = 32  # of a group
SAME = 0.95  # least share of neighbouring rows of a group that come with the same stamp
MAX_SD = 0.3  # of a value; one that is known less well is kept

Floats = NDArray[np.float64]
Found = dict[str, tuple[float, float]]  # value and standard deviation


def measure(of: Flash, profile: Mapping[str, float]) -> Found:
    """Raises PecsInputError where the readout was not busy."""
    events = read(of.file)
    row, stamp, number = _rows(events)
    group = _group_rows(row, stamp)
    time_us, most = _served(row // group, stamp, number)
    windows = np.arange(0, max(len(time_us) - WINDOW, 0), WINDOW)
    took_us = time_us[windows + WINDOW] - time_us[windows]
    sent = np.add.reduceat(most, windows)[: len(windows)] if len(windows) else most[:0]
    a = np.stack([np.full(len(windows), float(WINDOW)), sent], axis=1)
    event_us = 1e6 / profile["readout_rate_hz"] if profile["readout_rate_hz"] > 0 else 0.0
    busy = took_us - event_us * sent
    busy = busy <= np.quantile(busy, 0.1) + 6 * ROUNDED_US if len(windows) else busy > 0
    for _ in range(20):
        if busy.sum() < LEAST:
            raise PecsInputError(
                f"{of.file}: got {int(busy.sum())} times {WINDOW} groups of rows that follow each other without a "
                f"pause, wanted {LEAST} (brighter light, more pixels or more flashes)"
            )
        found, spread = _least_squares(a[busy], took_us[busy])
        spread += np.diag([PAUSE_US**2, (PAUSE_US / most.mean()) ** 2])
        if found[1] <= 0 or np.sqrt(spread[1, 1]) > MAX_SD * found[1]:  # rows are all alike: the rate stays
            found, spread = _least_squares(a[busy, :1], took_us[busy] - event_us * sent[busy])
            found, spread = np.append(found, event_us), np.pad(spread + PAUSE_US**2, (0, 1))
        before, busy = busy, np.abs(took_us - a @ found) < 4 * ROUNDED_US
        if (busy == before).all():
            break
    out = {
        "readout_row_s": (1e-6 * float(found[0]), 1e-6 * float(np.sqrt(spread[0, 0]))),
        "readout_group_rows": (float(group), 0.0),
    }
    if spread[1, 1] > 0:
        out["readout_rate_hz"] = (1e6 / float(found[1]), 1e6 / float(found[1]) ** 2 * float(np.sqrt(spread[1, 1])))
    return out


def _rows(events: Events) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Row, stamp and number of events of each run of events of a row."""
    y, t = events["y"].astype(np.int64), events["t"].astype(np.int64)
    begin = np.flatnonzero(np.r_[True, (np.diff(y) != 0) | (np.diff(t) != 0)])
    return y[begin], t[begin], np.diff(np.r_[begin, len(y)])


def _group_rows(row: NDArray[np.int64], stamp: NDArray[np.int64]) -> int:
    """The largest power of two so that neighbouring rows in it come one behind the other, with one stamp."""
    full = np.flatnonzero(np.diff(row[:-1]) == 1)  # runs whose next one is of the next row
    same = stamp[full + 1] == stamp[full]
    group = 1
    while group < MOST_ROWS:
        middle = (row[full] + 1) % (2 * group) == group  # between the halves of a group of twice the rows
        if not middle.any() or same[middle].mean() < SAME:
            break
        group *= 2
    return group


def _served(
    group: NDArray[np.int64], stamp: NDArray[np.int64], number: NDArray[np.int64]
) -> tuple[Floats, NDArray[np.int64]]:
    """Time of each group that was served, and the number of events of its fullest row."""
    begin = np.flatnonzero(np.r_[True, (np.diff(group) != 0) | (np.diff(stamp) != 0)])
    return stamp[begin].astype(float), np.maximum.reduceat(number, begin)


def _least_squares(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    inverse = np.linalg.inv(a.T @ a)
    found = inverse @ a.T @ b
    misses = b - a @ found
    return found, inverse * max(ROUNDED_US**2, float(misses @ misses) / len(b))
