"""Events of equal lengths of time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._errors import bad_input
from ..events import EVENT_DTYPE, EventReader

MOST_WINDOWS = 1_000_000  # pictures of a video


@dataclass(frozen=True)
class Window:
    """Events with begin_us <= t < end_us."""

    begin_us: float
    end_us: float
    events: NDArray[np.void]


def windows(reader: EventReader, length_us: float, after_us: float = 0.0) -> Iterator[Window]:
    """Consecutive windows, empty ones too, from the first event to the window of the last event; one of them begins
    after_us after the first event. Raises PecsInputError for more than `MOST_WINDOWS`."""
    kept: list[NDArray[np.void]] = []
    begin_us, number, last_us = None, 0, np.iinfo(np.int64).min
    for block in reader:
        events = np.asarray(block)
        if events["t"][0] < last_us or (np.diff(events["t"]) < 0).any():
            raise bad_input(
                "times", "", "an event earlier than one before it", "the order of time (pecs convert --late sort)"
            )
        last_us = events["t"][-1]
        if begin_us is None:
            begin_us = float(events["t"][0]) + after_us - length_us * math.ceil(after_us / length_us)
        if (count := (float(events["t"][-1]) - begin_us) / length_us) > MOST_WINDOWS:
            got = f"{count:.4g} windows of {length_us:g} us to the event at {events['t'][-1]} us"
            raise bad_input("times", "", got, f"at most {MOST_WINDOWS} (--fps, or a part of the recording)")
        while events["t"][-1] >= (end_us := begin_us + (number + 1) * length_us):
            cut = int(np.searchsorted(events["t"], end_us))
            yield Window(begin_us + number * length_us, end_us, np.concatenate([*kept, events[:cut]]))
            kept, events, number = [], events[cut:], number + 1
        kept.append(events.copy())
    if begin_us is not None:
        begin_us += number * length_us
        yield Window(begin_us, begin_us + length_us, np.concatenate([np.empty(0, EVENT_DTYPE), *kept]))
