"""`pecs sense` on real stacks: light in absolute units, loops, invariance, and every kind of bad input."""

import json
import math
import os

import numpy as np
import pytest
from pecs.stack import StackWriter

W, H, N = 40, 30, 24
BAND = [{"lambda_nm": 550.0, "weight_nm": 100.0}]


def write(folder, frames=N, period_ns=None, level=1e-6, change=None, size=(H, W)):
    """A bright bar that moves one turn in `frames` frames of 1 ms, on a film irradiance of `level` W m^-2 nm^-1."""
    stack = {
        "pecs_stack": 1,
        "quantity": "irradiance",
        "width": size[1],
        "height": size[0],
        "pixel_pitch_m": 4.86e-6,
        "bands": BAND,
        "times_ns": [i * 1_000_000 for i in range(frames)],
        "period_ns": period_ns,
        "lens": None,
        "scene": {},
        "render": {},
        "versions": {},
    }
    with StackWriter(folder, stack) as writer:
        for i in range(frames):
            x = np.arange(size[1])
            image = level * (1 + 4 * np.exp(4 * np.cos(2 * np.pi * (x / size[1] - i / frames)) - 4))
            values = np.broadcast_to(image, (1, *size)).astype(np.float32)
            if change:
                values = change(i, values.copy())
            writer.write_frame(i, values)
    return folder


def unroll(i, values):
    """Frames of `write` with 4 N frames move a quarter as fast: draw those of N again."""
    x = np.arange(W)
    image = 1e-5 * (1 + 4 * np.exp(4 * np.cos(2 * np.pi * (x / W - (i % N) / N)) - 4))
    return np.broadcast_to(image, values.shape).astype(np.float32)


def read_csv(path):
    lines = [line for line in path.read_text().splitlines() if line and line[0].isdigit()]
    return np.array([[int(v) for v in line.replace(",", " ").split()] for line in lines])


def sense(pecs_program, *args):
    done = pecs_program("sense", *args, "--quiet")
    assert done.returncode == 0, done.stderr
    return done


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
    assert record["config"]["chip"]["values"]["contrast_threshold_on"] == {"unit": "ln", "value": 0.25}
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
    window = ["--duration-us", turn]
    sense(pecs_program, tmp_path / "loop", "-o", tmp_path / "a.csv", "--warmup-loops", 2, *window)
    sense(pecs_program, tmp_path / "unrolled", "-o", tmp_path / "b.csv", "--start-us", 2 * turn, *window)
    looped, unrolled = read_csv(tmp_path / "a.csv"), read_csv(tmp_path / "b.csv")
    assert len(looped) > 1000
    np.testing.assert_array_equal(looped, unrolled)
    # A window of the loops is the loops, cut.
    sense(pecs_program, tmp_path / "loop", "-o", tmp_path / "c.csv", "--warmup-loops", 2, "--start-us", 7000, *window)
    cut = looped[looped[:, 0] >= 7000] - [7000, 0, 0, 0]
    later = read_csv(tmp_path / "c.csv")
    np.testing.assert_array_equal(later[later[:, 0] < turn - 7000], cut)
    assert (later[:, 0] >= turn - 7000).any()


def test_window_of_a_plain_stack(tmp_path, pecs_program):
    write(tmp_path / "s", level=1e-3)
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "a.csv")
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "b.csv", "--start-us", 5000, "--duration-us", 10000)
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
        (lambda f: [p.unlink() for p in f.iterdir()] and f.rmdir(), [], 3, "no such folder"),
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
    sense(pecs_program, tmp_path / "s", "-o", tmp_path / "o.csv", "--fps", 1000, "--fnumber", 2)
    assert len(read_csv(tmp_path / "o.csv")) > 100


def test_models_labels_readout_and_gain(tmp_path, pecs_program):
    write(tmp_path / "s", level=1e-3)
    counts = {}
    for model in ("pecs", "esim", "v2e", "voltmeter", "icns"):
        out = tmp_path / f"{model}.csv"
        sense(pecs_program, tmp_path / "s", "-o", out, "--model", model, "--chip", "davis346")
        counts[model] = len(read_csv(out))
        config = json.loads((tmp_path / f"{model}.csv.run.json").read_text())["config"]
        assert config["model"]["name"] == model and (model == "pecs") != ("white_a" in config["model"])
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


# ---- inputs of other programs ---------------------------------------------------------------------------------------


