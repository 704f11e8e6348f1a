"""A recording, and a small sequence with its light."""

import shutil

import numpy as np
import pecs
import pytest
from support import small_sequence
from support.small_stacks import stack_json

W, H = 96, 72


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    rng, events = np.random.default_rng(1), np.zeros(30_000, pecs.EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(1_000_000, 1_200_000, len(events)))
    events["t"][events["t"] > 1_150_000] += 70_000  # and a pause
    events["x"], events["y"] = rng.integers(0, W, len(events)), rng.integers(0, H, len(events))
    events["p"] = rng.integers(0, 2, len(events))
    path = tmp_path_factory.mktemp("recording") / "r.raw"
    pecs.write(path, events, W, H)
    return path, events


@pytest.fixture(scope="module")
def trainable(sequence, tmp_path_factory):
    """The small sequence with its light, as recipes with keep.light have it."""
    folder = tmp_path_factory.mktemp("light") / "set"
    shutil.copytree(sequence.folder, folder / "sequences" / "0000")
    times = np.arange(0, small_sequence.DURATION_US + 1, 1000)
    for eye in small_sequence.rig()[:2]:
        stack = stack_json(W, H, (times * 1000).tolist(), pixel_pitch_m=1e-5)
        with pecs.StackWriter(folder / "sequences/0000" / eye.name / "stack", stack) as writer:
            for i, t in enumerate(times):
                writer.write_frame(i, eye.light(t)[None] * 1e-6)
    (folder / "other.onnx").write_text("no network")
    return folder
