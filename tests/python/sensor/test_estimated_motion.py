"""Pictures that move by more than a pixel: `pecs sense` estimates their motion."""

import json

import cv2
import numpy as np
import pecs
import pytest
from support.small_stacks import read_csv, sense

H, W, FPS, FRAMES = 48, 80, 60, 7
CHIP = ("--chip", "ideal", "--photocurrent", "1pA")


def texture(seed, high=400):
    """Light 0.05 to 0.9, smooth over a few pixels."""
    noise = np.random.default_rng(seed).normal(size=(high, high)).astype(np.float32)
    grey = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return 0.05 + 0.85 * (np.clip(grey / grey.std(), -2, 2) + 2) / 4


def shifted(of, x, y, size=(W, H)):
    return cv2.warpAffine(of.astype(np.float32), np.float32([[1, 0, x], [0, 1, y]]), size, flags=cv2.INTER_CUBIC).clip(
        0.02, 1
    )


TEXTURE = texture(1)


def panned(t_s, of=TEXTURE):
    return shifted(of, -100 - 220 * t_s, -100 - 60 * t_s)  # 3.8 px from frame to frame


def encoded(light):
    return np.round(255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055))


def write(folder, frames):
    folder.mkdir()
    for i, light in enumerate(frames):
        cv2.imwrite(str(folder / f"{i}.png"), encoded(light).astype(np.uint8))
    return folder


def simulated(pecs_program, folder, *args, fps=FPS):
    """Events t, x, y, p and the record."""
    out = folder.parent / f"{len(list(folder.parent.iterdir()))}.csv"
    sense(pecs_program, folder, "-o", out, "--fps", fps, *CHIP, *args)
    return read_csv(out), json.loads((out.parent / f"{out.name}.run.json").read_text())


def matched(of, among, within_us=3000):
    """Share of the events with one of the same pixel and polarity."""
    places = {}
    for t, x, y, p in among:
        places.setdefault((x, y, p), []).append(t)
    times = {key: np.array(t) for key, t in places.items()}
    none = np.array([1e18])
    return np.mean([np.abs(times.get((x, y, p), none) - t).min() <= within_us for t, x, y, p in of])


def test_a_moving_texture_is_followed(tmp_path, pecs_program):
    end_us = 1e6 * (FRAMES - 1) / FPS
    dense = np.arange(0, end_us, 500.0)
    truth = pecs.simulate(np.stack([panned(1e-6 * t) for t in dense]), dense, "ideal", photocurrent_a=1e-12)
    truth = np.stack([truth[name].astype(float) for name in "txyp"], axis=1)
    folder = write(tmp_path / "f", [panned(i / FPS) for i in range(FRAMES)])
    inside = lambda e: e[(e[:, 1] > 8) & (e[:, 1] < W - 8) & (e[:, 2] > 4) & (e[:, 2] < H - 4)]  # noqa: E731
    truth = inside(truth)
    found, record = simulated(pecs_program, folder)
    plain, without = simulated(pecs_program, folder, "--no-flow")
    found, plain = inside(found), inside(plain)
    assert len(found) / len(truth) == pytest.approx(1, abs=0.05)
    assert matched(truth, found) > 0.95 and matched(found, truth) > 0.95
    assert matched(truth, plain) < 0.85  # the frames alone
    motion = record["results"]["motion_estimate"]
    assert motion["median_px"] == pytest.approx(np.hypot(220, 60) / FPS, rel=0.05) and motion["number_of_cuts"] == 0
    assert record["config"]["motion"] and not without["config"]["motion"]
    assert "motion_estimate" not in without["results"] and record["results"]["unsure"]["share"] < 0.15


