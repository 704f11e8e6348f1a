"""Child processes that end with their parent.

`subprocess.Popen(mortal(command))`: the child gets SIGTERM when the thread that started it ends, also by SIGKILL of its
process. The child sets its own death signal (Linux, prctl(2); exec keeps it): `preexec_fn` may deadlock in a process
with threads, and Blender always has some.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence

PR_SET_PDEATHSIG = 1


def mortal(command: Sequence[str | os.PathLike[str]]) -> list[str]:
    """The command line of a process that sets its death signal and becomes `command`."""
    return [sys.executable, "-IS", os.path.abspath(__file__), str(os.getpid()), *map(os.fspath, command)]


def _become(parent: int, command: list[str]) -> None:
    import ctypes  # only the child needs it

    libc = ctypes.CDLL(None)
    if hasattr(libc, "prctl"):
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # ended before prctl
        sys.exit(128 + signal.SIGTERM)
    try:
        os.execvp(command[0], command)
    except OSError as e:
        print(f"pecs: {command[0]}: {e.strerror}", file=sys.stderr)
        sys.exit(3)  # docs/reference/exit_codes.md


if __name__ == "__main__":
    _become(int(sys.argv[1]), sys.argv[2:])
