"""`pecs sense` on real stacks: light in absolute units, loops, invariance, and every kind of bad input."""

import json
import math

import numpy as np
import pecs
import pytest
from pecs.stack import StackWriter
from support.small_stacks import BAND, H, N, W, read_csv, sense, stack_json, unroll, write


def test_photocurrent_is_absolute(tmp_path, pecs_program, root):
    """550 nm, QE .99 of the peak: i = E w A lambda e / (h c) QE, by hand."""
    level = 2e-6
    write(tmp_path / "s", frames=3, level=level, change=lambda i, v: v * 0 + np.float32(level))
    done = sense(pecs_program, tmp_path / "s", "-o", tmp_path / "o.csv", "--json")
    chip = json.loads((root / "sensor/chips/imx636.json").read_text())
    v = {k: x["value"] for k, x in chip["values"].items()}
    qe = v["peak_qe"] * np.interp(550, chip["relative_qe"]["lambda_nm"], chip["relative_qe"]["value"])
    watts = level * BAND[0]["weight_nm"] * v["pixel_pitch_m"] ** 2 * v["fill_factor"]
    amperes = watts * qe * 550e-9 * 1.602176634e-19 / (6.62607015e-34 * 299792458)
    report = json.loads(done.stdout)
    assert report["photocurrent_a"]["median"] == pytest.approx(amperes, rel=2e-4)
    assert report["corner_hz"]["median"] == pytest.approx(
        v["corner_hz_per_a"] * (amperes + v["dark_current_a"]), rel=2e-4
    )


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


def test_ideal_events_are_where_the_light_changes(tmp_path, pecs_program):
    write(tmp_path / "s")
    sense(
        pecs_program, tmp_path / "s", "-o", tmp_path / "o.csv", "--chip", "ideal", "--set", "contrast_threshold_on=0.3"
    )
    events = read_csv(tmp_path / "o.csv")
    assert (np.diff(events[:, 0]) >= 0).all()
    # Pixel (0, 0) starts at the brightest, ln 5, and falls to ln(1 + 4 e^-8) half a turn later: 8 thresholds of 0.2.
    first = events[(events[:, 1] == 0) & (events[:, 2] == 0) & (events[:, 0] < N * 500)]
    assert len(first) == math.floor(math.log(5 / (1 + 4 * math.exp(-8))) / 0.2)
    assert (first[:, 3] == 0).all()


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


def test_window_of_a_plain_stack(tmp_path, pecs_program):
    write(tmp_path / "s", level=1e-3)
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "a.csv")
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "b.csv", "--start", 5000, "--duration", 10000)
    whole, window = read_csv(tmp_path / "a.csv"), read_csv(tmp_path / "b.csv")
    whole = whole[(whole[:, 0] >= 5000) & (whole[:, 0] < 15000)]
    whole[:, 0] -= 5000
    np.testing.assert_array_equal(window, whole)


def test_values_that_are_no_light_are_counted(tmp_path, pecs_program):
    def damage(i, values):
        if i == 3:
            values[0, 0, :3] = [np.nan, np.inf, -1]
        return values

    write(tmp_path / "s", change=damage)
    done = sense(pecs_program, tmp_path / "s", "-o", tmp_path / "o.csv", "--json")
    assert json.loads(done.stdout)["bad_values"] == {"not_finite": 2, "negative": 1}


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
        (edit(times_ns=[0, 2, 1]), [], 4, "times_ns[2]"),
        (edit(extra=1), [], 4, "extra: got an unknown key"),
        (edit(width=16384), [], 4, "width: got 16384"),
        (lambda f: None, ["--chip", "nope"], 3, "imx636"),
        (lambda f: None, ["--set", "threshold=1"], 2, "unknown key"),
        (lambda f: None, ["--set", "noise_std=9"], 2, "[0, 1]"),
        (lambda f: None, ["--warmup-loops", "2"], 4, "period_ns"),
        (lambda f: None, ["--format", "nope"], 2, "nope"),
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


def test_foreign_stack_needs_only_fps(tmp_path, pecs_program):
    write(tmp_path / "s", level=1e-3)
    (tmp_path / "s/stack.json").unlink()
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "o.csv", "--fps", 1000)
    assert len(read_csv(tmp_path / "o.csv")) > 100


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


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--model", "nope"], "esim"),
        (["--model", "esim", "--param", "log_eps=2"], "log_eps"),
        (["--model", "v2e", "--param", "nope=2"], "cutoff_hz"),
        (["--param", "nope=2"], "none"),
        (["--param", "nope"], "KEY=NUMBER"),
        (["--model", "esim", "--labels", "x.npy"], "wanted pecs"),
        (["--readout", "nope"], ""),
    ],
)
def test_wrong_models_are_refused(tmp_path, pecs_program, args, words):
    write(tmp_path / "s", frames=3)
    done = pecs_program("sense", tmp_path / "s", "-o", tmp_path / "o.raw", "--quiet", *args)
    assert done.returncode == 2 and words in done.stderr, done.stderr
    assert not (tmp_path / "o.raw").exists()


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