def test_rows_of_a_rolling_shutter_have_their_own_times(tmp_path, pecs_program):
    """Frames of an edge whose rows are 200 us apart: without the option, events are early by that from row to row."""
    row_us, px_per_s, y, x = 200, 240, *np.mgrid[:H, :W]

    def edge(t_s, along):
        u, v = (x - px_per_s * t_s, y + 0 * t_s) if along == "x" else (x + 0 * t_s, y - px_per_s * t_s)
        light = 1 / (1 + np.exp(((u if along == "x" else v) - 6) / 0.8))
        return (0.1 + 0.75 * light) * (1 + 0.07 * np.sin(u / 3) * np.cos(v / 2))

    def first_us(events):
        out = np.full((H, W), np.nan)
        for t, ex, ey, p in events[np.argsort(-events[:, 0])]:
            if p:
                out[int(ey), int(ex)] = t
        return out

    middle_us, end_us = row_us * (H - 1) / 2, 1e6 * (FRAMES - 1) / FPS  # the time of a frame is that of its middle row
    dense = np.arange(0, end_us, 500.0)
    for along in "xy":
        truth = np.stack([edge(1e-6 * (t + middle_us), along) for t in dense])
        truth = pecs.simulate(truth, dense, "ideal", photocurrent_a=1e-12)
        truth = first_us(np.stack([truth[name].astype(float) for name in "txyp"], axis=1))
        rolled = [edge(i / FPS + 1e-6 * row_us * y, along) for i in range(FRAMES)]
        folder = write(tmp_path / along, rolled)
        slopes, errors = [], []
        for words in ((), ("--rolling-shutter", f"{row_us * (H - 1)}us")):
            late = first_us(simulated(pecs_program, folder, *words)[0]) - truth
            late[:, [*range(16), *range(W - 8, W)]] = np.nan
            ok = np.isfinite(late) & (truth > 1e6 / FPS) & (truth < end_us - 1.5e6 / FPS)
            slopes.append(np.polyfit(y[ok], late[ok], 1)[0])
            errors.append(np.median(np.abs(late[ok])))
        assert errors[1] < 0.4 * errors[0]
        if along == "x":  # every row has the edge, and all times
            assert slopes[0] == pytest.approx(-row_us, rel=0.05) and abs(slopes[1]) < 0.05 * row_us
    for wrong in (f"{1e3 / FPS + 1}ms", "0us"):
        done = pecs_program("sense", folder, "-o", tmp_path / "no.csv", "--fps", FPS, *CHIP, "--rolling-shutter", wrong)
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1


def test_a_rolling_shutter_leaves_the_dark_at_an_edge(tmp_path, pecs_program):
    """A cubic fell to 0 next to an edge of 1 to 45, and a still background had more events than the edge."""
    y, x = np.mgrid[:H, :W]

    def bar(t_s):
        covered = np.clip(x - 10 - 250 * t_s + 0.5, 0, 1) * np.clip(24.5 + 250 * t_s - x, 0, 1)
        return (0.02 + 0.006 * np.sin(x / 2 + y)) * (1 - covered) + 0.9 * covered

    for name, row_s in (("global", 0), ("rolling", 0.008 / (H - 1))):
        (tmp_path / name).mkdir()
        for i in range(FRAMES):
            light = bar(i / FPS + row_s * (y - (H - 1) / 2)).astype(np.float32)
            cv2.imwrite(str(tmp_path / name / f"{i}.tif"), light)
    truth, _ = simulated(pecs_program, tmp_path / "global")
    found, _ = simulated(pecs_program, tmp_path / "rolling", "--rolling-shutter", "8ms")
    assert len(truth) > 5000 and len(found) == pytest.approx(len(truth), rel=0.25)


def test_slow_motion_and_flicker_change_nothing(tmp_path, pecs_program):
    still = panned(0)
    for name, frames in {
        "flicker": [still * (0.6 + 0.4 * np.cos(i)) for i in range(FRAMES)],
        "slow": [panned(i * 0.02 / FPS) for i in range(FRAMES)],
    }.items():
        folder = write(tmp_path / name, frames)
        found, record = simulated(pecs_program, folder)
        plain, _ = simulated(pecs_program, folder, "--no-flow")
        assert len(found) > (1000 if name == "flicker" else 0) and np.array_equal(found, plain)
        assert record["results"]["unsure"]["events"] == 0


