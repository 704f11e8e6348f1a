"""The lab's six sequences: files that their scenes take, steps below a pixel, events from one command."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from pecs_lab import sequences
from support import load_script

PX_PER_MM = 82.6 / 41.7  # on the target, of 1280 pixels (scenes/board)


def test_all_are_there_and_fit_their_scenes():
    from pecs_blender.scene.scene_file import load_scene

    assert sequences.names() == ["R_360_H", "R_360_L", "R_60_H", "T_0.6_H", "T_1_H", "T_1_L"]
    for name in sequences.names():
        s = sequences.load(name)
        scene = load_scene(s.scene, [f"@{s.scene}/sequences/{name}.json"])
        assert s.parameters == scene.parameters, name  # nothing is left to a default that may move


@pytest.mark.parametrize("coarser", [1, 2, 4, 8])
def test_edges_move_less_than_a_pixel(coarser):
    for name in sequences.names():
        s = sequences.load(name)
        if "rpm" in s.parameters:
            mm_per_s = 2 * math.pi * s.parameters["disk_radius_mm"] * s.parameters["rpm"] / 60
        else:
            mm_per_s = 1000 * s.parameters["speed_m_per_s"]
        options = dict(word[2:].split("=", 1) for word in sequences.render_arguments(s, coarser, None))
        assert mm_per_s * PX_PER_MM / coarser / float(options["fps"]) < 1, name
        assert int(options["width"]) == 1280 // coarser


@pytest.fixture(scope="module")
def rendered(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sequences")
    command = [sys.executable, root / "scripts/tools/sequences.py", "R_360_L", "T_1_H", "-o", folder]
    command += ["--coarser", 8, "--frames", 8, "--", "--samples", 1, "--bands", 1]
    result = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return folder


def test_the_lamp_stands_where_the_recordings_light_asks_for_it(rendered):
    """The lamp hangs just above the disk: its white top has half the light of its bottom, as in R_360_L."""
    from pecs.stack import StackReader

    with StackReader(rendered / "R_360_L/stack") as reader:
        light = reader.read_frame(0)[0]
    centre, radius = (957 / 8, 361 / 8), 267 / 8  # of the outermost ring of pecs.delays' regions
    at = {up: (slice(int(centre[1] - up * radius) - 2, int(centre[1] - up * radius) + 3)) for up in (1, -1)}
    top, bottom = (light[at[up], int(centre[0]) - 3 : int(centre[0]) + 4].mean() for up in (1, -1))
    assert 2.3 / 5.0 * 0.8 < top / bottom < 2.3 / 5.0 * 1.2


def test_a_lamp_is_found_from_its_light():
    from pecs_lab import lamp_fit

    angle, radius = np.radians(np.arange(7.5, 360, 15))[:, None], np.array([45.0, 75, 105, 135])
    x, up = 160 + radius * np.cos(angle), radius * np.sin(angle)
    size = {"lamp_length_mm": 800, "lamp_width_mm": 100}
    truth = {"lamp_right_mm": 120, "lamp_up_mm": 260, "lamp_before_mm": 310}
    area = np.broadcast_to(radius, x.shape)
    light = lamp_fit.illuminance(x, up, truth | size, 0.1) * np.exp(np.random.default_rng(1).normal(0, 0.01, x.shape))
    found, rms = lamp_fit.fit(5 * light, x, up, 1.0, area, size, 0.1)
    assert all(found[key] == pytest.approx(value, abs=15) for key, value in truth.items()) and rms < 0.2
    assert found["lamp_length_mm"] == 800


def test_one_command_gives_events(rendered):
    import pecs

    events = pecs.read(rendered / "T_1_H" / "events.raw")
    assert len(events) > 100 and events["x"].max() < 160


def test_table_of_five_models(root, rendered, tmp_path):
    """Against a recording (here one of the models' own: no distance) and, without one, against pecs."""
    import pecs

    table1 = load_script(root / "scripts/studies/table1.py")
    first = table1.sensed(table1.sequences.load("R_360_L"), rendered / "R_360_L", "esim")
    pecs.write(tmp_path / "real.raw", table1.on_the_sensor(first, 8), width=1280, height=720)
    command = [sys.executable, root / "scripts/studies/table1.py", rendered]
    command += ["--real", f"R_360_L={tmp_path}/real.raw"]
    result = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    rows = {(r["sequence"], r["model"]): r for r in json.loads((rendered / "table1.json").read_text())}
    assert len(rows) == 10
    assert rows["R_360_L", "esim"]["chamfer_shared"] == 0 and rows["R_360_L", "esim"]["delay_on_deg"] == 0
    assert rows["R_360_L", "icns"]["chamfer_shared"] > 0
    assert rows["R_360_L", "pecs"]["chamfer_published"] == 3.708
    assert rows["T_1_H", "pecs"]["against"] == "pecs" and "chamfer_shared" not in rows["T_1_H", "pecs"]
    assert rows["T_1_H", "v2e"]["chamfer_paper"] > 0
    assert len((rendered / "table1.md").read_text().splitlines()) == 12
