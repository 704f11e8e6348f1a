"""pecs.sense, pecs.Chip and pecs.models: what the program does, from Python."""

import json
import os
import re
import signal
import threading

import numpy as np
import pecs
import pytest
from pecs._options import SenseOptions
from support.small_stacks import write

BAND = [{"lambda_nm": 550.0, "weight_nm": 100.0}]


def test_the_program_gives_the_same(tmp_path, pecs_program):
    """Every option of `pecs sense` for stacks, under its own name."""
    write(tmp_path / "s", period_ns=24_000_000)
    (tmp_path / "times").write_text("\n".join(str(1000 * i) for i in range(24)))
    cases = [
        ([], {}),
        (
            ["--chip", "davis346", "--set", "contrast_threshold_on=0.2", "--seed", 7, "--threads", 1],
            {"chip": "davis346", "overrides": {"contrast_threshold_on": 0.2}, "seed": 7, "threads": 1},
        ),
        (
            ["--no-noise", "--readout", "ideal", "--format", "dsec"],
            {"noise": False, "readout": "ideal", "format": "dsec"},
        ),
        (
            ["--model", "esim", "--param", "log_eps=0.01", "--white", 1e-13],
            {"model": "esim", "parameters": {"log_eps": 0.01}, "white_a": 1e-13},
        ),
        (
            ["--warmup-loops", 1, "--start", 2000, "--duration", 40000, "--labels", tmp_path / "a.npy"],
            {"warmup_loops": 1, "start_us": 2000, "duration_us": 40000, "labels": tmp_path / "b.npy"},
        ),
        (["--bands", "mc:3", "--gain", 1e-9], {"bands": "mc:3", "gain": 1e-9}),
    ]
    for arguments, options in cases:
        done = pecs_program(
            "sense", tmp_path / "s", "-o", tmp_path / "a.hdf5", *arguments, "--quiet", "--json", check=True
        )
        report = pecs.sense(tmp_path / "s", tmp_path / "b.hdf5", **options)
        assert report["results"] == json.loads(done.stdout)
        a, b = pecs.read(tmp_path / "a.hdf5"), pecs.read(tmp_path / "b.hdf5")
        assert len(a) > 100
        np.testing.assert_array_equal(a, b)
        records = [json.loads((tmp_path / f"{name}.hdf5.run.json").read_text()) for name in "ab"]
        assert records[0]["config"] == records[1]["config"] == report["config"]
        assert records[0]["inputs"] == records[1]["inputs"]
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), np.load(tmp_path / "b.npy"))


def test_every_option_of_the_program_is_an_argument(pecs_program):
    """`pecs sense --help` and `pecs.sense` name the same things; what is only for pictures and cameras stays out."""
    found = re.findall("--([a-z][a-z-]+)", pecs_program("sense", "--help").stdout)
    options = {option.replace("-", "_") for option in found}
    options -= {"help", "output", "view", "window", "json", "quiet", "verbose"}
    options -= {"colorspace", "ocio", "crop", "size", "no_flow", "rolling_shutter"}  # pecs.sense reads no pictures
    renamed = {"set": "overrides", "param": "parameters", "no_noise": "noise", "no_motion": "motion"}
    renamed |= {"white": "white_a", "photocurrent": "photocurrent_a", "start": "start_us", "duration": "duration_us"}
    renamed |= {"times": "times_us", "bias": "biases", "afk": "afk_hz", "afk_pass": "afk_pass_hz", "erc": "erc_hz"}
    renamed |= {name: f"{name}_us" for name in ("warmup", "trail", "stc", "stc_keep")}
    assert {renamed.get(o, o) for o in options} == {"chip", *SenseOptions.__annotations__}


