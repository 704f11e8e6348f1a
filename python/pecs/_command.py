"""Python commands: run, and ended with an exit code and an error of one line (docs/reference/exit_codes.md). The
program starts each by `python -m pecs._command MODULE …`."""

from __future__ import annotations

import argparse
import os
import runpy
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pecs import _platform
from pecs._arguments import Parser, account
from pecs._errors import ExitCode, PecsError, missing_package, one_line

GRACE_S = 10.0  # for what a command does when it is stopped


def answer(parser: Parser, run: Callable[[argparse.Namespace], None], argv: list[str]) -> int:
    """Runs a command and returns its exit code."""
    _platform.exit_when_terminated()
    for stream in (sys.stdout, sys.stderr):  # as the program writes them
        stream.reconfigure(encoding="utf-8", errors=stream.errors)
    begin = time.monotonic()
    try:
        args = parser.parse_args(argv)
        with _ended_by_signals(), warnings.catch_warnings():
            warnings.showwarning = _print_warning
            if args.quiet:
                warnings.simplefilter("ignore", UserWarning)
            run(args)
        if args.verbose:
            name = getattr(args, "command", parser.prog.removeprefix("pecs "))
            sys.stderr.write(account(name, vars(args), time.monotonic() - begin))
    except SystemExit as e:  # --help, SIGTERM
        return int(e.code or 0)
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED
    except PecsError as e:
        print(f"pecs: {one_line(str(e))}", file=sys.stderr)
        return e.code
    except MemoryError as e:
        print(f"pecs: not enough memory: {one_line(str(e)) or 'the system gave none'}", file=sys.stderr)
        return ExitCode.NO_MEMORY
    except OSError as e:
        print(f"pecs: {one_line(str(e.filename or 'standard output'))}: {e.strerror}", file=sys.stderr)
        return ExitCode.BAD_OUTPUT
    return 0


def _print_warning(message: Warning | str, *_place: object) -> None:
    print(f"pecs: warning: {one_line(str(message))}", file=sys.stderr)


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Python handles a signal when it runs again. If a library, such as a network with an endless loop, does not return
    within GRACE_S, a thread ends the process."""
    over = threading.Event()
    end = _platform.watch_stops(lambda number: over.wait(GRACE_S) or os._exit(128 + number))
    try:
        yield
    finally:
        over.set()
        end()


def start(module: str) -> None:
    """As `python -m MODULE`; a package that this Python lacks is an error of one line."""
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except ImportError as e:
        error = missing_package(e)
        print(f"pecs: {one_line(str(error))}", file=sys.stderr)
        sys.exit(error.code)


if __name__ == "__main__":
    del sys.argv[0]
    start(sys.argv[0])