def test_a_cut_is_reported(tmp_path, pecs_program):
    other = texture(2)
    folder = write(tmp_path / "f", [panned(i / FPS) if i < 3 else panned(i / FPS, other) for i in range(FRAMES)])
    found, record = simulated(pecs_program, folder, "--labels", tmp_path / "l.npy")
    motion, warnings = record["results"]["motion_estimate"], record["results"]["warnings"]
    assert motion["cuts"] == [2] and any("1 cuts, the first after frame 2" in line for line in warnings)
    labels, at_cut = np.load(tmp_path / "l.npy"), (found[:, 0] > 2e6 / FPS) & (found[:, 0] < 3e6 / FPS)
    unsure = labels == pecs.sensor.LABELS.index("unsure")
    assert unsure[at_cut].all() and unsure[~at_cut].mean() < 0.2
    assert record["results"]["unsure"]["events"] == unsure.sum()


def test_what_appears_behind_an_object_is_unsure(tmp_path, pecs_program):
    """A square passes before another texture: events of the truth are found less among the unsure ones."""
    behind, before = texture(3), texture(4)

    def scene(i):
        cover = cv2.warpAffine(np.ones((20, 20), np.float32), np.float32([[1, 0, 10 + 6.3 * i], [0, 1, 14]]), (W, H))
        return shifted(behind, -100, -100) * (1 - cover) + shifted(before, -150 + 6.3 * i, -150) * cover

    dense = np.arange(0, 1e6 * (FRAMES - 1) / FPS, 500.0)
    truth = pecs.simulate(np.stack([scene(1e-6 * t * FPS) for t in dense]), dense, "ideal", photocurrent_a=1e-12)
    truth = np.stack([truth[name].astype(float) for name in "txyp"], axis=1)
    folder = write(tmp_path / "f", [scene(i) for i in range(FRAMES)])
    found, record = simulated(pecs_program, folder, "--labels", tmp_path / "l.npy")
    unsure = np.load(tmp_path / "l.npy") == pecs.sensor.LABELS.index("unsure")
    assert 0.005 < unsure.mean() < 0.6 and (~unsure).sum() > 1000
    assert matched(found[~unsure], truth) > matched(found[unsure], truth) + 0.2
    t = found[:, 0] * 1e-6 * FPS
    left = 10 + 6.3 * t
    near = np.minimum(np.abs(found[:, 1] - left), np.abs(found[:, 1] - left - 20))
    assert near[unsure].mean() < near[~unsure].mean()


def test_threads_and_labels_change_nothing(tmp_path, pecs_program):
    folder = write(tmp_path / "f", [panned(i / FPS) for i in range(4)])
    first, record = simulated(pecs_program, folder, "--threads", 1)
    for args in (("--threads", 3), ("--labels", tmp_path / "l.npy")):
        again, other = simulated(pecs_program, folder, *args)
        assert np.array_equal(first, again) and other["results"]["unsure"] == record["results"]["unsure"]


def test_the_other_models(tmp_path, pecs_program):
    folder = write(tmp_path / "f", [panned(i / FPS) for i in range(4)])
    _, record = simulated(pecs_program, folder, "--model", "v2e")
    assert 0 <= record["results"]["unsure"]["share"] < 0.5 and record["results"]["dense_steps"] > 12


