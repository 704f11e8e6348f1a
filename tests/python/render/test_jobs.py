"""Long jobs: killed, restarted, rendered in shards, they become the stack of one run, byte for byte."""

import json
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pecs
import pytest
from pecs._arguments import latest
from pecs_blender.output import Output
from support import contents, in_bpy, pecs_blender
from support.small_stacks import stack_json

SMALL = ("--bands", 3, "--fps", 1000, "--width", 64, "--samples", 2, "--lens", "none")


def run(root, scene, output, *args, check=True):
    return pecs_blender("render", root / "scenes" / scene, "-o", output, *args, check=check)


@pytest.fixture(scope="module")
def whole(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "s"
    run(root, "rotating_disk", folder, *SMALL, "--frames", 6)
    return folder


def test_a_moving_part_is_rendered_as_in_the_whole(root, tmp_path):
    """Through a lens, bit for bit; elsewhere stays what the scene was at t = 0."""
    args = (*SMALL[:-2], "--frames", "3:4", "--fps", 100)
    run(root, "rotating_disk", tmp_path / "whole", *args)
    run(root, "rotating_disk", tmp_path / "part", *args, "--moving-px", "20:3:41:30")
    run(root, "rotating_disk", tmp_path / "start", *args, "--frames", 1)
    whole, part, start = (pecs.StackReader(tmp_path / n).read_frame(0) for n in ("whole", "part", "start"))
    inside = np.zeros(whole.shape, bool)
    inside[:, 3:30, 20:41] = True
    assert (part[inside] == whole[inside]).all() and (part[~inside] == start[~inside]).all()
    assert not (whole[~inside] == start[~inside]).all()
    result = run(root, "rotating_disk", tmp_path / "x", *args, "--moving-px", "20:3:80:30", check=False)
    assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1


def test_shards_of_a_plan_merge_to_one_run(root, whole, tmp_path):
    for name, frames in (("a", "0:3"), ("b", "3:6")):
        run(root, "rotating_disk", tmp_path / name, *SMALL, "--frames", 6, "--only", frames)
        assert len(contents(tmp_path / name)) == 4
    result = pecs_blender("merge", tmp_path / "a", "-o", tmp_path / "s", check=False)
    assert result.returncode == 4 and "3 frames missing" in result.stderr
    pecs_blender("merge", tmp_path / "a", tmp_path / "b", "-o", tmp_path / "s")
    assert contents(tmp_path / "s") == contents(whole)


LIGHTS = """
import sys
from pecs_lab.blend import floor, material, save, start

start((32, 24), (0, -4, 0), 90)
floor(material("paper", ("ShaderNodeBsdfDiffuse", {}))[0], 12, (0, 1, 0), (90, 0, 0))
for x, hidden in ((-1, (0, 1, 0)), (0, (0, 0, 0)), (1, (0, 0, 0))):
    glow, _, _ = material("glow", ("ShaderNodeEmission", {}))
    board = floor(glow, 0.5, (x, 0, 0), (90, 0, 0))
    for frame, board.hide_render in enumerate(hidden, 1):
        board.keyframe_insert("hide_render", frame=frame)
save(sys.argv[1], "lights")
"""


def test_what_lit_earlier_frames_changes_no_sample(tmp_path):
    """A board that emits light is hidden, and there again in the last frame."""
    in_bpy(LIGHTS, tmp_path)
    args = ("render", tmp_path / "lights.blend", "--bands", 1, "--fps", 24, "--samples", 4)
    for name, frames in (("alone", "2:3"), ("all", "0:3")):
        pecs_blender(*args, "--frames", frames, "-o", tmp_path / name)
    alone, last = (pecs.StackReader(tmp_path / name).read_frame(i) for name, i in (("alone", 0), ("all", 2)))
    assert np.array_equal(alone, last)


def test_strange_shards_do_not_merge(root, whole, tmp_path):
    run(root, "rotating_disk", tmp_path / "a", *SMALL, "--frames", "6:7", "--seed", 2)
    result = pecs_blender("merge", whole, tmp_path / "a", "-o", tmp_path / "s", check=False)
    assert result.returncode == 4 and len(result.stderr.strip().splitlines()) == 1
    result = pecs_blender("merge", whole, tmp_path / "nothing", "-o", tmp_path / "s", check=False)
    assert result.returncode == 3 and len(result.stderr.strip().splitlines()) == 1


def test_frames_stay_locked_while_their_process_reads_the_stack(whole, tmp_path):
    """A lock that a reader's close() of stack.json would end lets a second process write the same frames."""

    folder = shutil.copytree(whole, tmp_path / "s")
    stack = json.loads((folder / "stack.json").read_text())
    body = """
import json, sys
from pathlib import Path
from pecs_blender.output import Output
folder = Path(sys.argv[1])
Output(folder, json.loads((folder / "stack.json").read_text()), slice(2, 3), sys.argv[2] == "overwrite")
"""
    with Output(folder, stack, slice(0, 3), False):
        with pecs.StackReader(folder) as reader:
            reader.read_layer("light", 0)
        for exists in ("continue", "overwrite"):
            second = in_bpy(body, folder, exists, check=False)
            assert "another process renders these frames" in second.stderr, exists
    in_bpy(body, folder, "continue")
    assert contents(folder) == contents(whole)


def test_kill_9_at_any_moment(root, whole, tmp_path):
    random.seed(6)
    words = ("render", root / "scenes/rotating_disk", "-o", tmp_path / "s", *SMALL, "--frames", 6)
    command = [sys.executable, "-m", "pecs_blender", *latest(words)]
    for _ in range(3):
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        time.sleep(random.uniform(0.5, 3))
        process.send_signal(signal.SIGKILL)
        process.wait()
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "s").glob("frame_*.exr")}
    run(root, "rotating_disk", tmp_path / "s", *SMALL, "--frames", 6)
    assert contents(tmp_path / "s") == contents(whole) and all(p.stat().st_mtime_ns == ns for p, ns in before.items())


