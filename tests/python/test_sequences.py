"""The lab's six sequences: files that their scenes take, steps below a pixel, events from one command."""

import importlib.util
import math
import subprocess
import sys

import pytest

PX_PER_MM = 82.6 / 41.7  # on the target, of 1280 pixels (scenes/board)


@pytest.fixture(scope="module")
def sequences(root):
    spec = importlib.util.spec_from_file_location("sequences", root / "scripts/sequences.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["sequences"] = module  # dataclasses look it up
    spec.loader.exec_module(module)
    return module


def test_all_are_there_and_fit_their_scenes(sequences):
    from pecs_blender.core.scene_file import load_scene

    assert sequences.names() == ["R_360_H", "R_360_L", "R_60_H", "T_0.6_H", "T_1_H", "T_1_L"]
    for name in sequences.names():
        s = sequences.load(name)
        scene = load_scene(s.scene, [f"{k}={v}" for k, v in s.parameters.items()])
        assert set(s.parameters) == set(scene.parameters), name  # nothing is left to a default that may move


@pytest.mark.parametrize("coarser", [1, 2, 4, 8])
def test_edges_move_less_than_a_pixel(sequences, coarser):
    for name in sequences.names():
        s = sequences.load(name)
        if "rpm" in s.parameters:
            mm_per_s = 2 * math.pi * s.parameters["disk_radius_mm"] * s.parameters["rpm"] / 60
        else:
            mm_per_s = 1000 * s.parameters["speed_m_per_s"]
        options = dict(word[2:].split("=", 1) for word in sequences.render_arguments(s, coarser, None))
        assert mm_per_s * PX_PER_MM / coarser / float(options["fps"]) < 1, name
        assert int(options["width"]) == 1280 // coarser


@pytest.mark.parametrize("name", ["R_360_H", "T_1_L"])
def test_one_command_gives_events(root, tmp_path, name):
    import pecs

    command = [sys.executable, root / "scripts/sequences.py", name, "-o", tmp_path, "--coarser", 8, "--frames", 8]
    command += ["--", "--samples", 1, "--bands", 1]
    result = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    events = pecs.read(tmp_path / name / "events.raw")
    assert len(events) > 100 and events["x"].max() < 160
