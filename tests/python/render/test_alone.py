"""Layers without light (`--no-light`): as those with light; read by the library, refused by the sensor."""

import json

import numpy as np
import pecs
import pytest
from support import contents, make_blends, pecs_blender

ARGS = ("--frames", 3, "--fps", 1, "--bands", 1, "--layers", "depth,motion", "--no-light")


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    return make_blends("motion", tmp_path_factory.mktemp("alone"), "rigid")


@pytest.fixture(scope="module")
def whole(blends):
    pecs_blender("render", blends / "rigid.blend", "-o", blends / "s", *ARGS)
    return blends / "s"


def test_layers_are_as_beside_light(blends, whole, tmp_path):
    names = [f"depth_{i:06d}.exr" for i in range(3)] + [f"motion_{i:06d}.exr" for i in range(2)]
    assert sorted(contents(whole)) == [*names, "stack.json"]
    assert json.loads((whole / "stack.json").read_text())["light"] is False
    pecs_blender("render", blends / "rigid.blend", "-o", tmp_path / "s", *ARGS[:-1], "--samples", 1)
    assert {n: b for n, b in contents(tmp_path / "s").items() if n in names} == {n: contents(whole)[n] for n in names}


def test_it_is_read(whole, pecs_program):
    with pecs.StackReader(whole) as stack:
        assert stack.info["frames"] == 3
        assert np.isfinite(stack.read_layer("depth", 2)).any() and np.isfinite(stack.read_layer("motion", 1)).any()
        with pytest.raises(pecs.PecsInputError, match="light: got layers alone, wanted a stack with light"):
            stack.read_frame(0)
    sense = "sense", whole, "-o", whole.parent / "x.raw", "--fnumber", 4
    for command in (sense, ("render-preview", whole, "-o", whole.parent / "x.png")):
        result = pecs_program(*command)
        assert result.returncode == 4 and "wanted a stack with light" in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
    result = pecs_program("info", whole)
    assert result.returncode == 0 and "depth" in result.stdout and "motion" in result.stdout


def test_the_plan_counts_layers_alone(blends, tmp_path):
    result = pecs_blender("render", blends / "rigid.blend", "-o", tmp_path / "s", *ARGS, "--plan")
    assert result.stderr.startswith("render: 3 instants, ") and not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    "args, line",
    [
        (("--no-light",), "--no-light requires --layers"),
        (
            ("--no-light", "--layers", "depth", "--time", "adaptive"),
            "--time adaptive cannot be combined",
        ),
        (
            ("--no-light", "--layers", "depth", "--noise-events", 0.1),
            "--noise-events requires --time adaptive",
        ),
    ],
)
def test_what_needs_light_is_one_line(blends, tmp_path, args, line):
    result = pecs_blender("render", blends / "rigid.blend", "-o", tmp_path / "s", *args, check=False)
    assert result.returncode == 2 and line in result.stderr and len(result.stderr.splitlines()) == 1
