"""The extension in Blender's own window. Requires a display, a Blender with a window, and PECS_EXTENSION, the path of
the extension's zip (scripts/packaging/make_extension.py)."""

import os
import shutil
import subprocess

import pytest
from support import ROOT


def test_events_over_the_default_cube_take_at_most_five_clicks(tmp_path):
    extension, blender = os.environ.get("PECS_EXTENSION"), shutil.which("blender")
    if not (extension and blender and os.environ.get("DISPLAY")):
        pytest.skip("requires PECS_EXTENSION (the zip), a Blender with a window, and DISPLAY")
    script = ROOT / "tests/python/support/window_acts.py"
    options = ["--factory-startup", "--enable-event-simulate", "--python", script, "--", extension, tmp_path]
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user")}
    done = subprocess.run([blender, *options], env=environment, capture_output=True, text=True, timeout=600)
    assert (tmp_path / "done").is_file(), (done.stdout + done.stderr)[-2000:]
    print((tmp_path / "done").read_text())  # clicks and time
