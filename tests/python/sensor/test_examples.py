"""Examples with programs that are not installed everywhere."""

import os
import subprocess
import sys

import pecs
import pytest
from support import ROOT


def test_mujoco_camera(tmp_path):
    pytest.importorskip("mujoco", reason="needs MuJoCo: pip install mujoco")
    env = os.environ | {"MUJOCO_GL": "egl"}
    ready = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8)"
    if subprocess.run([sys.executable, "-c", ready], env=env, capture_output=True).returncode:
        pytest.skip("needs EGL that renders without a window")
    script, out = ROOT / "examples/mujoco_camera/mujoco_camera.py", tmp_path / "robot.raw"
    said = subprocess.run([sys.executable, script, out], env=env, capture_output=True, text=True, check=True).stdout
    events = pecs.read(out)
    assert said.startswith(f"{out}: {len(events)} events from ") and 80_000 < len(events) < 140_000
    assert 20 < int(said.partition(" events from ")[2].split()[0]) < 40


def test_pybullet_hand(tmp_path):
    pytest.importorskip("pybullet", reason="needs PyBullet: pip install pybullet")
    script, out = ROOT / "examples/pybullet_hand/pybullet_hand.py", tmp_path / "hand.raw"
    said = subprocess.run([sys.executable, script, out], capture_output=True, text=True, check=True).stdout
    assert f"{out}: {len(pecs.read(out))} events from 356 frames" in said and 50_000 < len(pecs.read(out)) < 80_000
