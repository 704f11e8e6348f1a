"""Options of `pecs sense` that a stack refuses or that exclude each other; every model in loops, threads and live."""

import cv2
import numpy as np
import pecs
import pytest
from support.small_stacks import H, N, W, write

# Options that a periodic stack does not take, and the refusal's words; tests/python/cli/test_options.py has the others.
REFUSED = {
    "warmup": (["--warmup", "5ms"], "--warmup-loops for a periodic stack"),
    "fps": (["--fps", "500"], "frames without times of their own"),
    "times": (["--times", "x.txt"], "frames without times of their own"),
    "time-unit": (["--time-unit", "ms"], "--times"),
    "colorspace": (["--colorspace", "linear"], "pictures or a video"),
    "ocio": (["--ocio", "x.ocio"], "pictures or a video"),
    "crop": (["--crop", "2,2,8,8"], "pictures or"),
    "size": (["--size", "8x8"], "pictures or"),
    "no-flow": (["--no-flow"], "pictures or"),
    "rolling-shutter": (["--rolling-shutter", "3ms"], "pictures or"),
    "photocurrent": (["--photocurrent", "1pA"], "relative light"),
    "fnumber": (["--fnumber", "4"], "radiance"),
    "no-motion": (["--no-motion"], "no layer motion"),
    "window": (["--window", "3us"], "--view"),
    "dropped": (["--dropped", "DROPPED"], "no stage drops events"),
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory, pecs_program):
    folder = tmp_path_factory.mktemp("options")
    write(folder / "s", level=1e-3, period_ns=N * 1_000_000)
    assert pecs_program("sense", folder / "s", "-o", folder / "plain.npz", "--quiet").returncode == 0
    return folder


@pytest.mark.parametrize("option", REFUSED)
def test_an_option_without_effect_is_refused(option, plain, pecs_program):
    args, words = REFUSED[option]
    args = [plain / "x.npy" if word == "DROPPED" else word for word in args]
    done = pecs_program("sense", plain / "s", "-o", plain / "refused.npz", "--quiet", *args)
    assert done.returncode in (2, 4) and words in done.stderr, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not [*plain.glob("refused*"), *plain.glob("x.npy*")]  # nor a .partial


@pytest.mark.parametrize(
    "args",
    [
        ["--set", "contrast_threshold_on=0.2", "--set", "contrast_threshold_on=0.3"],
        ["--model", "esim", "--param", "log_eps=0.01", "--param", "log_eps=0.02"],
    ],
    ids=["set", "param"],
)
def test_a_value_that_is_set_twice_is_an_error(args, plain, pecs_program):
    done = pecs_program("sense", plain / "s", "-o", plain / "refused.npz", *args)
    key = args[-1].split("=")[0]
    assert (done.returncode, done.stderr) == (2, f"pecs: {args[-2]} {args[-1]}: {key} is set twice; set it once\n")


@pytest.mark.parametrize("args", [["--white", "1e-12"], ["--gain", "1e-15", "--photocurrent", "1e-12"]])
def test_options_that_exclude_each_other(args, plain, pecs_program):
    done = pecs_program("sense", plain / "s", "-o", plain / "refused.npz", "--quiet", *args)
    assert done.returncode == 2 and args[-2] in done.stderr, done.stderr


@pytest.mark.parametrize("model", [m["name"] for m in pecs.models()])
def test_loops_of_every_model_are_the_unrolled_stack(model, tmp_path, pecs_program):
    """A window of a loop, against the same light pushed frame by frame; threads and labels change nothing."""
    write(tmp_path / "s", level=1e-3, period_ns=N * 1_000_000)
    args = ["--model", model, "--readout", "ideal", "--white", "4e-12"][: 6 if model != "pecs" else 4]
    args += ["--warmup-loops", "2", "--start", "700", "--duration", "31000"]
    for threads in (1, 3):
        out = tmp_path / f"{threads}.npz"
        pecs_program("sense", tmp_path / "s", "-o", out, "--quiet", "--threads", threads, *args, check=True)
    events = pecs.read(tmp_path / "1.npz")
    np.testing.assert_array_equal(events, pecs.read(tmp_path / "3.npz"))

    with pecs.Chip("imx636") as chip:
        light = chip.photocurrent(tmp_path / "s")
    unit_a = 1e-15 if model == "pecs" else 4e-12  # of white, for models that take pictures
    sensor = pecs.Sensor(W, H, "imx636", model=model, photocurrent_a=unit_a, readout="ideal")
    loops = np.concatenate([light] * 4) / np.float32(unit_a)
    pushed = np.concatenate([sensor.push(loops, 1000.0 * np.arange(4 * N)), sensor.finish()])
    from_us = 2 * N * 1000 + 700
    expected = pushed[(pushed["t"] >= from_us) & (pushed["t"] < from_us + 31000)]
    assert len(events) > 500
    # The planes' unit is another one here, so the light differs in the last digit of a float.
    assert len(events) == pytest.approx(len(expected), rel=2e-3)
    assert abs(np.median(events["t"]) - np.median(expected["t"] - from_us)) < 40


@pytest.mark.parametrize("model", [m["name"] for m in pecs.models()])
def test_live_is_the_file_for_every_model(model, tmp_path, pecs_program):
    video = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 500, (W * 2, H * 2))
    if not video.isOpened():
        pytest.skip("needs an MJPG encoder")
    for i in range(N):
        bar = 60 + 180 * (np.abs(np.arange(2 * W) - 3 * i) < 9)
        video.write(np.broadcast_to(bar[None, :, None], (2 * H, 2 * W, 3)).astype(np.uint8))
    video.release()
    white = [] if model == "pecs" else ["--white", "1e-12"]
    args = ["--model", model, *white, "--start", "2000", "--bands", "mc:2", "--quiet"]
    for name, live in (("file", []), ("live", ["--view"])):
        done = pecs_program("sense", tmp_path / "v.avi", "-o", tmp_path / f"{name}.npz", *args, *live, check=True)
    events = pecs.read(tmp_path / "live.npz")
    assert len(events) > 500
    np.testing.assert_array_equal(events, pecs.read(tmp_path / "file.npz"))
    if model == "pecs":
        labels = ["--labels", tmp_path / "l.npy"]
        done = pecs_program("sense", tmp_path / "v.avi", "-o", tmp_path / "l.npz", *args, "--view", *labels)
        assert done.returncode == 0 and len(np.load(tmp_path / "l.npy")) == len(events)