def test_size_and_crop_resample_light(tmp_path, pecs_program):
    """Four pixels of a file become one of their mean light; the part that --crop leaves out does not count."""
    light = [np.kron(panned(i / FPS), [[1.5, 0.5], [0.5, 1.5]]).clip(0, 1) for i in range(3)]
    part = [np.pad(frame, ((4, 2), (6, 8)), constant_values=0.5) for frame in light]
    small = [encoded(frame) / 255 for frame in light]
    linear = [np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4) for v in small]
    mean = [v.reshape(H, 2, W, 2).mean((1, 3)).astype(np.float32) for v in linear]
    (tmp_path / "mean").mkdir()
    for i, frame in enumerate(mean):
        cv2.imwrite(str(tmp_path / "mean" / f"{i}.tif"), frame)
    wanted, _ = simulated(pecs_program, tmp_path / "mean", "--no-flow")
    words = ("--crop", f"6,4,{2 * W},{2 * H}", "--size", f"{W}x{H}", "--no-flow")
    found, record = simulated(pecs_program, write(tmp_path / "f", part), *words)
    assert (record["results"]["width"], record["results"]["height"]) == (W, H)
    assert abs(len(found) / len(wanted) - 1) < 0.01 and matched(found, wanted, 50) > 0.99
    for wrong, message in {
        ("--size", "80x40"): "the middle has it with --crop 0,7,174,87",
        ("--set", "width=40", "--set", "height=40"): "(--crop 36,0,102,102 --size 40x40, or a smaller --size)",
        ("--crop", "100,0,80,40"): "within 174x102",
        ("--size", "0x40"): "wanted WIDTHxHEIGHT",
        ("--crop", "1,2,3"): "wanted X,Y,WIDTH,HEIGHT",
    }.items():
        done = pecs_program("sense", tmp_path / "f", "-o", tmp_path / "no.csv", "--fps", FPS, *CHIP, *wrong)
        assert done.returncode in (2, 4) and message in done.stderr and len(done.stderr.splitlines()) == 1


def warnings_of(pecs_program, folder, *args):
    return " ".join(simulated(pecs_program, folder, *args)[1]["results"]["warnings"])


def test_what_a_video_lacks_is_a_warning(tmp_path, pecs_program):
    frames = [panned(i / FPS) for i in range(3)]
    assert warnings_of(pecs_program, write(tmp_path / "good", frames)) == ""
    dark = [0.004 * frame for frame in frames]
    assert "8-bit values up to 5" in warnings_of(pecs_program, write(tmp_path / "dark", dark), "--no-flow")
    (tmp_path / "jpeg").mkdir()
    for i, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / "jpeg" / f"{i}.jpg"), encoded(frame), [cv2.IMWRITE_JPEG_QUALITY, 12])
    assert "blocks of 8 pixels" in warnings_of(pecs_program, tmp_path / "jpeg")
    exposure = np.linspace(0, 5 / FPS, 24)  # as long as five frames
    blurred = [np.mean([panned(i / FPS + t) for t in exposure], axis=0) for i in range(3)]
    assert "times as much along the motion" in warnings_of(pecs_program, write(tmp_path / "blurred", blurred))


def test_gamma_is_stated(tmp_path, pecs_program):
    """Values v of gamma 2 are the light v^2."""
    frames = [panned(i / FPS) for i in range(3)]
    (tmp_path / "light").mkdir()
    (tmp_path / "square").mkdir()
    for i, frame in enumerate(frames):
        root = np.round(65535 * np.sqrt(frame)).astype(np.uint16)
        cv2.imwrite(str(tmp_path / "square" / f"{i}.png"), root)
        cv2.imwrite(str(tmp_path / "light" / f"{i}.tif"), ((root / 65535.0) ** 2).astype(np.float32))
    found, _ = simulated(pecs_program, tmp_path / "square", "--colorspace", "gamma:2")
    wanted, _ = simulated(pecs_program, tmp_path / "light")
    assert abs(len(found) - len(wanted)) < 5 and matched(found, wanted, 5) > 0.99
    done = pecs_program("sense", tmp_path / "square", "-o", tmp_path / "n.csv", "--fps", 60, "--colorspace", "gamma:x")
    assert done.returncode == 2 and "wanted gamma:G" in done.stderr
