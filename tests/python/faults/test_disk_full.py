"""A disk that fills up: one line, exit code 5, and no half a file. Needs root for a small file system of its own."""

import subprocess
import sys

import numpy as np
import pytest
from support.faults import random_stack


def test_a_stack_that_fills_the_disk(small_disk):
    import pecs

    with pytest.raises(pecs.PecsError) as e:
        random_stack(small_disk / "s", 50)
    assert e.value.code == 5 and "space" in str(e.value)
    with pecs.StackReader(small_disk / "s") as reader:  # what was finished is whole
        whole = sorted(p for p in (small_disk / "s").glob("frame_*.exr"))
        assert 0 < len(whole) < 50
        for i in range(len(whole)):
            assert np.isfinite(reader.read_frame(i)).all()


def test_events_that_fill_the_disk(pecs_program, small_disk, tmp_path):
    random_stack(tmp_path / "s", 20)
    output = small_disk / "events.csv"
    result = pecs_program("sense", tmp_path / "s", "-o", output, "--gain", 1e-15, "--quiet")
    assert result.returncode == 5, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not output.exists()


def test_a_render_asks_for_its_space_first(root, small_disk):
    command = [sys.executable, "-m", "pecs_blender", "render", root / "scenes/rotating_disk", "-o", small_disk / "s"]
    command += ["--lens", "none", "--width", "640", "--bands", "3", "--frames", "10"]
    result = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert result.returncode == 5 and "disk: got" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1 and not (small_disk / "s").exists()


def test_a_continued_render_asks_for_missing_frames_only(root, small_disk):
    """Four frames of 28 kB are there; eight fit only if these four are not counted again."""
    command = [sys.executable, "-m", "pecs_blender", "render", root / "scenes/rotating_disk", "-o", small_disk / "s"]
    command += ["--lens", "none", "--width", "64", "--bands", "3", "--samples", "1", "--fps", "1000", "--frames", "12"]
    for part in ("0:4", "0:8"):
        result = subprocess.run([*map(str, command), "--only", part], capture_output=True, text=True)
        assert result.returncode == 0, result.stderr
    assert len(list((small_disk / "s").glob("frame_*.exr"))) == 8
    result = subprocess.run([*map(str, command), "--seed", "2", "--overwrite"], capture_output=True, text=True)
    assert result.returncode == 5 and "disk: got" in result.stderr
