"""Frames that a chip also takes: noise, exposure along the motion, the files."""

import json

import cv2
import numpy as np
import pecs
import pytest
from pecs.stack import StackWriter
from support import ROOT
from support.moving_scene import Scene, write_stack
from support.small_stacks import N, stack_json, write

CHIP = "davis346"
GAIN_E, READ_NOISE_E, OFFSET_DN, DARK_HZ = 32, 55, 50, 18000
ELECTRON_C = 1.602176634e-19
STEP_NS = 10_000_000


def values(folder, bits=10):
    """DN [frames, H, W], and images.txt's times [us]."""
    rows = [line.split() for line in (folder / "images.txt").read_text().splitlines()]
    pictures = np.array([cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED) for _, name in rows])
    assert pictures.dtype == np.uint16 and not (pictures & (1 << 16 - bits) - 1).any()
    t_us = np.array([round(float(t) * 1e6) for t, _ in rows])
    exposures = np.loadtxt(folder / "exposures.csv", np.int64, delimiter=",", skiprows=1, ndmin=2)
    assert (exposures[:, 0] == range(len(t_us))).all() and (exposures[:, 1:].sum(1) // 2 == t_us).all()
    return (pictures >> 16 - bits).astype(int), t_us


def take(stack, tmp_path, name="frames", chip=CHIP, bits=10, **options):
    report = pecs.sense(stack, tmp_path / f"{name}.npz", chip=chip, frames=tmp_path / name, **options)
    return *values(tmp_path / name, bits), report


def test_photon_transfer_gives_gain_and_read_noise(tmp_path):
    """The temporal variance over the mean of a still grey wedge, as for a real camera."""
    levels, rows, exposure_s = 24, 100, 0.002
    with StackWriter(tmp_path / "s", stack_json(levels, rows, [0, 10**9, 2 * 10**9])) as writer:
        for i in range(3):
            wedge = np.broadcast_to(np.linspace(0, 1, levels), (1, rows, levels))
            writer.write_frame(i, (1.4e-3 * wedge).astype(np.float32))
    times = {"frame_period_s": 0.008, "frame_exposure_s": exposure_s}
    dn, t_us, report = take(tmp_path / "s", tmp_path, overrides=times)
    assert len(dn) == 250 and (np.diff(t_us) == 8000).all() and t_us[0] == 1000
    assert report["results"]["chip_frames"]["frames"] == 250
    wedge_a = pecs.Chip(CHIP).photocurrent(tmp_path / "s", [0])[0, 0].astype(float)
    electrons = (wedge_a + 3e-17) / ELECTRON_C * exposure_s + DARK_HZ * exposure_s
    assert 25000 < electrons[-1] < 31000
    mean, variance = dn.mean((0, 1)), dn.var(0, ddof=1).mean(0) - 1 / 12  # the ADC's rounding
    assert np.polyfit(electrons, mean, 1)[0] * GAIN_E == pytest.approx(1, rel=0.02)
    slope, dark = np.polyfit(mean - OFFSET_DN, variance, 1, w=1 / variance)
    assert 1 / slope == pytest.approx(GAIN_E, rel=0.02)
    assert np.sqrt(dark) / slope == pytest.approx(READ_NOISE_E, rel=0.02)
    fixed = (dn.mean(0) - mean)[:, -6:].std() / (mean[-6:].mean() - OFFSET_DN)
    assert fixed == pytest.approx(0.042, rel=0.1)  # of 600 pixels


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """A textured ellipse that moves 8 px in 10 ms, and on."""
    scene = Scene(96, 72, step=(8.0, 2.0), finest_px=12.0, radii=(22.0, 16.0), samples=4)
    frames, motion = [scene.frame(t) for t in (0.0, 1.0, 0.0)], scene.motion()
    motions = [motion, motion[[*range(10, 20), *range(10)]]]
    return write_stack(tmp_path_factory.mktemp("m") / "s", frames, [k * STEP_NS for k in range(3)], motions)


@pytest.mark.parametrize("row_s", [0, 2e-5], ids=["global", "rolling"])
def test_a_frame_is_the_light_over_its_exposure(row_s, moving, tmp_path):
    settings = {"frame_period_s": 0.01, "frame_exposure_s": 0.004, "frame_row_s": row_s, "frame_gain_e": 8}
    settings |= {"frame_adc_bits": 16, "frame_dark_hz": 0, "frame_offset_dn": 0, "dark_current_a": 0}
    profile = tmp_path / "fine.json"  # values beyond the camera's ranges
    pecs_chip = json.loads((ROOT / f"sensor/chips/{CHIP}.json").read_text())
    for key, value in settings.items():
        table = pecs_chip["frames" if key.startswith("frame") else "values"]
        table[key] |= {"value": value, "range": [value, value]}
    profile.write_text(json.dumps(pecs_chip))
    dn, t_us, _ = take(moving, tmp_path, chip=profile, bits=16, noise=False)
    assert len(dn) == 2 and (t_us == np.array([2000, 12000]) + round(row_s * 35.5e6)).all()
    with pecs.Light(moving, CHIP) as light:
        for k, picture in enumerate(dn):
            mean_a = light.exposure(10_000 * k, 4000, 1e6 * row_s, steps=400)[0]
            frame_a = 8 * ELECTRON_C / 0.004 * picture
            error = np.abs(frame_a - mean_a) / mean_a.max()
            assert (error < 0.01).mean() > 0.998 and error.max() < 0.03  # the edge is that of other planes
            sharp = light.at(10_000 * k + 2000)[0]
            assert np.abs(frame_a - sharp).max() > 0.15 * mean_a.max()  # the edge is blurred


def test_frames_depend_on_nothing_but_light_and_seed(moving, tmp_path):
    options = {"seed": 3, "overrides": {"frame_period_s": 0.009, "frame_exposure_s": 0.003}}
    dn, _, _ = take(moving, tmp_path, "a", **options)
    for name, more in {"one": {"threads": 1}, "three": {"threads": 3}, "esim": {"model": "esim"}}.items():
        assert np.array_equal(take(moving, tmp_path, name, **options, **more)[0], dn)
    assert not np.array_equal(take(moving, tmp_path, "seed", **options | {"seed": 4})[0], dn)


@pytest.mark.parametrize("auto", [0, 0.5])
def test_events_by_frames_depend_on_nothing_but_light_and_seed(auto, moving, tmp_path):
    settings = {"frame_period_s": 0.009, "frame_exposure_s": 0.003, "frame_step": 0.3, "frame_auto_mean": auto}
    options = {"chip": CHIP, "seed": 3}
    none = pecs.sense(moving, tmp_path / "none.npz", **options)["results"]["events"]
    options["overrides"] = settings
    for name, more in {"a": {}, "one": {"threads": 1}, "three": {"threads": 3}}.items():
        labels = tmp_path / f"{name}.npy"
        pecs.sense(moving, tmp_path / f"{name}.npz", frames=tmp_path / name, labels=labels, **options, **more)
        assert np.array_equal(pecs.read(tmp_path / f"{name}.npz"), pecs.read(tmp_path / "a.npz"))
        by_frames = np.load(labels) == pecs.sensor.LABELS.index("frame")
        assert len(by_frames) > 1.2 * none and 0.1 < by_frames.mean() < 0.9


SHORT = {"overrides": {"frame_period_s": 0.024, "frame_exposure_s": 0.002}, "readout": "ideal", "model": "esim"}


def test_a_refractory_period_may_end_with_a_part_of_an_interval():
    """ON events at the begin of exposures, which lie on planes: eight such periods are a plane's distance."""
    count = {}
    for period_s in (4.9e-4, 5e-4):
        values = {"frame_exposure_s": 0.03, "frame_period_s": 0.06, "frame_dead_s": 0.01, "frame_step": 0.1}
        values |= {"refractory_period_s": period_s}
        options = {"chip_frames": True, "time_unit": "us", "photocurrent_a": 1e-12, "seed": 1, "overrides": values}
        with pecs.Sensor(90, 90, "davis240c", **options) as sensor:
            light = np.broadcast_to(np.geomspace(0.02, 1, 90, dtype=np.float32), (61, 90, 90))
            events = sensor.push(light, 4000.0 * np.arange(61))
            events = np.concatenate([events, sensor.finish()])
        count[period_s] = np.count_nonzero((events["t"] % 60_000 < 600) & (events["p"] == 1))
    assert count[4.9e-4] > 1000 and count[5e-4] == pytest.approx(count[4.9e-4], rel=0.05), count


def test_a_refractory_period_may_end_with_an_exposure():
    """All pixels have an event where an exposure begins. The planes decided which of them had rested when it ended."""
    values = {"frame_exposure_s": 0.002, "frame_period_s": 0.024, "refractory_period_s": 0.002, "frame_step": 0.4}
    values |= {"frame_step_spread": 0, "threshold_mismatch": 0, "leak_rate_hz": 0, "background_on_hz": 0}
    for distance_us in (500, 1700, 5000):
        options = {"chip_frames": True, "noise": False, "readout": "ideal", "overrides": values}
        light = np.full((200_000 // distance_us, 8, 8), 0.5, np.float32)
        events, *_ = pecs.simulate(light, distance_us * np.arange(len(light)), "davis346", **options)
        polarities = events["p"][events["t"] < 190_000]
        assert len(polarities) == 8 * 64 * 2 and polarities.all(), distance_us


def test_a_later_window_has_the_frames_of_the_whole(tmp_path):
    write(tmp_path / "s", period_ns=N * 1_000_000, level=1e-4)
    dn, t_us, _ = take(tmp_path / "s", tmp_path, "whole", **SHORT, duration_us=120_000)
    later, later_us, _ = take(tmp_path / "s", tmp_path, "later", **SHORT, start_us=24_000, duration_us=96_000)
    assert len(dn) == 5 and np.array_equal(later, dn[1:]) and np.array_equal(later_us, t_us[:4])


def test_loops_in_bands_of_rows_take_whole_frames(tmp_path):
    """Loops of more than 128 MiB are simulated band by band; all rows of the light are the same."""
    write(tmp_path / "s", frames=1000, period_ns=10**9, level=1e-4, size=(100, 346))
    dn, t_us, _ = take(tmp_path / "s", tmp_path, **SHORT, duration_us=120_000, noise=False)
    assert len(dn) == 5 and (t_us == 1000 + 24_000 * np.arange(5)).all()
    assert (dn == dn[:, :1]).all() and dn.std() > 20


def test_aedat4_holds_frames_among_events(moving, tmp_path, pecs_program):
    out = tmp_path / "o.aedat4"
    settings = {"frame_period_s": 0.009, "frame_exposure_s": 0.003}
    dn, t_us, _ = take(moving, tmp_path, overrides=settings)
    pecs.sense(moving, out, chip=CHIP, frames=out, overrides=settings)
    assert np.array_equal(pecs.read(out), pecs.read(tmp_path / "frames.npz"))
    assert "frames       2\n" in pecs_program("info", out).stdout
    dv = pytest.importorskip("dv_processing")
    recording = dv.io.MonoCameraRecording(str(out))
    assert recording.isFrameStreamAvailable() and recording.isEventStreamAvailable()
    for picture, middle_us in zip(dn, t_us, strict=True):
        frame = recording.getNextFrame()
        assert (frame.timestamp, frame.exposure.total_seconds()) == (middle_us - 1500, 0.003)
        assert np.array_equal(frame.image, picture >> 2)
    assert recording.getNextFrame() is None
    packets = []  # in the order of the file
    for packet in pytest.importorskip("aedat").Decoder(str(out)):
        packets.append(packet["frame"]["exposure_end_t"] if "frame" in packet else packet["events"]["t"])
    for k, packet in enumerate(packets):
        if np.isscalar(packet):
            assert packets[k - 1][-1] < packet <= packets[k + 1][0]


@pytest.mark.parametrize("step", [1, 7, 100])
def test_frames_in_memory_are_those_of_the_program(step, tmp_path):
    """For any chunks of frames, and from any time on."""
    chip = dict(chip=CHIP, overrides={"frame_period_s": 0.009, "frame_exposure_s": 0.003}, seed=5, readout="ideal")
    light, times = np.random.default_rng(1).random((40, 24, 32)).astype(np.float32), 2000.0 * np.arange(40)
    with StackWriter(tmp_path / "s", stack_json(32, 24, [round(1000 * t) for t in times])) as writer:
        for i, frame in enumerate(light):
            writer.write_frame(i, frame[None])
    unit_a = float(pecs.Chip(CHIP).photocurrent(tmp_path / "s", [0], gain=1)[0].max() / light[0].max())
    pecs.sense(tmp_path / "s", tmp_path / "o.npz", frames=tmp_path / "f", gain=1e-12 / unit_a, **chip)
    wanted, middle_us = values(tmp_path / "f")
    with pecs.Sensor(32, 24, photocurrent_a=1e-12, chip_frames=True, **chip) as sensor:
        for i in range(0, 40, step):
            sensor.push(light[i : i + step], 5e6 + times[i : i + step])
        sensor.finish()
        taken = sensor.take_frames()
        assert len(sensor.take_frames().values) == 0
    assert len(wanted) == 9 and wanted.std() > 50 and taken.bits == 10 and taken.values.dtype == np.uint16
    assert (taken.end_us - taken.begin_us == 3000).all() and (taken.begin_us + 1500 - 5_000_000 == middle_us).all()
    assert np.abs(taken.values.astype(int) - wanted).max() <= 1  # the unit is rounded
    whole = pecs.simulate(light, 5e6 + times, photocurrent_a=1e-12, chip_frames=True, **chip)[1]
    assert np.array_equal(whole.values, taken.values)


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["--frames", "f"], 2, "wanted one with frames"),
        (["--chip", CHIP, "--frames", "OUT"], 2, "wanted a new folder, or an output in AEDAT4"),
        (["--chip", CHIP, "--frames", "OLD"], 5, "it exists"),
        (["--chip", CHIP, "--set", "frame_exposure_s=0.05"], 2, "frame_period_s: got 0.04, wanted at least 0.056"),
        (["--chip", "imx636", "--set", "frame_exposure_s=0.05"], 2, "unknown key"),
    ],
)
def test_wrong_frames(args, code, words, moving, tmp_path, pecs_program):
    (tmp_path / "old").mkdir()
    names = {"OUT": tmp_path / "o.npz", "OLD": tmp_path / "old", "f": tmp_path / "f"}
    done = pecs_program("sense", moving, "-o", tmp_path / "o.npz", "--quiet", *[names.get(a, a) for a in args])
    assert done.returncode == code and words in done.stderr, done.stderr
    assert not (tmp_path / "f").exists()


