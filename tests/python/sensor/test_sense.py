"""`pecs sense` on real stacks: light in absolute units, loops, invariance, and every kind of bad input."""

import json
import re

import numpy as np
import pecs
import pytest
from pecs.stack import StackWriter
from support.small_stacks import H, N, W, read_csv, sense, stack_json, unroll, write


def test_run_record_and_invariance(tmp_path, pecs_program):
    write(tmp_path / "s", level=1e-3)
    outputs = {}
    for name, args in {"a": ["--threads", 1], "b": ["--threads", 2], "c": ["--threads", 7], "d": ["--seed", 2]}.items():
        sense(pecs_program, tmp_path / "s", "-o", tmp_path / f"{name}.csv", *args)
        outputs[name] = (tmp_path / f"{name}.csv").read_bytes()
    assert outputs["a"] == outputs["b"] == outputs["c"] != outputs["d"]
    record = json.loads((tmp_path / "a.csv.run.json").read_text())
    assert record["config"]["seed"] == 1
    assert record["config"]["chip"]["values"]["contrast_threshold_on"] == {"unit": "ln", "value": 0.254}
    assert record["results"]["events"] == len(read_csv(tmp_path / "a.csv")) > 1000


def test_a_still_scene_gives_nothing(tmp_path, pecs_program):
    write(tmp_path / "s", change=lambda i, v: v * 0 + np.linspace(1e-9, 1e-3, W, dtype=np.float32))
    for chip in ("imx636", "ideal"):
        done = sense(pecs_program, tmp_path / "s", "-o", tmp_path / "o.csv", "--chip", chip, "--no-noise", "--json")
        assert json.loads(done.stdout)["events"] == 0
        assert len(read_csv(tmp_path / "o.csv")) == 0


def test_loops_are_the_unrolled_stack(tmp_path, pecs_program):
    turn = N * 1000
    write(tmp_path / "loop", period_ns=turn * 1000, level=1e-5)
    write(tmp_path / "unrolled", frames=4 * N, level=1e-5, change=unroll)
    window = ["--duration", turn]
    sense(pecs_program, tmp_path / "loop", "-o", tmp_path / "a.csv", "--warmup-loops", 2, *window)
    sense(pecs_program, tmp_path / "unrolled", "-o", tmp_path / "b.csv", "--start", 2 * turn, *window)
    looped, unrolled = read_csv(tmp_path / "a.csv"), read_csv(tmp_path / "b.csv")
    assert len(looped) > 1000
    np.testing.assert_array_equal(looped, unrolled)
    # A window of the loops is the loops, cut.
    sense(pecs_program, tmp_path / "loop", "-o", tmp_path / "c.csv", "--warmup-loops", 2, "--start", 7000, *window)
    cut = looped[looped[:, 0] >= 7000] - [7000, 0, 0, 0]
    later = read_csv(tmp_path / "c.csv")
    np.testing.assert_array_equal(later[later[:, 0] < turn - 7000], cut)
    assert (later[:, 0] >= turn - 7000).any()
    # Without options, one period, to its end.
    sense(pecs_program, tmp_path / "loop", "-o", tmp_path / "d.csv")
    sense(pecs_program, tmp_path / "unrolled", "-o", tmp_path / "e.csv", *window)
    one = read_csv(tmp_path / "d.csv")
    np.testing.assert_array_equal(one, read_csv(tmp_path / "e.csv"))
    assert (one[:, 0] > (N - 1) * 1000).any()


def test_window_of_a_plain_stack(tmp_path, pecs_program):
    write(tmp_path / "s", level=1e-3)
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "a.csv")
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "b.csv", "--start", 5000, "--duration", 10000)
    whole, window = read_csv(tmp_path / "a.csv"), read_csv(tmp_path / "b.csv")
    whole = whole[(whole[:, 0] >= 5000) & (whole[:, 0] < 15000)]
    whole[:, 0] -= 5000
    np.testing.assert_array_equal(window, whole)


