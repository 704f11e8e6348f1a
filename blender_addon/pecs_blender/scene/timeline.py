# SPDX-License-Identifier: GPL-3.0-or-later
"""The instants of a stack."""

from __future__ import annotations

from dataclasses import dataclass

from pecs._errors import UsageError

MAX_INSTANTS = 1_000_000  # of a stack


@dataclass(frozen=True)
class Timeline:
    times_ns: list[int]
    period_ns: int | None  # set when the frames cover exactly one period

    @property
    def bounds_ns(self) -> list[int]:
        """Bounds of the intervals between instants; with a period, the last instant also begins an interval."""
        return self.times_ns + ([self.times_ns[0] + self.period_ns] if self.period_ns else [])


@dataclass(frozen=True, kw_only=True)
class Instants:
    """grid: the finest instants. only: the part of the stack's instants to render. step_px: longest motion [sensor
    pixels] between keyframes; None renders every instant. tolerance: of ln(photocurrent) between keyframes."""

    grid: Timeline
    only: slice | None
    step_px: float | None
    tolerance: float


def timeline(frames: str, fps: float, period_s: float | None, duration_s: float | None = None) -> Timeline:
    """frames: "N", "A:B" (instants A ... B-1 of t = i/fps), "A:B,C:D" (several ranges in time's order), "period" (one
    period in equal steps, as near to fps as fits), or "all" (a .blend's frame range). Times are rounded to the
    nanosecond."""
    if frames == "period":
        if period_s is None:
            raise UsageError("--frames period requires a scene that repeats")
        n = _checked(round(period_s * fps))
        return Timeline([round(i * period_s * 1e9 / n) for i in range(n)], round(period_s * 1e9))
    if frames == "all":
        if duration_s is None:
            raise UsageError("--frames all requires a .blend, which has a range of frames")
        return Timeline([round(i * 1e9 / fps) for i in range(_checked(round(duration_s * fps)))], None)
    numbers: list[int] = []
    for part in frames.split(","):
        begin, end = _range(part)
        if not (numbers[-1] if numbers else -1) < begin < end:
            raise UsageError(
                f"--frames: got {frames!r}, wanted N, A:B with A < B, rising ranges A:B,C:D, period, or all"
            )
        _checked(end - begin + len(numbers))
        numbers += range(begin, end)
    return Timeline([round(i * 1e9 / fps) for i in numbers], None)


def _range(text: str) -> tuple[int, int]:
    """The range of "N" or "A:B"; (0, 0) if it is neither."""
    first, colon, last = text.partition(":")
    try:
        return (int(first), int(last)) if colon else (0, int(first))
    except ValueError:
        return 0, 0


def _checked(instants: int) -> int:
    if instants > MAX_INSTANTS:
        raise UsageError(f"--frames: got {instants} instants, wanted at most {MAX_INSTANTS}")
    return max(1, instants)
