"""Video from events inside Blender: what `pecs reconstruct` shows, without OpenCV."""

import subprocess
import sys

import numpy as np
import pytest
from support import pecs_blender

pytest.importorskip("bpy")
cv2 = pytest.importorskip("cv2")
pecs = pytest.importorskip("pecs")

WIDTH, HEIGHT = 64, 48


@pytest.fixture(scope="module")
def events(tmp_path_factory):
    """A bar of 8 columns passes within 40 ms: ON at its front, OFF behind."""
    path = tmp_path_factory.mktemp("events") / "bar.raw"
    step_us = 800
    columns = [(i * step_us + 10, x, p) for i in range(50) for x, p in ((i, 1), (i - 8, 0)) if 0 <= x < WIDTH]
    found = np.zeros(HEIGHT * len(columns), pecs.EVENT_DTYPE)
    for name, values in zip("txp", np.array(columns).T, strict=True):
        found[name] = np.repeat(values, HEIGHT)
    found["y"] = np.tile(np.arange(HEIGHT), len(columns))
    found = found[np.argsort(found["t"], kind="stable")]
    pecs.write(path, found, width=WIDTH, height=HEIGHT)
    return path


def pictures(path):
    video, found = cv2.VideoCapture(str(path)), []
    while (one := video.read())[0]:
        found.append(one[1][..., 0].astype(float))
    return np.array(found), video.get(cv2.CAP_PROP_FPS)


def test_it_shows_what_reconstruct_shows(events, tmp_path):
    words = (events, "--fps", "500Hz", "--playback-fps", 25, "--cutoff", "5Hz")
    said = pecs_blender("reconstruct", *words, "-o", tmp_path / "b.mp4", "--quiet")
    assert said.stdout == f"{tmp_path / 'b.mp4'}: 20 video frames, by filter\n" and said.stderr == ""
    command = [sys.executable, "-m", "pecs.learning", "reconstruct", *words, "-o", tmp_path / "p.mp4", "--quiet"]
    subprocess.run(list(map(str, command)), check=True)
    (ours, fps), (theirs, _) = pictures(tmp_path / "b.mp4"), pictures(tmp_path / "p.mp4")
    assert ours.shape == theirs.shape == (20, HEIGHT, WIDTH) and fps == 25
    assert theirs.std() > 20 and np.abs(ours - theirs).mean() < 6  # two encoders
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.mp4", "p.mp4"]


@pytest.mark.parametrize(
    ("words", "code", "line"),
    [
        (["{events}", "-o", "{out}.avi"], 2, "the extension must be .mp4"),
        (["/nonexistent.raw", "-o", "{out}.mp4"], 3, "/nonexistent.raw"),
        (["{events}", "-o", "{out}.mp4", "--fps", "5ms"], 2, "--fps: got '5ms', wanted a number with a unit"),
        (["{events}", "-o", "{out}.mp4", "--fps", "100MHz"], 2, "wanted at most"),
        (["{events}", "-o", "/nonexistent/x.mp4"], 5, "cannot be written"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_wrong_is_one_line(events, tmp_path, words, code, line):
    done = pecs_blender("reconstruct", *(w.format(events=events, out=tmp_path / "x") for w in words), check=False)
    assert done.returncode == code and line in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert not list(tmp_path.iterdir())
