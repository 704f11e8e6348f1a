#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Traces of the frames' times in an event file: lines in the spectrum of the event rate, and bursts at frames.

    scripts/studies/event_lines.py EVENTS [--frames STACK] [--begin US] [--from-hz HZ]

Prints JSON. `line`: the strongest line of the spectrum (rate in bins of 1/8 ms, from --from-hz on) in multiples
of the level of Poisson events; `of_poisson` is what their strongest line would be in so many bins. With --frames, for
keyframes and for frames between them: events in the half millisecond after to those before, and the standard error of
that ratio. --begin: time of the stack's first frame in the file. Take a scene whose light has no periods of its own.
"""

from pathlib import Path

import numpy as np
import pecs
from numpy.typing import NDArray
from pecs.stack import StackReader
from pecs_lab.measure import command

BIN_US = 125
SIDE_US = 500


def strongest_line(t_us: NDArray[np.float64], from_hz: float) -> dict[str, float]:
    rate = np.bincount(((t_us - t_us.min()) // BIN_US).astype(np.int64))
    power = np.abs(np.fft.rfft(rate - rate.mean())) ** 2 / rate.sum()
    hz = np.fft.rfftfreq(len(rate), BIN_US * 1e-6)
    counted = np.flatnonzero(hz >= from_hz)
    if not len(counted):
        raise SystemExit(f"event_lines: got {len(rate)} bins of {BIN_US} us, wanted frequencies from {from_hz} Hz on")
    line = counted[power[counted].argmax()]
    return {"hz": hz[line], "times_poisson": power[line], "of_poisson": np.log(len(counted)) + np.euler_gamma}


def bursts(t_us: NDArray[np.float64], at_us: NDArray[np.float64]) -> dict[str, float | int | None]:
    at_us = at_us[(at_us - SIDE_US >= t_us.min()) & (at_us + SIDE_US <= t_us.max())]
    edges = np.searchsorted(t_us, at_us[:, None] + [-SIDE_US, 0, SIDE_US])
    before, after = (int(n) for n in np.diff(edges, axis=1).sum(0))
    if not before or not after:
        return {"count": len(at_us), "after_to_before": None, "standard_error": None}
    ratio = after / before
    return {"count": len(at_us), "after_to_before": ratio, "standard_error": ratio * (1 / before + 1 / after) ** 0.5}


def main(events: Path, *, frames: Path | None = None, begin: float = 0.0, from_hz: float = 150.0) -> dict:
    t_us = np.sort(pecs.read(events)["t"]).astype(float)
    if not len(t_us):
        raise SystemExit(f"event_lines: {events}: got no events, wanted some")
    found: dict[str, object] = {"events": len(t_us), "line": strongest_line(t_us, from_hz)}
    if frames:
        stack = StackReader(frames)
        times_ns = np.array(stack.info["times_ns"], float)
        between = np.array([t for k in range(len(times_ns) - 1) for t in stack.between_ns(k)], float)
        for name, ns in (("keyframes", times_ns), ("between", between)):
            found[name] = bursts(t_us, (ns - times_ns[0]) * 1e-3 + begin)
    return found


if __name__ == "__main__":
    command(main)
