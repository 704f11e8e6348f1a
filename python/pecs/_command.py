"""Commands that are Python: exit codes (docs/reference/exit_codes.md), errors of one line, a line that says how far it
is."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable
from typing import NoReturn

from . import _arguments
from ._library import PecsError

USAGE, NOT_FOUND, BAD_OUTPUT, INTERRUPTED, TERMINATED = 2, 3, 5, 130, 143


class Parser(_arguments.Parser):
    """Whose errors are one line, "COMMAND: …"."""

    def error(self, message: str) -> NoReturn:
        message = _arguments.said(message)
        command = self.prog.removeprefix("pecs").strip()
        raise PecsError(f"{command}: {message}" if command else message, USAGE)


def answer(parser: Parser, run: Callable[[argparse.Namespace], None], argv: list[str]) -> int:
    """Runs a command; its exit code."""
    signal.signal(signal.SIGTERM, _terminated)
    begin = time.monotonic()
    try:
        args = parser.parse_args(argv)
        run(args)
        if args.verbose:
            name = getattr(args, "command", parser.prog.removeprefix("pecs "))
            sys.stderr.write(_arguments.account(name, vars(args), time.monotonic() - begin))
    except SystemExit as e:  # --help, SIGTERM
        return int(e.code or 0)
    except KeyboardInterrupt:
        return INTERRUPTED
    except PecsError as e:
        print(f"pecs: {e}", file=sys.stderr)
        return e.code
    except OSError as e:
        print(f"pecs: {e.filename or 'standard output'}: {e.strerror}", file=sys.stderr)
        return BAD_OUTPUT
    return 0


def _terminated(number: int, frame: object) -> NoReturn:
    raise SystemExit(TERMINATED)


class Line:
    """Progress: one line that rewrites itself on a terminal; otherwise a line of each `every`th text. quiet: none.
    verbose: a line of each text."""

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
        """What is neither progress nor an error."""
        if not self._quiet:
            print(text, file=sys.stderr)

    def end(self) -> None:
        if self._terminal:
            print(file=sys.stderr, flush=True)
