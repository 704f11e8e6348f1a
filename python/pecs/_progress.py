"""Progress on stderr: one line that rewrites itself on a terminal, plain lines elsewhere. With PECS_PROGRESS=json in
the environment, JSON lines for the calling program (docs/reference/exit_codes.md)."""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import suppress
from typing import Any

JSON_INTERVAL_S = 0.1  # between JSON lines of one task


def for_a_program() -> bool:
    return os.environ.get("PECS_PROGRESS") == "json"


def report(text: str, **values: Any) -> None:
    """Prints the text or, for a calling program, the values as a JSON line."""
    print(json.dumps(values) if for_a_program() else text, file=sys.stderr, flush=True)


def status_of(line: str) -> dict[str, Any]:
    """The values of a JSON line; empty for a message."""
    with suppress(ValueError, RecursionError):
        values = json.loads(line) if line.startswith("{") else {}
        return values if isinstance(values, dict) else {}
    return {}


class Line:
    """Texts of progress. On a terminal each replaces the one before; elsewhere every `every`th is a line.
    quiet: prints nothing. verbose: prints every text as a line. task: its name in JSON lines."""

    def __init__(self, every: int = 1, *, task: str = "", quiet: bool = False, verbose: bool = False):
        self._every, self._quiet = 1 if verbose else every, quiet
        self._task, self._json, self._json_s = task, for_a_program() and not quiet, 0.0
        self._terminal = sys.stderr.isatty() and not (verbose or quiet or self._json)

    def __call__(self, text: str, number: int = 0, total: int = 0, left_s: float | None = None) -> None:
        """A step. text: empty for a step that only a calling program shows. total: of steps, 0 if unknown."""
        if self._quiet or not (text or self._json):
            return
        if self._json:
            self._print_json(number, total, left_s)
        elif self._terminal:
            print(f"\r{text}\033[K", end="", file=sys.stderr, flush=True)
        elif number % self._every == 0:
            print(text, file=sys.stderr, flush=True)

    def detail(self, text: str) -> None:
        """A text for a terminal only."""
        if self._terminal:
            self(text)

    def _print_json(self, number: int, total: int, left_s: float | None) -> None:
        now_s = time.monotonic()
        if now_s - self._json_s < JSON_INTERVAL_S and number != total:
            return
        self._json_s = now_s
        values: dict[str, Any] = {"progress": self._task, "done": number}
        values |= {"total": total} if total else {}
        values |= {"left_s": round(left_s, 1)} if left_s is not None else {}
        print(json.dumps(values), file=sys.stderr, flush=True)

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
        self._line = Line(task=task, quiet=quiet, verbose=verbose)
        self._each_step = verbose or sys.stderr.isatty() or for_a_program()
        self._printed = -1
        if done:
            self._line.note(f"{task}: {done} of {total} exist already")

    def at(self, done: int) -> None:
        left_s = (time.monotonic() - self._start) / (done - self._first) * (self._total - done)
        if (step := done if self._each_step else 20 * done // self._total) > self._printed:
            self._printed = step
            self._line(f"{self._task}: {done}/{self._total}, {left_s:.0f} s left", done, self._total, left_s)
        if done == self._total:
            self._line.end()
