"""`pecs sense` on what other programs write: spectral EXR files, pictures, video."""

import json
import math
import os

import cv2
import numpy as np
import pytest
from support.small_stacks import H, N, W, read_csv, sense, write_exr


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
        "--no-noise", "--set", "corner_hz_per_a=0", "--set", "amplifier_cutoff_hz=0", "--set", "refractory_period_s=0",
        "--json",
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
    folder = write_pictures(tmp_path / "p", ending)
    times = tmp_path / "times.txt"
    times.write_text("# us\n" + "".join(f"{1000 * i}\n" for i in range(N)))
    args = ["--chip", "ideal", "--times", times]
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
    # With --view, without a display: the events, and a video of them.
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    live = [tmp_path / "v.avi", "-o", tmp_path / "live.csv", "--chip", "ideal", "--view", "--window", 4000]
    for display in ({}, {"DISPLAY": ":99999"}):  # none, and one that does not answer
        done = pecs_program("sense", *live, env=env | display, check=True)
        assert done.stderr.splitlines()[-1] == f"pecs: warning: no display: the events are in {tmp_path}/live.csv.mp4"
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


@pytest.mark.parametrize("option", ["--mask", "--bias-file"])
def test_a_folder_is_no_text_file(tmp_path, pecs_program, option):
    """It was read as an empty one: a mask without pixels, biases without offsets."""
    folder = write_pictures(tmp_path / "p", "png")
    done = pecs_program("sense", folder, "--fps", 1000, "-o", tmp_path / "o.csv", option, tmp_path)
    assert done.returncode == 3 and f"{tmp_path}: cannot be opened: it is a directory" in done.stderr
    assert not (tmp_path / "o.csv").exists()


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["--view"], 2, "STACK is required"),
        (["no.avi", "--view"], 3, "no.avi: cannot be opened: no such file"),
        (["no.avi"], 3, "no.avi: cannot be opened: no such file or folder"),
    ],
)
def test_an_input_that_does_not_exist(tmp_path, pecs_program, args, code, words):
    done = pecs_program("sense", *args, "-o", tmp_path / "o.csv")
    assert done.returncode == code and words in done.stderr and len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
