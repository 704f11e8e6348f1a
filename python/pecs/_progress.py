"""Progress on stderr: one line that rewrites itself on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time


class Line:
    """Texts of progress. On a terminal each replaces the one before; elsewhere every `every`th is a line.
    quiet: prints nothing. verbose: prints every text as a line."""

    def __init__(self, every: int = 1, *, quiet: bool = False, verbose: bool = False):
        self._every, self._quiet = 1 if verbose else every, quiet
        self._terminal = sys.stderr.isatty() and not verbose and not quiet

    def __call__(self, text: str, number: int = 0) -> None:
        if self._quiet:
            return
        if self._terminal:
            print(f"\r{text}\033[K", end="", file=sys.stderr, flush=True)
        elif number % self._every == 0:
            print(text, file=sys.stderr, flush=True)

    def note(self, text: str) -> None:
        """A message that is neither progress nor an error."""
        if not self._quiet:
            print(text, file=sys.stderr)

    def end(self) -> None:
        """Leaves the line that rewrites itself."""
        if self._terminal:
            print(file=sys.stderr, flush=True)


class Progress:
    """Steps of a known number: "TASK: DONE/TOTAL, N s left", off a terminal once per 5 %; `verbose`: each step."""

    def __init__(self, task: str, total: int, done: int = 0, *, quiet: bool = False, verbose: bool = False):
        self._task, self._total, self._first = task, total, done
        self._start = time.monotonic()
        self._line, self._each_step = Line(quiet=quiet, verbose=verbose), verbose or sys.stderr.isatty()
        self._printed = -1
        if done:
            self._line.note(f"{task}: {done} of {total} exist already")

    def at(self, done: int) -> None:
        left_s = (time.monotonic() - self._start) / (done - self._first) * (self._total - done)
        if (step := done if self._each_step else 20 * done // self._total) > self._printed:
            self._printed = step
            self._line(f"{self._task}: {done}/{self._total}, {left_s:.0f} s left")
        if done == self._total:
            self._line.end()