def test_what_is_odd_is_said(tmp_path):
    def holes(i, v):
        v[0, 3, 5:9] = -1 if i == 2 else v[0, 3, 5:9]
        v[0, 4, 5] = np.nan if i == 3 else v[0, 4, 5]
        return v

    write(tmp_path / "s", change=holes)
    with pytest.warns(UserWarning, match="values that no light has: 1 not finite, 4 negative"):
        pecs.sense(tmp_path / "s", tmp_path / "e.raw")
    write(tmp_path / "t")
    with pytest.warns(UserWarning, match="duration: got 10000000, the last frame is 23000 us"):
        pecs.sense(tmp_path / "t", tmp_path / "e.raw", duration_us=10_000_000)


def test_errors(tmp_path):
    write(tmp_path / "s")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        pecs.sense(tmp_path / "none", tmp_path / "e.raw")
    with pytest.raises(FileNotFoundError, match="none of"):
        pecs.sense(tmp_path / "s", tmp_path / "e.raw", chip="nope")
    with pytest.raises(OSError, match="cannot be written") as error:
        pecs.sense(tmp_path / "s", tmp_path / "none" / "e.raw")
    assert error.value.code == 5
    for options, words in (
        ({"overrides": {"nope": 1}}, "unknown key"),
        ({"model": "nope"}, "wanted one of"),
        ({"parameters": {"nope": 1}}, "unknown key"),
        ({"readout": "nope"}, "readout"),
        ({"bands": "mc:0"}, "bands: got mc:0"),
        ({"bands": "mc:1x"}, "bands: got mc:1x"),
        ({"threads": -1}, "threads"),
        ({"seed": -1}, "seed"),
        ({"duration_us": 0}, "duration_us"),
        ({"warmup_loops": 1}, "period"),
        ({"chip": "davis346", "overrides": {"width": 20}}, "size: got 40x30, wanted at most davis346's 20x"),
    ):
        with pytest.raises(pecs.PecsInputError, match=words):
            pecs.sense(tmp_path / "s", tmp_path / "e.raw", **options)
    assert not (tmp_path / "e.raw").exists()


def test_progress(tmp_path):
    write(tmp_path / "s", frames=200)
    done = []
    pecs.sense(tmp_path / "s", tmp_path / "e.raw", progress=done.append)
    assert done[-1] == 1 and len(done) > 1 and done == sorted(done)

    class Enough(Exception):
        pass

    def stop(share):
        raise Enough(share)

    with pytest.raises(Enough):
        pecs.sense(tmp_path / "s", tmp_path / "f.raw", progress=stop)
    assert not (tmp_path / "f.raw").exists()


def test_ctrl_c_stops_it(tmp_path):
    write(tmp_path / "s", frames=200)
    assert threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where we run in the background
    try:
        with pytest.raises(KeyboardInterrupt):
            pecs.sense(tmp_path / "s", tmp_path / "e.raw", progress=lambda _: os.kill(os.getpid(), signal.SIGINT))
    finally:
        signal.signal(signal.SIGINT, before)


def test_chip():
    with pecs.Chip("imx636", overrides={"contrast_threshold_on": 0.25}) as chip:
        assert (chip.width, chip.height, chip.contrast_threshold_on) == (1280, 720, 0.25)
        assert type(chip.width) is int and chip.info["values"]["pixel_pitch_m"]["unit"] == "m"
        assert len(chip.info["relative_qe"]["lambda_nm"]) == len(chip.info["relative_qe"]["value"]) > 10
        with pytest.raises(AttributeError, match="no nope"):
            _ = chip.nope
        frames = np.random.default_rng(1).random((5, 20, 30), np.float32)
        t_us = 1000.0 * np.arange(5)
        np.testing.assert_array_equal(
            pecs.simulate(frames, t_us, chip),
            pecs.simulate(frames, t_us, "imx636", overrides={"contrast_threshold_on": 0.25}),
        )
    with pytest.raises(FileNotFoundError):
        pecs.Chip("nope")
    with pytest.raises(ValueError, match="unknown key"):
        pecs.Chip(overrides={"nope": 1})
    with pytest.raises(ValueError, match="wanted a number in"):
        pecs.Chip(overrides={"contrast_threshold_on": 100})