def test_every_scene_renders(root, tmp_path):
    """A folder in scenes/ is a scene: a frame, still where nothing moves, and a README."""
    scenes = sorted(p.parent.name for p in (root / "scenes").glob("*/scene.json"))
    assert len(scenes) >= 4
    for scene in scenes:
        assert (root / "scenes" / scene / "README.md").is_file()
        run(root, scene, tmp_path / scene, *SMALL, "--bands", 4, "--frames", 2, "--fps", 500)
        with pecs.StackReader(tmp_path / scene) as stack:
            first, second = stack.read_frame(0), stack.read_frame(1)
        assert first.min() >= 0 and first.mean() > 0
        same = (first == second).mean()
        if scene == "stage":
            assert same == 1  # nothing moves but what a user places
        else:
            assert 0.2 < same < 1, scene  # something moves, most does not


def test_a_light_tree_takes_the_lamps_that_matter(root, tmp_path):
    """The same light with less noise, by two seeds each."""
    noise, mean = [], []
    for more in ((), ("--light-tree",)):
        pair = []
        for seed in (1, 7):
            folder = tmp_path / f"{seed}{len(more)}"
            run(root, "room", folder, *SMALL, "--samples", 4, "--frames", 1, "--seed", seed, *more)
            with pecs.StackReader(folder) as stack:
                pair.append(stack.read_frame(0)[:2].astype(float))
        a, b = pair
        noise.append(np.median(np.abs(a - b) / (a + b)))
        mean.append(np.mean(pair))
    assert noise[1] < 0.75 * noise[0], noise
    assert mean[1] == pytest.approx(mean[0], rel=0.05)


def test_bands_are_weighed_as_the_sensor_does(tmp_path, pecs_program):
    """Light in one band of a pair at a time: the photocurrents that `pecs sense` reports are as the weights."""

    bands = [{"lambda_nm": 450.0, "weight_nm": 30.0}, {"lambda_nm": 850.0, "weight_nm": 50.0}]
    currents = []
    for band in (0, 1):
        with pecs.StackWriter(tmp_path / f"s{band}", stack_json(4, 4, [0, 1000], bands=bands)) as writer:
            light = np.zeros((2, 4, 4), np.float32)
            light[band] = 1e-3
            for index in (0, 1):
                writer.write_frame(index, light)
        pecs_program("sense", tmp_path / f"s{band}", "-o", tmp_path / f"{band}.csv", check=True)
        record = json.loads((tmp_path / f"{band}.csv.run.json").read_text())
        currents.append(record["results"]["photocurrent_a"]["median"])
    weights = pecs.Chip("imx636").amperes_per_unit(bands)
    assert currents[1] / currents[0] == pytest.approx(weights[1] / weights[0], rel=1e-3)


def test_a_device_that_is_not_there_is_one_line(root, tmp_path):
    result = run(root, "rotating_disk", tmp_path / "s", *SMALL, "--device", "METAL", check=False)
    assert result.returncode == 6 and len(result.stderr.strip().splitlines()) == 1