def test_a_chip_without_frames_takes_none_in_memory():
    with pytest.raises(pecs.PecsInputError, match="chip_frames: got chip imx636, wanted one with frames"):
        pecs.Sensor(8, 8, chip_frames=True)


def test_light_that_is_none_is_the_last_light_of_frames_as_of_events():
    """One value that is not finite made the pixel black in its frame."""
    t_us, light = 1000.0 * np.arange(41), np.full((41, 4, 6), 0.25)
    options = {"chip": CHIP, "chip_frames": True, "noise": False}
    options["overrides"] = {"frame_exposure_s": 0.01, "frame_period_s": 0.02}
    wanted = pecs.simulate(light, t_us, **options)[1].values
    dark = np.where(np.arange(6) == 3, 0, light)
    black = pecs.simulate(dark, t_us, **options)[1].values
    light[7, 1, 2], light[3:9, 2, 2], light[25, 0, 0] = np.nan, np.inf, np.nan
    light[:, :, 3] = -1
    with pytest.warns(UserWarning, match="8 not finite, 164 negative"):
        found = pecs.simulate(light, t_us, **options)[1].values
    assert (
        len(found) == 2
        and 300 < wanted.min()
        and wanted.max() < 1000
        and np.array_equal(np.delete(found, 3, 2), np.delete(wanted, 3, 2))
    )
    assert np.array_equal(found[:, :, 3], black[:, :, 3])
