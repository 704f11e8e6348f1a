"""The `pecs` program that belongs to this package; `pecs` and `python -m pecs` run it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ._errors import ExitCode, PecsNotFoundError, one_line
from ._platform import become, program_file


def program() -> Path:
    """The program `pecs`: that of PECS_PROGRAM, of the wheel, or of the checkout. Raises PecsNotFoundError if there is
    none."""
    if named := os.environ.get("PECS_PROGRAM"):
        if not Path(named).is_file():
            raise PecsNotFoundError(f"PECS_PROGRAM: {named}: no such file")
        return Path(named)
    here = Path(__file__).resolve().parent
    file = program_file("pecs")
    tried = [here / "_lib" / "bin" / file]
    tried += [here.parent.parent / "build" / preset / "bin" / file for preset in ("release", "dev")]
    for path in tried:
        if path.is_file():
            if not os.access(path, os.X_OK):  # Blender's installer unpacks wheels without their modes
                path.chmod(0o755)
            return path
    raise PecsNotFoundError("no pecs program; looked at " + ", ".join(map(str, tried)) + "; PECS_PROGRAM names one")


def main() -> None:
    """Becomes the program, which gets this process's arguments and this Python (`pecs dataset`)."""
    try:
        path = program()
        os.environ.setdefault("PECS_PYTHON", sys.executable)
        become([os.path.abspath(path), *sys.argv[1:]])
    except OSError as e:
        words = str(e) if isinstance(e, PecsNotFoundError) else f"{path}: {e.strerror}"
        print(f"pecs: {one_line(words)}", file=sys.stderr)
        sys.exit(ExitCode.NOT_FOUND)