def test_photocurrent(tmp_path):
    """550 nm, by hand; the stack, the weights and `pecs.sense` agree."""
    write(tmp_path / "s", frames=3)
    chip = pecs.Chip("imx636")
    qe = chip.peak_qe * np.interp(550, chip.info["relative_qe"]["lambda_nm"], chip.info["relative_qe"]["value"])
    area_m2 = chip.pixel_pitch_m**2 * chip.fill_factor
    by_hand = BAND[0]["weight_nm"] * area_m2 * qe * 550e-9 * 1.602176634e-19 / (6.62607015e-34 * 299792458)
    (per_unit,) = chip.amperes_per_unit(BAND)
    assert per_unit == pytest.approx(by_hand, rel=2e-4)
    assert chip.amperes_per_unit(BAND, "radiance", fnumber=2)[0] == pytest.approx(per_unit * np.pi / 16, rel=1e-9)
    assert sum(chip.amperes_per_unit(pecs.bands(n=4), "relative", photocurrent_a=3e-13)) == pytest.approx(3e-13)

    current = chip.photocurrent(tmp_path / "s")
    with pecs.StackReader(tmp_path / "s") as stack:
        light = np.stack([stack.read_frame(i)[0] for i in range(3)])
        np.testing.assert_allclose(current, per_unit * light, rtol=1e-6)
        np.testing.assert_array_equal(chip.photocurrent(stack, 1), current[1])
        np.testing.assert_array_equal(chip.photocurrent(stack, [2, 0]), current[[2, 0]])
    report = pecs.sense(tmp_path / "s", tmp_path / "e.raw")["results"]
    assert report["photocurrent_a"]["p95"] == pytest.approx(np.percentile(current[0], 95), rel=0.05)
    median_a = report["photocurrent_a"]["median"]
    assert report["corner_hz"]["median"] == pytest.approx(chip.corner_hz_per_a * (median_a + chip.dark_current_a))
    with pytest.raises(ValueError, match="wanted the lens's f-number"):
        chip.amperes_per_unit(BAND, "radiance")
    with pytest.raises(pecs.PecsError):
        chip.photocurrent(tmp_path / "s", 3)


def test_models():
    models = {m["name"]: m for m in pecs.models()}
    for model in models.values():
        assert model["source"]
        for p in model["parameters"]:
            assert p["min"] <= p["value"] <= p["max"] and p["meaning"] and p["unit"]
    assert models["pecs"]["takes_light"] and models["pecs"]["tells_causes"]
    assert not models["esim"]["takes_light"] and not models["esim"]["tells_causes"]


def test_labels_are_written_as_they_come(tmp_path):
    """Memory does not grow with the number of events: their causes reach the file during the run."""
    write(tmp_path / "s", frames=200, size=(120, 160))
    sizes = []

    def watch(done):
        partial = tmp_path / "l.npy.partial"
        sizes.append(partial.stat().st_size if partial.exists() else 0)

    report = pecs.sense(tmp_path / "s", tmp_path / "e.npz", labels=tmp_path / "l.npy", progress=watch)
    labels = np.load(tmp_path / "l.npy")
    assert labels.dtype == np.uint8 and len(labels) == report["results"]["events"] > 20000
    assert 10000 < sizes[-1] <= (tmp_path / "l.npy").stat().st_size == 192 + len(labels)


def test_the_program_and_python_take_the_same_seeds(tmp_path, pecs_program):
    write(tmp_path / "s")
    largest = 2**63 - 1
    assert pecs_program("sense", tmp_path / "s", "-o", tmp_path / "a.npz", "--seed", largest).returncode == 0
    pecs.sense(tmp_path / "s", tmp_path / "b.npz", seed=largest)
    np.testing.assert_array_equal(pecs.read(tmp_path / "a.npz"), pecs.read(tmp_path / "b.npz"))
    refused = pecs_program("sense", tmp_path / "s", "-o", tmp_path / "c.npz", "--seed", largest + 1)
    assert refused.returncode == 2 and "--seed" in refused.stderr
    with pytest.raises(pecs.PecsInputError, match="seed"):
        pecs.sense(tmp_path / "s", tmp_path / "c.npz", seed=largest + 1)
