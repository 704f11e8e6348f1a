"""Exit codes (docs/reference/exit_codes.md) and errors: one line each, `FILE: PLACE: what is wrong and what to do`."""

from __future__ import annotations

import importlib
import json
import re
import sys
from enum import IntEnum
from pathlib import Path
from typing import Any


class ExitCode(IntEnum):
    OK = 0
    INTERNAL = 1  # a defect of PECS
    USAGE = 2  # the command line is wrong
    NOT_FOUND = 3  # an input is missing or cannot be opened
    BAD_INPUT = 4  # an input was read and is wrong
    BAD_OUTPUT = 5  # an output cannot be written, exists and differs, or is in use
    UNSUPPORTED = 6  # valid, but this build or version cannot do it
    NO_MEMORY = 7
    INTERRUPTED = 130  # SIGINT; finished results are kept
    TERMINATED = 143  # SIGTERM; as above


class PecsError(RuntimeError):
    """An error of one line, with one of the program's exit codes in `code` (docs/reference/exit_codes.md).

    Its kinds are also Python's own: `PecsNotFoundError` is a FileNotFoundError, `PecsInputError` a ValueError,
    `PecsOutputError` an OSError.
    """

    code: int = ExitCode.INTERNAL

    def __init__(self, message: str, code: int | None = None):
        super().__init__(message)
        self.code = int(self.code if code is None else code)

    def __reduce__(self) -> tuple[type[PecsError], tuple[str, int]]:
        return type(self), (str(self), self.code)


class PecsNotFoundError(PecsError, FileNotFoundError):
    """An input is missing or cannot be opened."""

    code = ExitCode.NOT_FOUND


class PecsInputError(PecsError, ValueError):
    """An argument or the content of an input is wrong."""

    code = ExitCode.BAD_INPUT


class UsageError(PecsInputError):
    """Arguments or options that are wrong or exclude each other."""

    code = ExitCode.USAGE


class PecsOutputError(PecsError, OSError):
    """An output cannot be written: no permission, disk full, exists and differs."""

    code = ExitCode.BAD_OUTPUT


KINDS: dict[int, type[PecsError]] = {
    ExitCode.USAGE: PecsInputError,
    ExitCode.NOT_FOUND: PecsNotFoundError,
    ExitCode.BAD_INPUT: PecsInputError,
    ExitCode.BAD_OUTPUT: PecsOutputError,
}


def shown(value: Any) -> str:
    """A value in an error message, as JSON and cut off after 60 characters."""
    return _cut(json.dumps(value, default=str))


def _cut(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def bad_input(file: object, place: str, got: object, wanted: str) -> PecsInputError:
    """ "FILE: PLACE: got X, wanted Y"; a text `got` is printed as it is, any other value as JSON."""
    text = _cut(got) if isinstance(got, str) else shown(got)
    return PecsInputError(": ".join(filter(None, (str(file), place, f"got {text}, wanted {wanted}"))))


def one_line(message: str) -> str:
    """The message with control characters as \\xNN, as the program prints them."""
    return re.sub(r"[\x00-\x1f\x7f]", lambda found: f"\\x{ord(found[0]):02x}", message)


def existing(path: Path, what: str) -> Path:
    """The path. Raises PecsNotFoundError if there is no such file or folder."""
    if not path.exists():
        raise PecsNotFoundError(f"{path}: no such file or folder, wanted {what}")
    return path


def missing_package(error: ImportError) -> PecsError:
    """The error of a command whose Python lacks a package. Raises `error` if a module of PECS itself is wrong."""
    package = (error.name or "").partition(".")[0]
    if package == "pecs":
        raise error
    why = str(error)
    if isinstance(error, ModuleNotFoundError) and package:
        install = f"{sys.executable} -m pip install {package.replace('_', '-')}"
        why = f"the package {package} is missing; run {install}, or set PECS_PYTHON to a Python that has it"
    return PecsError(f"{sys.executable}: {why}", ExitCode.UNSUPPORTED)


def optional_module(name: str, package: str, task: str, extra: str = "datasets") -> Any:
    """An imported module of the optional dependencies."""
    try:
        return importlib.import_module(name)
    except ImportError as e:
        checkout = Path(__file__).parents[2] / "scripts/setup.sh"
        command = (
            f"{checkout} --with {extra}" if checkout.is_file() else f"pip install 'FILE[{extra}]', FILE: PECS's wheel"
        )
        raise PecsError(f"{task} requires {package} ({command}): {e}", ExitCode.UNSUPPORTED) from None
