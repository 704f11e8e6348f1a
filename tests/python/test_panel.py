"""The panel as a person uses it (panel_acts.py), in bpy."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("pecs")


def act(root, tmp_path, name):
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user"), "BROWSER": "true"}
    command = [sys.executable, root / "tests/python/panel_acts.py", name, tmp_path]
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, env=environment)


@pytest.mark.parametrize("name", ["line", "wrong", "busy", "registered", "saved", "presets"])
def test_panel(root, tmp_path, name):
    result = act(root, tmp_path, name)
    assert "all well" in result.stdout, (result.stdout + result.stderr)[-3000:]


def test_no_orphan(root, tmp_path):
    """A job ends when its Blender is killed."""
    assert act(root, tmp_path, "killed").returncode == -9
    pid = int((tmp_path / "pid").read_text())
    for _ in range(600):
        if not Path(f"/proc/{pid}").exists() or "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text():
            return
        time.sleep(0.1)
    raise AssertionError(f"{pid} still runs")
