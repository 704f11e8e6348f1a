# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m pecs_blender …, and the same after `--` for `blender --background --python`."""

import os
import sys
from pathlib import Path

# Before NumPy is imported: a call for a small matrix would wake threads that wait actively for 0.1 s.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if __package__ in (None, ""):  # blender --background --python …/__main__.py -- render …
    here = Path(__file__).resolve().parent
    sys.path[:0] = [str(here.parent), str(here.parents[1] / "python")]

from pecs import _platform

from pecs_blender import stop
from pecs_blender.cli import main

if __name__ == "__main__":
    _platform.open_standard_descriptors()
    code = main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
    if "bpy" in sys.modules:  # its own exit may hang, or report leaked memory
        stop.clean_up()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
