"""Every option of `pecs sense` changes the output or is an error."""

import json
import re

import numpy as np
import pecs
import pytest
from support.small_stacks import H, N, W, write

# Options by what shows that they were heard: a key of the run record's config that changes, or a refusal's words.
HEARD = {
    "chip": (["--chip", "davis346"], "chip"),
    "set": (["--set", "contrast_threshold_on=0.27"], "chip"),
    "bias": (["--bias", "diff_on=35,bias_diff_off=-10"], "chip"),
    "bias-file": (["--bias-file", "BIAS"], "chip"),
    "no-noise": (["--no-noise"], "no_noise"),
    "seed": (["--seed", "2"], "seed"),
    "preset": (["--preset", "v2e_noisy"], "preset"),
    "model": (["--model", "esim"], "model"),
    "param": (["--model", "esim", "--param", "log_eps=0.01"], "model"),
    "white": (["--model", "esim", "--white", "1pA"], "model"),
    "readout": (["--readout", "ideal"], "readout"),
    "roi": (["--roi", "2,3,20,10"], "stages"),
    "mask": (["--mask", "MASK"], "stages"),
    "afk": (["--afk", "50:520"], "stages"),
    "afk-pass": (["--afk-pass", "50:520"], "stages"),
    "afk-counts": (["--afk", "50:520", "--afk-counts", "2:1"], "stages"),
    "trail": (["--trail", "2ms"], "stages"),
    "stc": (["--stc", "2ms"], "stages"),
    "stc-keep": (["--stc-keep", "2ms"], "stages"),
    "erc": (["--erc", "20kHz"], "stages"),
    "bands": (["--bands", "mc:1"], "bands"),
    "gain": (["--gain", "1e-15"], "gain"),
    "warmup-loops": (["--warmup-loops", "1"], "warmup_loops"),
    "start": (["--start", "3ms"], "start_us"),
    "duration": (["--duration", "5ms"], "duration_us"),
}
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
# Where the output goes and what is said: tested by name elsewhere.
ELSEWHERE = set("render-noise help output format labels frames threads json quiet verbose view".split())


def test_every_option_is_in_one_of_the_tables(pecs_program):
    options = set(re.findall(r"--([a-z][a-z-]+)", pecs_program("sense", "--help").stdout))
    assert options == set(HEARD) | set(REFUSED) | ELSEWHERE


@pytest.fixture(scope="module")
def plain(tmp_path_factory, pecs_program):
    folder = tmp_path_factory.mktemp("options")
    write(folder / "s", level=1e-3, period_ns=N * 1_000_000)
    assert pecs_program("sense", folder / "s", "-o", folder / "plain.npz", "--quiet").returncode == 0
    return folder


@pytest.mark.parametrize("option", HEARD)
def test_an_option_is_heard(option, plain, pecs_program):
    args, key = HEARD[option]
    (plain / "mask.txt").write_text("row 3\n")
    (plain / "a.bias").write_text("35 % bias_diff_on\n0 % bias_fo\n")
    files = {"MASK": plain / "mask.txt", "BIAS": plain / "a.bias"}
    args = [files.get(word, word) for word in args]
    pecs_program("sense", plain / "s", "-o", plain / "o.npz", "--quiet", *args, check=True)
    record, before = (json.loads((plain / f"{name}.npz.run.json").read_text())["config"] for name in ("o", "plain"))
    assert record[key] != before[key]


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
    cv2 = pytest.importorskip("cv2")
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
