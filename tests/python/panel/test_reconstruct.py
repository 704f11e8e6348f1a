"""Video from events inside Blender: `pecs reconstruct` in its Python, which has no OpenCV."""

import subprocess
import sys

import cv2
import numpy as np
import pecs
import pytest
from support import pecs_blender

pytest.importorskip("bpy")

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


def test_it_is_what_reconstruct_writes(events, tmp_path):
    words = (events, "--fps", "500Hz", "--playback-fps", 25, "--method", "filter", "--cutoff", "5Hz")
    said = pecs_blender("reconstruct", *words, "-o", tmp_path / "b.mp4", "--quiet")
    assert said.stdout == f"{tmp_path / 'b.mp4'}: 20 pictures of 64 x 48, by filter\n" and said.stderr == ""
    command = [sys.executable, "-m", "pecs.learning", "reconstruct", *words, "-o", tmp_path / "p.mp4", "--quiet"]
    subprocess.run(list(map(str, command)), check=True)
    (ours, fps), (theirs, _) = pictures(tmp_path / "b.mp4"), pictures(tmp_path / "p.mp4")
    assert ours.shape == theirs.shape == (20, HEIGHT, WIDTH) and fps == 25
    assert theirs.std() > 20 and (ours == theirs).all()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.mp4", "p.mp4"]