def write_exr(path, channels, kind="float", corner=(0, 0), full=None, **attributes):
    """Channels {name: [H, W]} by OpenImageIO, `corner` the first pixel of a picture of `full` size."""
    oiio = pytest.importorskip("OpenImageIO")
    values = np.stack(list(channels.values()), axis=-1).astype(np.float32)
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
    spec.channelnames = list(channels)
    spec.x, spec.y = corner
    spec.full_width, spec.full_height = full or (values.shape[1], values.shape[0])
    for key, value in attributes.items():
        spec.attribute(key, value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec) and out.write_image(values) and out.close()


def picture(i):
    x = np.arange(W)
    return np.broadcast_to(0.1 + 0.9 * np.exp(4 * np.cos(2 * np.pi * (x / W - i / N)) - 4), (H, W))


LAYOUTS = {
    "spectral EXR": {"S0.500,000000nm": 1, "S0.600nm": 1, "R": 0, "T.500nm": 0},
    "pbrt Radiance.C01…": {f"Radiance.C{k:02}": 1 for k in range(1, 32)} | {"Albedo.R": 0},
    "RGB EXR": {"R": 1, "G": 1, "B": 1, "A": 0},
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_exr_files_of_others(tmp_path, pecs_program, layout):
    folder = tmp_path / "s"
    folder.mkdir()
    for i in range(N):  # natural order: 2 before 10
        write_exr(folder / f"shot.{i}.exr", {n: picture(i) * on for n, on in LAYOUTS[layout].items()})
    args = ["--fps", 1000, "--gain", "1e-15", "--chip", "ideal"]
    sense(pecs_program, folder, "-o", tmp_path / "o.csv", *args)
    record = json.loads((tmp_path / "o.csv.run.json").read_text())
    assert record["config"]["input"] == layout
    # All bands alike: the logarithm moves as the picture does, whatever the layout.
    events = read_csv(tmp_path / "o.csv")
    first = events[(events[:, 1] == 0) & (events[:, 2] == 0) & (events[:, 0] < N * 500)]
    assert len(first) == math.floor(math.log(1 / (0.1 + 0.9 * math.exp(-8))) / 0.2) and (first[:, 3] == 0).all()
    if layout != "RGB EXR":
        done = pecs_program("sense", folder, "-o", tmp_path / "n.csv", "--fps", 1000, "--quiet")
        assert done.returncode == 4 and "--fnumber" in done.stderr
    (folder / "shot.9.exr").unlink()
    write_exr(folder / "shot.9.exr", {"Z": picture(0)})
    done = pecs_program("sense", folder, "-o", tmp_path / "n.csv", *args, "--quiet")
    assert done.returncode == 4 and "shot.9.exr" in done.stderr and not (tmp_path / "n.csv").exists()


def test_a_file_as_pbrts_spectral_film_writes_it(tmp_path, pecs_program, root):
    """pbrt-v4, film.cpp, SpectralFilm::GetImage and Image::WriteEXR (5f7a606): half, R, G, B and the means over equal
    buckets named by their middles with three decimals; the data window is that of a crop."""
    folder = tmp_path / "s"
    folder.mkdir()
    buckets, low_nm, high_nm, radiance = 4, 400, 800, 0.25
    middles = [low_nm + (i + 0.5) * (high_nm - low_nm) / buckets for i in range(buckets)]
    names = ["R", "G", "B"] + [f"S0.{nm:.3f}nm".replace(".", ",").replace("S0,", "S0.") for nm in middles]
    assert names[3] == "S0.450,000nm"
    more = {"spectralLayoutVersion": "1.0", "emissiveUnits": "W.m^-2.sr^-1", "samplesPerPixel": 16}
    for i in range(3):
        light = {n: np.full((6, 8), radiance * 2.0**i if n[0] == "S" else 7.0) for n in names}
        write_exr(folder / f"{i}.exr", light, "half", corner=(10, 5), full=(40, 20), **more)
    done = sense(
        pecs_program, folder, "-o", tmp_path / "o.csv", "--fps", 100, "--fnumber", 4, "--chip", "imx636",
        "--no-noise", "--set", "corner_hz_per_a=0", "--set", "refractory_period_s=0", "--json",
    )  # fmt: skip
    assert json.loads((tmp_path / "o.csv.run.json").read_text())["config"]["input"] == "spectral EXR"
    # i = e / (h c) A f q sum lambda QE pi L / (4 N^2) dlambda, every bucket 100 nm wide.
    chip = json.loads((root / "sensor/chips/imx636.json").read_text())
    v = {k: entry["value"] for k, entry in chip["values"].items()}
    qe = np.interp(middles, chip["relative_qe"]["lambda_nm"], chip["relative_qe"]["value"])
    watts = math.pi * radiance / (4 * 4**2) * 100 * v["pixel_pitch_m"] ** 2 * v["fill_factor"] * v["peak_qe"]
    amperes = 1.602176634e-19 / (6.62607015e-34 * 299792458) * np.sum(np.array(middles) * 1e-9 * qe) * watts
    results = json.loads(done.stdout)
    assert results["photocurrent_a"]["median"] == pytest.approx(amperes, rel=1e-3)
    assert results["width"] == 8 and results["events"] == 6 * 8 * math.floor(math.log(4) / v["contrast_threshold_on"])


def test_a_spectral_film_of_mitsuba(tmp_path, pecs_program):
    """Rendered by Mitsuba 3 itself: a lamp that brightens, seen directly, under bands of 20 nm."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_spectral")
    folder = tmp_path / "s"
    folder.mkdir()
    lambda_nm = range(420, 681, 20)
    bands = {
        f"S0_{k}nm": {"type": "irregular", "wavelengths": f"{k - 10},{k},{k + 10}", "values": "0,1,0"}
        for k in lambda_nm
    }
    film = {"type": "specfilm", "width": 8, "height": 6, "rfilter": {"type": "box"}, **bands}
    for i in range(4):
        radiance = {"type": "uniform", "value": 2.0**i}
        sensor = {"type": "perspective", "film": film, "sampler": {"type": "independent", "sample_count": 256}}
        lamp = {"type": "constant", "radiance": radiance}
        scene = mi.load_dict({"type": "scene", "i": {"type": "direct"}, "s": sensor, "l": lamp})
        mi.render(scene, seed=1)
        scene.sensors()[0].film().bitmap().write(str(folder / f"{i}.exr"))
    args = ["--fps", 100, "--fnumber", 4, "--chip", "ideal"]
    sense(pecs_program, folder, "-o", tmp_path / "o.csv", *args)
    assert json.loads((tmp_path / "o.csv.run.json").read_text())["config"]["input"] == "spectral EXR"
    # Every pixel's light doubles thrice: ln 8 / .2 = 10.4 ON events each.
    events = read_csv(tmp_path / "o.csv")
    counts = np.zeros((6, 8), int)
    np.add.at(counts, (events[:, 2].astype(int), events[:, 1].astype(int)), 1)
    assert (events[:, 3] == 1).all() and (counts == 10).all()


def to_srgb(v):
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


def write_pictures(folder, ending, count=N, size=None):
    import cv2

    folder.mkdir()
    for i in range(count):
        light = picture(i)
        if ending == "png":
            image = np.round(255 * to_srgb(light)).astype(np.uint8)
        elif ending == "16.png":
            image = np.round(65535 * to_srgb(light)).astype(np.uint16)
        else:
            image = light.astype(np.float32)
        cv2.imwrite(str(folder / f"{i}.{ending}"), np.dstack([image] * 3) if ending == "png" else image)
    return folder


@pytest.mark.parametrize("ending", ["png", "16.png", "tif"])
def test_pictures(tmp_path, pecs_program, ending):
    pytest.importorskip("cv2")
    folder = write_pictures(tmp_path / "p", ending)
    times = tmp_path / "times.txt"
    times.write_text("# us\n" + "".join(f"{1000 * i}\n" for i in range(N)))
    args = ["--chip", "ideal", "--times-us", times]
    sense(pecs_program, folder, "-o", tmp_path / "o.csv", *args)
    frames = np.stack([picture(i) for i in range(N)]).astype(np.float32)
    import pecs

    events, expected = read_csv(tmp_path / "o.csv"), pecs.simulate(frames, 1000.0 * np.arange(N), chip="ideal")
    assert len(events) == pytest.approx(len(expected), rel=0.03 if ending == "png" else 0.002)
    record = json.loads((tmp_path / "o.csv.run.json").read_text())
    assert record["config"]["input"] == "pictures" and record["config"]["white_photocurrent_a"] == 1e-12
    times.write_text("0\n1000\n500\n")
    done = pecs_program("sense", folder, "-o", tmp_path / "n.csv", *args, "--quiet")
    assert done.returncode == 4 and "line 3" in done.stderr


def test_video_and_colour_space(tmp_path, pecs_program):
    cv2 = pytest.importorskip("cv2")
    video = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 500, (W * 4, H * 4))
    if not video.isOpened():
        pytest.skip("needs an MJPG encoder")
    for i in range(N):
        video.write(cv2.resize(np.dstack([np.round(255 * to_srgb(picture(i))).astype(np.uint8)] * 3), (W * 4, H * 4)))
    video.release()
    done = sense(pecs_program, tmp_path / "v.avi", "-o", tmp_path / "o.csv", "--chip", "ideal", "--json")
    result = json.loads(done.stdout)
    assert result["frames"] == N and result["events"] > 10000 and result["width"] == 4 * W
    assert result["t_last_us"] == pytest.approx(N * 2000, rel=0.2)  # the file's own 500 frames/s
    # Live, without a display: the events, and a video of them.
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    live = [
        tmp_path / "v.avi",
        "-o",
        tmp_path / "live.csv",
        "--chip",
        "ideal",
        "--source",
        "video",
        "--view",
        "--picture-us",
        4000,
    ]
    for display in ({}, {"DISPLAY": ":99999"}):  # none, and one that does not answer
        done = pecs_program("sense", *live, env=env | display)
        assert done.returncode == 0, done.stderr
        assert done.stderr.strip() == f"pecs: no display: the events are shown in {tmp_path}/live.csv.mp4"
        assert len(read_csv(tmp_path / "live.csv")) == result["events"]
        shown = cv2.VideoCapture(str(tmp_path / "live.csv.mp4"))
        assert shown.get(cv2.CAP_PROP_FRAME_COUNT) == pytest.approx(N * 2000 / 4000, abs=2)
        (tmp_path / "live.csv.mp4").unlink()
    # An OpenColorIO config whose one space is the square of light: contrasts in ln double.
    (tmp_path / "c.ocio").write_text(
        "ocio_profile_version: 2\nroles: {scene_linear: lin, default: lin}\nfile_rules:\n"
        "  - !<Rule> {name: Default, colorspace: default}\n"
        "displays:\n  d:\n    - !<View> {name: v, colorspace: lin}\n"
        "colorspaces:\n  - !<ColorSpace> {name: lin}\n"
        "  - !<ColorSpace>\n    name: root\n    to_scene_reference: !<ExponentTransform> {value: 2}\n"
    )
    folder = write_pictures(tmp_path / "p", "tif")
    args = ["--fps", 1000, "--chip", "ideal", "--json"]
    plain = json.loads(sense(pecs_program, folder, "-o", tmp_path / "a.csv", *args).stdout)["events"]
    args += ["--ocio", tmp_path / "c.ocio", "--colorspace"]
    squared = json.loads(sense(pecs_program, folder, "-o", tmp_path / "b.csv", *args, "root").stdout)["events"]
    assert squared == pytest.approx(2 * plain, rel=0.05)
    done = pecs_program("sense", folder, "-o", tmp_path / "n.csv", *args, "nope", "--quiet")
    assert done.returncode == 2 and "nope" in done.stderr and len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["--source", "camera:97", "--view", "--seconds", 1], 3, "camera 97: cannot be opened: no such camera"),
        (["--source", "camera"], 2, "--source camera: got no --view"),
        (["x.avi", "--source", "camera", "--view"], 2, "x.avi: got an input beside --source camera"),
        (["--source", "video", "--view"], 2, "input: got nothing"),
        (["no.avi", "--source", "video", "--view"], 3, "no.avi: cannot be opened: no such file"),
    ],
)
def test_a_live_source_that_is_not_there(tmp_path, pecs_program, args, code, words):
    done = pecs_program("sense", *args, "-o", tmp_path / "o.csv")
    assert done.returncode == code and words in done.stderr and len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_monte_carlo_bands(tmp_path, pecs_program):
    """31 bands, the light between two spectra: the error of a draw falls as 1 / sqrt(N)."""
    lambdas = np.linspace(400, 700, 31)
    x = np.linspace(0, 1, W)[None, None, :]
    warm, cool = (np.exp(-(((lambdas - m) / 60) ** 2))[:, None, None] + 0.05 for m in (620, 470))
    stack = {
        "pecs_stack": 1, "quantity": "irradiance", "width": W, "height": H, "pixel_pitch_m": 4.86e-6,
        "bands": [{"lambda_nm": float(v), "weight_nm": 10.0} for v in lambdas],
        "times_ns": [0, 1000000], "period_ns": None, "lens": None, "scene": {}, "render": {}, "versions": {},
    }  # fmt: skip
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
