"""Python commands: run, and ended with an exit code and an error of one line (docs/reference/exit_codes.md)."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable
from typing import NoReturn

from ._arguments import Parser, account
from ._errors import ExitCode, PecsError, one_line


def answer(parser: Parser, run: Callable[[argparse.Namespace], None], argv: list[str]) -> int:
    """Runs a command and returns its exit code."""
    signal.signal(signal.SIGTERM, _terminated)
    begin = time.monotonic()
    try:
        args = parser.parse_args(argv)
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


def _terminated(number: int, frame: object) -> NoReturn:
    raise SystemExit(ExitCode.TERMINATED)