def truncate(folder):
    path = folder / "frame_000007.exr"
    path.write_bytes(path.read_bytes()[:300])


def other_size(folder):
    write(folder.parent / "other", size=(H, W + 1))
    (folder / "frame_000007.exr").write_bytes((folder.parent / "other/frame_000007.exr").read_bytes())


def edit(**change):
    def apply(folder):
        path = folder / "stack.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | change))

    return apply


@pytest.mark.parametrize(
    ("damage", "args", "code", "words"),
    [
        (lambda f: [p.unlink() for p in f.iterdir()] and f.rmdir(), [], 3, "no such file or folder"),
        (lambda f: (f / "frame_000005.exr").unlink(), [], 4, "frame_000005.exr missing"),
        (lambda f: (f / f"frame_{N - 1:06}.exr").unlink(), [], 4, f"got {N - 1} so far, wanted the {N}"),
        (truncate, [], 4, "frame_000007.exr"),
        (other_size, [], 4, f"got {W + 1}x{H}, wanted {W}x{H}"),
        (edit(bands=[{"lambda_nm": 500, "weight_nm": 1}]), [], 4, "wanted S0.500nm"),
        (lambda f: None, ["--chip", "nope"], 3, "imx636"),
        (lambda f: None, ["--set", "threshold=1"], 2, "unknown key"),
        (lambda f: None, ["--set", "noise_std=9"], 2, "[0, 1]"),
        (lambda f: None, ["--warmup-loops", "2"], 4, "period_ns"),
        (lambda f: None, ["--format", "nope"], 2, "nope"),
        (lambda f: None, ["--model", "nope"], 2, "esim"),
        (lambda f: None, ["--param", "nope"], 2, "KEY=NUMBER"),
        (lambda f: None, ["--threads", "-1"], 2, ""),
        (lambda f: (f / "stack.json").unlink(), [], 4, "--fps"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, pecs_program, damage, args, code, words):
    damage(write(tmp_path / "s"))
    done = pecs_program("sense", tmp_path / "s", "-o", tmp_path / "o.raw", "--quiet", *args)
    assert done.returncode == code, done.stderr
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1 or code == 2
    assert not (tmp_path / "o.raw").exists() and not (tmp_path / "o.raw.run.json").exists()


def test_times_in_the_headers_contradict_fps(tmp_path, pecs_program):
    """Frames of PECS, 1 ms apart, whose stack.json is missing."""
    folder = write(tmp_path / "s", level=1e-3)
    (folder / "stack.json").unlink()
    for i in range(3):
        (folder / f"frame_{i:06}.exr").unlink()  # times need not begin at 0
    sense(pecs_program, folder, "-o", tmp_path / "o.csv", "--fps", 1000.001, "--gain", "1e-8")
    done = pecs_program("sense", folder, "-o", tmp_path / "n.csv", "--fps", 500, "--gain", "1e-8", "--quiet")
    assert re.search(r"pecsTimeNs: got \d+, wanted \d+, by --fps or --times$", done.stderr.strip())
    assert done.returncode == 4 and not (tmp_path / "n.csv").exists()


def test_pixels_of_another_size_than_the_chips(tmp_path, pecs_program):
    def warnings(chip="imx636", **change):
        edit(**change)(folder)
        done = sense(pecs_program, folder, "-o", tmp_path / "o.csv", "--chip", chip, "--json")
        return [line for line in json.loads(done.stdout)["warnings"] if "um apart" in line]

    folder = write(tmp_path / "s", level=1e-3)
    assert not warnings(pixel_pitch_m=4.86e-6)  # a crop
    assert not warnings(pixel_pitch_m=1280 / W * 4.86e-6)  # the whole chip in another resolution
    assert not warnings("ideal", pixel_pitch_m=1.5e-5)  # answers to contrast alone
    assert ["15 um apart, those of imx636 4.86 um" in line for line in warnings(pixel_pitch_m=1.5e-5)] == [True]


def test_pixels_slower_than_the_recording(tmp_path):
    """2.3 Hz, a time constant of 70 ms, in 23 ms had a twentieth of the events and no warning."""
    with pytest.warns(UserWarning, match="corner is 2.3 Hz in the median pixel, which hardly follows in 0.023 s"):
        pecs.sense(write(tmp_path / "s", level=1e-6), tmp_path / "o.npz")


def test_models_labels_readout_and_gain(tmp_path, pecs_program):
    write(tmp_path / "s", level=1e-3)
    counts = {}
    for model, takes_light in ((m["name"], m["takes_light"]) for m in pecs.models()):
        out = tmp_path / f"{model}.csv"
        sense(pecs_program, tmp_path / "s", "-o", out, "--model", model, "--chip", "davis346")
        counts[model] = len(read_csv(out))
        config = json.loads((tmp_path / f"{model}.csv.run.json").read_text())["config"]
        assert config["model"]["name"] == model and takes_light != ("white_a" in config["model"])
    assert min(counts.values()) > 1000
    args = ["--set", "hot_pixel_fraction=0.1", "--set", "hot_pixel_hz=500", "--labels", tmp_path / "l.npy"]
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "l.csv", *args)
    labels = np.load(tmp_path / "l.npy")
    assert len(labels) == len(read_csv(tmp_path / "l.csv")) and labels.dtype == np.uint8
    assert np.bincount(labels, minlength=4)[0] > 1000 and np.bincount(labels, minlength=4)[3] > 100
    # A slow readout: the same light, fewer events, the others counted.
    slow = ["--set", "readout_rate_hz=1e5", "--json"]
    sent = json.loads(sense(pecs_program, tmp_path / "s", "-o", tmp_path / "slow.csv", *slow).stdout)
    free = json.loads(
        sense(pecs_program, tmp_path / "s", "-o", tmp_path / "f.csv", "--readout", "ideal", "--json").stdout
    )
    assert sent["events"] + sent["dropped"] == free["events"] and sent["dropped"] > 0 and free["dropped"] == 0
    # Twice the gain is twice the light.
    a, b = (
        json.loads(sense(pecs_program, tmp_path / "s", "-o", tmp_path / "g.csv", "--gain", g, "--json").stdout)
        for g in ("1e-15", "2e-15")
    )
    assert b["photocurrent_a"]["median"] == pytest.approx(2 * a["photocurrent_a"]["median"], rel=1e-5)


def test_monte_carlo_bands(tmp_path, pecs_program):
    """31 bands, the light between two spectra: the error of a draw falls as 1 / sqrt(N)."""
    lambdas = np.linspace(400, 700, 31)
    x = np.linspace(0, 1, W)[None, None, :]
    warm, cool = (np.exp(-(((lambdas - m) / 60) ** 2))[:, None, None] + 0.05 for m in (620, 470))
    stack = stack_json(W, H, [0, 1_000_000], bands=[{"lambda_nm": float(v), "weight_nm": 10.0} for v in lambdas])
    with StackWriter(tmp_path / "s", stack) as writer:
        for i in range(2):
            writer.write_frame(i, np.broadcast_to(1e-5 * (warm * x + cool * (1 - x)), (31, H, W)).astype(np.float32))
    rms = {}
    for n in (4, 64):
        draws = []
        for seed in range(1, 9):
            args = ["--bands", f"mc:{n}", "--seed", seed, "--json"]
            report = json.loads(sense(pecs_program, tmp_path / "s", "-o", tmp_path / "o.csv", *args).stdout)
            draws.append(report["monte_carlo"]["rms_error_of_ln_photocurrent"])
        rms[n] = np.sqrt(np.mean(np.square(draws)))
    assert 0 < rms[64] < rms[4] / 2.5 and rms[64] < 0.2, rms
    done = pecs_program("sense", tmp_path / "s", "-o", tmp_path / "n.csv", "--bands", "mc:0", "--quiet")
    assert done.returncode == 2
