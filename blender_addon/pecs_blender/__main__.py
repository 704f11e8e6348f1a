# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m pecs_blender …, and the same after `--` for `blender --background --python`."""

import os
import sys
from pathlib import Path

if __package__ in (None, ""):  # blender --background --python …/__main__.py -- render …
    here = Path(__file__).resolve().parent
    sys.path[:0] = [str(here.parent), str(here.parents[1] / "python")]

from pecs_blender import stop
from pecs_blender.cli import main


def open_missing_streams() -> None:
    """Opens standard streams that are closed, so that no other file gets their descriptors."""
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(fd, True)
    os.close(fd)
    for name, fd, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(fd, mode, closefd=False))


if __name__ == "__main__":
    open_missing_streams()
    code = main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
    if "bpy" in sys.modules:  # its own exit may hang, or report leaked memory
        stop.clean_up()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
