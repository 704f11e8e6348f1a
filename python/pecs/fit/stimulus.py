"""The protocol that `pecs stimulus` plays on a screen, and its sections in a recording.

A section begins with a long flash and some short ones, whose number identifies it. Grey levels are shares of white
squares, so that the screen's gamma curve has no effect on a camera that sees the whole screen at once. A screen writes
its rows one after the other and its pixels need milliseconds, so nothing here depends on time within a refresh: light
changes slowly, and events are counted."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._files import read_text

REST, REST_S = 1 / 4, 1.0  # light around the flashes, and before and behind a section
# Not multiples of usual refresh periods: flashes last different numbers of refreshes, which shows the period.
MARK_S, FLASH_S = 0.83, 0.21
HOLD_S = 0.1  # between ramps
EFOLD_S = 0.125  # of a ramp: exponential, so that events come evenly
CYCLES = 10
STILL_S = 5.0  # shows whether the screen is pulsed
TOLERANCE_S = 0.07  # of a flash: a few refreshes
REFRESH_HZ = np.arange(24.0, 260.0, 0.02)
ALIKE = 0.9  # length of the mean phase of edges that come with a refresh


@dataclass(frozen=True)
class Section:
    """Constant light at one level, or ramps from the last level to the first, to the second and so on."""

    levels: tuple[float, ...]

    @property
    def ramps_s(self) -> list[float]:
        of = self.levels
        return [EFOLD_S * abs(float(np.log(b / a))) for a, b in zip((of[-1], *of[:-1]), of, strict=True)]

    @property
    def parts(self) -> list[tuple[float, float, float]]:
        """Level at the beginning and at the end, and duration [s]."""
        if len(self.levels) == 1:
            return [(self.levels[0], self.levels[0], STILL_S)]
        before, out = (self.levels[-1], *self.levels[:-1]), []
        for a, b, ramp_s in zip(before, self.levels, self.ramps_s, strict=True):
            out += [(a, a, HOLD_S / 2), (a, b, ramp_s), (b, b, HOLD_S / 2)]
        return CYCLES * out

    @property
    def seconds(self) -> float:
        return sum(part[2] for part in self.parts)


SECTIONS = {6: Section((1.0, 1 / 16, 1.0, REST)), 8: Section((1.0,))}  # by their number of flashes


def timeline() -> list[tuple[float, float, float]]:
    """Level at the beginning and at the end of each part, and its duration [s]; exponential in between."""
    out = []
    for flashes, section in SECTIONS.items():
        out += [(REST, REST, REST_S), (1.0, 1.0, MARK_S)]
        out += flashes * [(REST, REST, FLASH_S), (1.0, 1.0, FLASH_S)]
        out += [(REST, REST, REST_S), *section.parts]
    return [*out, (REST, REST, REST_S)]


def stimulus_page() -> str:
    """The page that `pecs stimulus` writes: HTML, which needs no other file."""
    return read_text(Path(__file__).with_name("stimulus.html"), 1 << 16).replace("TIMELINE", json.dumps(timeline()))


@dataclass(frozen=True)
class Found:
    """A section in a recording."""

    section: Section
    begin_us: float
    flashes: slice  # of all edges, those of the flashes before it


def sections(edges_us: NDArray[np.float64], rises: NDArray[np.bool_]) -> list[Found]:
    """From the times and directions of all edges."""
    out = []
    for i in np.flatnonzero(rises):
        if not _lasts(edges_us, rises, i, MARK_S):
            continue
        last, flashes = i + 1, 0
        while _lasts(edges_us, rises, last, FLASH_S) and _lasts(edges_us, rises, last + 1, FLASH_S):
            last, flashes = last + 2, flashes + 1
        if flashes in SECTIONS:
            out.append(Found(SECTIONS[flashes], float(edges_us[last]) + REST_S * 1e6, slice(i, last + 1)))
    return out


def _lasts(edges_us: NDArray[np.float64], rises: NDArray[np.bool_], i: int, seconds: float) -> bool:
    """Whether the light between edge i and the next one, which goes the other way, lasts so long."""
    if i + 1 >= len(edges_us) or rises[i] == rises[i + 1]:
        return False
    return bool(abs(edges_us[i + 1] - edges_us[i] - 1e6 * seconds) < 1e6 * TOLERANCE_S)


def refresh_hz(times_us: Sequence[NDArray[np.float64]]) -> float | None:
    """The lowest rate with which the times of each kind come at the same phase; None if none has."""
    alike = sum(len(of) * np.abs(np.exp(2e-6j * np.pi * REFRESH_HZ[:, None] * of).mean(axis=1)) for of in times_us)
    alike = alike / sum(map(len, times_us))
    if alike.max() < ALIKE:
        return None
    first = int(np.argmax(alike > 0.995 * alike.max()))  # multiples of it are as good
    peak = slice(first, first + int(0.5 / (REFRESH_HZ[1] - REFRESH_HZ[0])))
    return float(REFRESH_HZ[peak][np.argmax(alike[peak])])
