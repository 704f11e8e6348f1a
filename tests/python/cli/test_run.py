"""From a scene to events in one command, and the program's verbs from Blender's command line."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pecs
import pytest
from support import growing_pecs_blender, make_blends, pecs_blender

SMALL = ("--bands", 1, "--samples", 1, "--fps", 1000, "--width", 24, "--frames", 4)


@pytest.fixture(scope="module")
def blend(root, tmp_path_factory):
    return make_blends("files", tmp_path_factory.mktemp("run"), "emission") / "emission.blend"


@pytest.fixture(scope="module")
def stack(blend):
    pecs_blender("render", blend, "-o", blend.parent / "s.stack", *SMALL)
    return blend.parent / "s.stack"


@pytest.fixture(scope="module")
def events(blend):
    """With other noise than --seed 1."""
    path = blend.parent / "events.csv"
    pecs_blender("run", blend, "-o", path, *SMALL, "--sense", "--seed", 2, "--set", "background_on_hz=100")
    return path


def test_run_is_render_and_sense(blend, events, tmp_path):
    stack = events.with_suffix(".stack")
    info = json.loads((stack / "stack.json").read_text())
    assert info["quantity"] == "radiance" and info["fnumber"] == 2.8  # of Blender's new cameras
    words = ("--seed", 2, "--set", "background_on_hz=100")
    pecs_blender("sense", stack, "-o", tmp_path / "e.csv", *words)  # without --fnumber
    assert len(pecs.read(tmp_path / "e.csv")) > 0
    assert (tmp_path / "e.csv").read_bytes() == events.read_bytes()
    half = pecs_blender("sense", stack, "-o", tmp_path / "f.csv", *words, "--fnumber", 5.6, "--json")
    record = json.loads((tmp_path / "f.csv.run.json").read_text())
    assert record["config"]["fnumber"] == 5.6 and half.stdout
    light = np.array([r["results"]["photocurrent_a"]["median"] for r in (record, _record(events))])
    assert light[0] == pytest.approx(light[1] / 4, rel=1e-5)  # twice the f-number


def _record(path):
    return json.loads(path.with_name(path.name + ".run.json").read_text())


def test_the_program_runs_it_too(blend, events, tmp_path, pecs_program):
    environment = os.environ | {"PECS_BLENDER_PYTHON": sys.executable}
    words = ("-o", tmp_path / "e.csv", "--stack", tmp_path / "s", *SMALL)
    sense = ("--sense", "--seed", 2, "--set", "background_on_hz=100")
    pecs_program("run", blend, *words, *sense, env=environment, check=True)
    assert (tmp_path / "e.csv").read_bytes() == events.read_bytes() and (tmp_path / "s/stack.json").is_file()
    environment["PECS_BLENDER_PYTHON"] = "/nonexistent/python"
    result = pecs_program("run", blend, *words, env=environment)
    assert result.returncode == 3
    assert result.stderr.startswith("pecs: run: /nonexistent/python: No such file") and result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "part"), [(("--only", "0:2"), "--only"), (("--no-light", "--layers", "depth"), "--no")]
)
def test_run_wants_a_whole_stack(blend, tmp_path, words, part):
    result = pecs_blender("run", blend, "-o", tmp_path / "e.raw", *SMALL, *words, check=False)
    assert result.returncode == 2 and result.stderr.startswith(f"pecs: run: {part}"), result.stderr


def test_verbs_of_the_program(events, pecs_program):
    for words in (("info", events), ("info", "nothing.raw"), ("compare", events, events), ("view", "--help")):
        ours, theirs = pecs_blender(*words, check=False), pecs_program(*words)
        assert (ours.returncode, ours.stdout, ours.stderr) == (theirs.returncode, theirs.stdout, theirs.stderr)


def test_a_data_set_needs_a_python(tmp_path):
    environment = os.environ | {"PECS_PYTHON": "/bin/false"}
    command = [sys.executable, "-m", "pecs_blender", "dataset", "recipe.toml"]
    result = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert result.returncode == 3 and result.stderr.count("\n") == 1 and "requires a Python" in result.stderr


def test_versions_of_a_stack(blend, stack, tmp_path):
    """Where settings differ, the next name that is free; where they do not, the stack is continued."""
    shutil.copytree(stack, tmp_path / "s.stack")

    def render(*words):
        return pecs_blender("render", blend, "-o", tmp_path / "s.stack", *SMALL, *words, check=False)

    refused = render("--seed", 2)
    assert refused.returncode == 5 and "--new-version writes one with the next free name" in refused.stderr
    for _ in range(2):  # the second time it is there already
        assert render("--seed", 2, "--new-version").stderr.endswith(f"render: into {tmp_path / 's_002.stack'}\n")
    assert "into" not in render("--new-version").stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s.stack", "s_002.stack"]
    assert render("--overwrite", "--new-version").returncode == 2
    (tmp_path / "file").write_text("")
    result = pecs_blender("render", blend, "-o", tmp_path / "file/s", *SMALL, "--new-version", check=False)
    assert result.returncode == 5, result.stderr


def test_a_process_that_grows_does_not_overwrite_itself(blend, stack, tmp_path):
    shutil.copytree(stack, tmp_path / "s")
    result = growing_pecs_blender("render", blend, "-o", tmp_path / "s", *SMALL, "--seed", 2, "--overwrite")
    assert "1 of 4 exist already" in result.stderr
