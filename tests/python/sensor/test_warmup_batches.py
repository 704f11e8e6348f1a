"""Events of a warm-up depend on the light alone: not on how many frames are read at once, that is on a motion layer,
the size of frames, or threads."""

import numpy as np
import pecs
from pecs.motion import CHANNELS
from pecs.stack import StackWriter
from support.small_stacks import stack_json

QUIET = {"leak_rate_hz": 0.0, "noise_std": 0, "background_on_hz": 0, "background_off_hz": 0, "hot_pixel_fraction": 0}


def ramp(folder, frames, size, motion=False):
    """Light that rises by 20 per second in ln, frames 1 ms apart; `motion`: with a layer in which nothing moves."""
    stack = stack_json(size[1], size[0], [i * 1_000_000 for i in range(frames)], pixel_pitch_m=18.5e-6)
    if motion:
        layer = {"name": "motion", "channels": list(CHANNELS), "unit": "px", "at": "interval"}
        stack["layers"] = [layer | {"files": "motion_%06d.exr"}]
    still = np.zeros((len(CHANNELS), *size), np.float32)
    still[[name.removeprefix("back_") in ("z", "z_end") for name in CHANNELS]] = 1
    with StackWriter(folder, stack) as writer:
        for i in range(frames):
            if motion and i + 1 < frames:
                writer.write_layer("motion", i, still)
            writer.write_frame(i, np.full((1, *size), 1e-4 * np.exp(0.02 * i), np.float32))
    return folder


def test_a_motion_layer_of_zeros_changes_nothing(tmp_path):
    found = []
    for motion in (False, True):
        stack = ramp(tmp_path / f"motion_{motion}", 40, (60, 80), motion)
        pecs.sense(stack, tmp_path / "e.npz", chip="davis346", overrides=QUIET, readout="ideal", warmup_us=20_000)
        found.append(pecs.read(tmp_path / "e.npz"))
    assert len(found[0]) > 10_000
    np.testing.assert_array_equal(found[1], found[0])


def test_threads_change_nothing_in_large_frames(tmp_path):
    """2100 x 2100: batches of 32 MiB contain one frame with one thread, and two with two."""
    stack = ramp(tmp_path / "large", 3, (2100, 2100))
    found = []
    for threads in (1, 2, 16):
        pecs.sense(stack, tmp_path / "e.npz", chip="ideal", readout="ideal", warmup_us=200, threads=threads)
        found.append(pecs.read(tmp_path / "e.npz"))
    assert len(found[0]) > 100_000
    for events in found[1:]:
        assert np.array_equal(events, found[0])
