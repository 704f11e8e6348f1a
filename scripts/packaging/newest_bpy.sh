#!/usr/bin/env bash
# Runs the tests of renderer and panel with the newest Blender of PyPI that this Python can have (5.0: CPython 3.11; 5.1
# and later: 3.13), in an environment of its own (.venv-newest); the rest stays as scripts/setup.sh made it.
#   scripts/packaging/newest_bpy.sh [PYTHON [OPTIONS of pytest]]    PYTHON: python3 if not given
source "$(dirname "$0")/../lib.sh"
PYTHON=${1:-python3}
NEWEST="$ROOT/.venv-newest/bin/python"
[ -e "$ROOT/build/release/lib/libpecs.so" ] || die "newest_bpy.sh: build/release: got no library, wanted one: scripts/setup.sh" 3

say "Python packages (.venv-newest)"
"$PYTHON" -m venv --clear "$ROOT/.venv-newest"
"$NEWEST" -m pip install --quiet --disable-pip-version-check --upgrade bpy numpy scipy pytest opencv-python-headless h5py matplotlib OpenImageIO colour-science
use_checkout .venv-newest/bin/python
"$NEWEST" -c 'import bpy; print("Blender", bpy.app.version_string)'
say "Tests of the renderer and the panel"
# libpecs of a checkout has the system's oneTBB. bpy 5.2 wants a newer one: its own serves both.
TBB=$(find "$ROOT/.venv-newest" -path '*/bpy/lib/libtbb.so.12' | head -1)
LD_PRELOAD="$TBB" "$NEWEST" -m pytest -q tests/python/render tests/python/panel "${@:2}"
say "done"
