# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress on stderr: one line that rewrites itself on a terminal, a plain line every twentieth otherwise; quiet: none;
verbose: a plain line for each step."""

import sys
import time


class Progress:
    def __init__(self, what: str, total: int, done: int = 0, *, quiet: bool = False, verbose: bool = False):
        self._what, self._total, self._first = what, total, done
        self._start = time.monotonic()
        self._quiet, self._verbose = quiet, verbose
        self._terminal = sys.stderr.isatty() and not verbose
        self._shown = -1
        if done and not quiet:
            print(f"{what}: {done} of {total} are there already", file=sys.stderr)

    def at(self, done: int) -> None:
        if self._quiet:
            return
        fresh = done - self._first
        left_s = (time.monotonic() - self._start) / fresh * (self._total - done)
        text = f"{self._what}: {done}/{self._total}, {left_s:.0f} s left"
        if self._terminal:
            print(f"\r{text}\033[K", end="\n" if done == self._total else "", file=sys.stderr, flush=True)
        elif self._verbose:
            print(text, file=sys.stderr, flush=True)
        elif (step := 20 * done // self._total) > self._shown:
            self._shown = step
            print(text, file=sys.stderr, flush=True)
