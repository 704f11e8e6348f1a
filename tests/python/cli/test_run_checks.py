"""`pecs run` reports before the render what `pecs sense` would report after it, and renders the chip's size."""

import json

import pytest
from support import in_bpy, pecs_blender

MAKE = """
import sys
import bpy
bpy.ops.wm.read_factory_settings()
bpy.context.scene.frame_end = 2
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""
COMMON = ("--bands", 1, "--samples", 1, "--fps", 24)
SMALL = (*COMMON, "--width", 32, "--height", 24)
DAVIS = ("--chip", "davis346")


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "cube.blend"
    in_bpy(MAKE, path)
    return path


def run(blend, events, *words, check=False):
    return pecs_blender("run", blend, "-o", events, *words, check=check)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ((*COMMON, *DAVIS, "--width", 640), 4, "size: got 640x360, wanted at most davis346's 346x260"),
        ((*COMMON, *DAVIS, "--height", 261), 4, "size: got 464x261"),
        ((*SMALL, *DAVIS, "--sense", "--bias", "diff_on=20"), 2, "no effect of a bias is published for davis346"),
        ((*SMALL, "--sense", "--set", "contrast_threshold_on=5"), 2, "contrast_threshold_on: got 5"),
        ((*SMALL, "--sense", "--set", "width=16"), 4, "got 32x24, wanted at most imx636's 16x"),
        ((*SMALL, "--sense", "--model", "v2e", "--param", "nothing=1"), 2, "nothing"),
        ((*SMALL, "--sense", "--preset", "nothing"), 3, "nothing: cannot be opened"),
        ((*SMALL, "--sense", "--mask", "no_such_file"), 3, "no_such_file"),
        ((*SMALL, "--sense", "--frobnicate"), 2, "no such option"),
        ((*SMALL, "--sense", "--start", "20s"), 4, "--start"),
        ((*SMALL, "--sense", "--no-motion", "--warmup", "1000s"), 2, "--warmup"),
        ((*SMALL, "--time", "uniform", "--sense", "--no-motion"), 2, "--no-motion"),
        ((*SMALL, "--sense", "--labels", "no_folder/l.npy"), 5, "no_folder"),
        ((*SMALL, "--frames", 1), 4, "frames: got 1, wanted at least 2"),
        ((*SMALL, "--lens", "no_such_lens"), 3, "no_such_lens"),
    ],
)
def test_an_error_of_the_simulation_comes_before_the_render(blend, tmp_path, words, code, says):
    result = run(blend, tmp_path / "e.raw", *words)
    assert result.returncode == code and says in result.stderr, result.stderr
    assert result.stderr.startswith("pecs: run: ") and result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "code"), [("e.xyz", 2), ("no_folder/e.raw", 5)])
def test_an_event_file_that_cannot_be(blend, tmp_path, name, code):
    result = run(blend, tmp_path / name, *SMALL, "--stack", tmp_path / "s")
    assert result.returncode == code and result.stderr.count("\n") == 1, result.stderr
    assert not list(tmp_path.iterdir())


def test_a_radiance_without_a_stop_comes_before_the_render(root, tmp_path):
    result = run(root / "scenes/rotating_disk", tmp_path / "e.raw", *SMALL, "--lens", "none")
    assert result.returncode == 4 and "--fnumber" in result.stderr, result.stderr
    assert not list(tmp_path.iterdir())


def test_options_that_work_are_those_of_the_simulation(blend, tmp_path):
    """Outputs other than the events are written where they were asked for."""
    words = ("--sense", "--labels", tmp_path / "l.npy", "--no-motion", "--start", "1ms", "--set", "leak_rate_hz=9")
    run(blend, tmp_path / "e.raw", *SMALL, *words, check=True)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["e.raw", "e.raw.run.json", "e.stack", "l.npy"]


@pytest.mark.parametrize(
    ("words", "size"),
    [(DAVIS, (346, 260)), ((*DAVIS, "--width", 32), (32, 18)), (("--chip", "ideal", "--width", 48), (48, 27))],
)
def test_the_default_size_is_the_chips(blend, tmp_path, words, size):
    run(blend, tmp_path / "e.raw", *COMMON, *words, "--time", "uniform", check=True)
    info = json.loads((tmp_path / "e.stack/stack.json").read_text())
    assert (info["width"], info["height"]) == size
