"""A disk that fills up: one line, exit code 5, and no half a file. Needs root for a small file system of its own."""

import os

import numpy as np
import pecs
import pytest
from support import pecs_blender
from support.faults import events, fill, random_stack, refused


def test_a_stack_that_fills_the_disk(small_disk):
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


@pytest.mark.parametrize("free", [0, 4096, 16384])
@pytest.mark.parametrize("command", ["view", "render-preview", "sense"])
def test_a_video_that_fills_the_disk(pecs_program, small_disk, tmp_path, command, free):
    """OpenCV reports no error."""
    random_stack(tmp_path / "s", 20)
    pecs.write(tmp_path / "e.raw", events(20_000), 64, 48)
    fill(small_disk, free)
    screenless = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    words = {
        "view": [tmp_path / "e.raw", "-o", small_disk / "v.mp4", "--slow-motion", 2],
        "render-preview": [tmp_path / "s", "-o", small_disk / "v.mp4"],
        "sense": [tmp_path / "s", "-o", tmp_path / "v", *"--format evt3 --gain 1e-15 --view --window 1ms".split()],
    }[command]
    if command == "sense":
        (tmp_path / "v.mp4").symlink_to(small_disk / "v.mp4")
        (small_disk / "v.mp4").touch()
    refused(pecs_program(command, *words, "--quiet", env=screenless), 5, "v.mp4: cannot be written: ")
    assert not (small_disk / "v.mp4").exists() or not (small_disk / "v.mp4").stat().st_size


def test_a_render_asks_for_its_space_first(root, small_disk):
    args = ("--lens", "none", "--width", 640, "--bands", 3, "--frames", 10)
    result = pecs_blender("render", root / "scenes/rotating_disk", "-o", small_disk / "s", *args, check=False)
    assert result.returncode == 5 and "disk: got" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1 and not (small_disk / "s").exists()


def test_a_continued_render_asks_for_missing_frames_only(root, small_disk):
    """Four frames of 28 kB are there; eight fit only if these four are not counted again."""
    command = ["render", root / "scenes/rotating_disk", "-o", small_disk / "s", "--lens", "none", "--width", 64]
    command += ["--bands", 3, "--samples", 1, "--fps", 1000, "--frames", 12]
    for part in ("0:4", "0:8"):
        pecs_blender(*command, "--only", part)
    assert len(list((small_disk / "s").glob("frame_*.exr"))) == 8
    result = pecs_blender(*command, "--seed", 2, "--overwrite", check=False)
    assert result.returncode == 5 and "disk: got" in result.stderr
