"""The panel as a person uses it (support/panel_acts.py), in bpy."""

import os
import time
from pathlib import Path

import pytest
from support import in_bpy


def act(tmp_path, name):
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user"), "BROWSER": "true"}
    body = "import sys\nfrom support import panel_acts\npanel_acts.main(*sys.argv[1:])"
    return in_bpy(body, name, tmp_path, check=name != "killed", env=environment)


@pytest.mark.parametrize("name", ["line", "cube", "wrong", "busy", "registered", "saved", "presets", "widths"])
def test_panel(tmp_path, name):
    act(tmp_path, name)


def test_no_orphan(tmp_path):
    """A job ends when its Blender is killed."""
    assert act(tmp_path, "killed").returncode == -9
    pid = int((tmp_path / "pid").read_text())
    for _ in range(600):
        if not Path(f"/proc/{pid}").exists() or "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text():
            return
        time.sleep(0.1)
    raise AssertionError(f"{pid} still runs")
