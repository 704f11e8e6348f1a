"""Automatic exposure of a DAVIS: it follows the light, and depends on nothing but light, chip and seed."""

import numpy as np
import pecs
import pytest
from pecs.stack import StackWriter
from support.small_stacks import stack_json

PERIOD_US, W, H, WANTED = 40_000, 32, 24, 0.5
AUTO = {"frame_auto_mean": WANTED, "frame_exposure_s": 0.004, "frame_step": 0.3}
CHIP = {"chip": "davis346", "seed": 3, "readout": "ideal", "photocurrent_a": 1e-12}
CHANGES_US = 800_000, 1_600_000  # to an eighth, and back
END_US, SETTLED = 2_400_000, 14  # SETTLED: frames


def level(t_us):
    return np.where((t_us >= CHANGES_US[0]) & (t_us < CHANGES_US[1]), 0.125, 1.0)


def light_at(t_us):
    """[T, H, W]: still, with two steps by a factor of 8."""
    return (level(t_us)[:, None, None] * np.linspace(0.7, 1.5, W)).repeat(H, 1).astype(np.float32)


def simulate(t_us, step=None, light=light_at, **options):
    """Events and frames of light that is fed in chunks of `step` pictures."""
    events = []
    with pecs.Sensor(W, H, chip_frames=True, labels=True, **CHIP | {"overrides": AUTO} | options) as sensor:
        step = step or len(t_us)
        for i in range(0, len(t_us), step):
            events.append(sensor.push(light(t_us[i : i + step]), t_us[i : i + step]))
        events.append(sensor.finish())
        return np.concatenate(events), sensor.take_frames()


@pytest.fixture(scope="module")
def stepped():
    return simulate(np.arange(0, END_US + 1, 2000))


def middle_means(frames):
    """As shares of the ADC's range, of each frame."""
    values = np.sort(frames.values.reshape(len(frames.values), -1), 1)
    return values[:, W * H // 4 : -(W * H // 4)].mean(1) / (2**frames.bits - 1)


def test_exposure_converges_to_the_wanted_mean(stepped):
    _, frames = stepped
    exposure_us, means = frames.end_us - frames.begin_us, middle_means(frames)
    assert len(means) == END_US // PERIOD_US and (frames.begin_us == PERIOD_US * np.arange(len(means))).all()
    assert exposure_us[0] == 4000
    law = np.clip(np.rint(exposure_us * (1 + 0.765 * (WANTED - means))), 10, 25_000)  # that of davis_ros_driver
    assert np.array_equal(exposure_us[1:], law[:-1])
    for change_us in (0, *CHANGES_US):
        first = change_us // PERIOD_US
        settled = means[first + SETTLED : first + CHANGES_US[0] // PERIOD_US]
        assert len(settled) == 6 and np.abs(settled - WANTED).max() < 0.03
        assert first == 0 or abs(means[first] - WANTED) > 0.3
    dark, bright = exposure_us[CHANGES_US[1] // PERIOD_US - 1], exposure_us[CHANGES_US[0] // PERIOD_US - 1]
    assert 6 < dark / bright < 8.5


def test_events_by_frames_follow_the_exposures(stepped):
    events, frames = stepped
    by_frames = events[events["label"] == pecs.sensor.LABELS.index("frame")]
    assert len(by_frames) > 0.5 * W * H * len(frames.values)
    for polarity, edges_us in ((1, frames.begin_us), (0, frames.end_us)):
        fired_us = by_frames["t"][by_frames["p"] == polarity]
        late_us = fired_us - edges_us[np.searchsorted(edges_us, fired_us, "right") - 1]
        assert (np.abs(late_us) < 20).mean() > 0.9
        assert len(np.unique(np.searchsorted(edges_us, fired_us, "right"))) > 0.95 * len(edges_us)


@pytest.mark.parametrize("more", [{"step": 1}, {"step": 7}, {"threads": 1}, {"threads": 3}], ids=str)
def test_chunks_and_threads_change_nothing(more, stepped):
    events, frames = simulate(np.arange(0, END_US + 1, 2000), **more)
    assert np.array_equal(events, stepped[0])
    for got, wanted in zip(frames, stepped[1], strict=True):
        assert np.array_equal(got, wanted)


def test_the_distance_of_planes_changes_nothing():
    """Light that is linear between planes 40 ms apart."""
    knots_us = np.arange(0, 1_000_001, 40_000)
    levels = 0.6 + 0.4 * np.cos(2e-6 * np.pi * 1.5 * knots_us)

    def light(t_us):
        return (np.interp(t_us, knots_us, levels)[:, None, None] * np.linspace(0.7, 1.5, W)).repeat(H, 1)

    found = [simulate(np.arange(0, 1_000_001, d_us), light=light, noise=False) for d_us in (500, 2000, 40_000)]
    frames, counts = [f for _, f in found], []
    for events, _ in found:
        counts.append(np.count_nonzero(events["label"] == pecs.sensor.LABELS.index("frame")))
    assert len(frames[0].values) == 25 and np.ptp(frames[0].end_us - frames[0].begin_us) > 2000
    for other in frames[1:]:
        assert np.abs(other.end_us - frames[0].end_us).max() <= 1
        assert np.abs(other.values.astype(int) - frames[0].values).max() <= 1
    assert min(counts) > 10_000 and max(counts) < 1.02 * min(counts), counts


def libcaer(exposure_us, values, bits):
    """The next exposure, by libcaer's law, of a frame that has the last one set."""
    share = values.ravel() / 2.0**bits
    low, high = (np.mean(of) - 0.33 for of in (share < 25 / 256, share >= 230 / 256))
    missing = 2.5 - np.average(1 + np.floor(5 * share), weights=share)
    near = min(abs(low), abs(high))
    if (low >= 0) != (high >= 0):
        change = int(14_000 * max(low, high) ** 1.65) * (1 if low >= 0 else -1)
        change = change or (1 if low >= 0 else -1)
    else:
        change = int(int(100 * missing**2) / (10 if near < 0.05 else 5 if near < 0.1 else 1))
        change = max(change, 1) * np.sign(missing) if abs(missing) > 0.1 else 0
    return np.clip(exposure_us + change, 1, PERIOD_US - 6000)


@pytest.mark.parametrize("row_s", [0, 0.002], ids=["global", "rolling"])
def test_the_law_of_libcaer(row_s):
    """Up and down by at most 7.2 ms, slowly near the aim; a frame counts that has the last exposure set."""
    overrides = {"frame_auto_libcaer": 1, "frame_exposure_s": 0.0003, "frame_row_s": row_s}
    _, frames = simulate(np.arange(0, END_US + 1, 2000), overrides=overrides)
    exposure_us, wanted = frames.end_us - frames.begin_us, [300]
    late = 2 if row_s else 1  # the exposure that a frame changes, after its own
    for k in range(1, len(exposure_us)):
        of, last = k - late, wanted[-1]
        counts = of >= 0 and wanted[of] == last
        wanted.append(libcaer(last, frames.values[of], frames.bits) if counts else last)
    assert np.array_equal(exposure_us, wanted)
    changes_us = np.diff(exposure_us)
    assert changes_us.max() > 1000 and changes_us.min() < -400 and (np.abs(changes_us) < 100).sum() > 10


@pytest.fixture(scope="module")
def stack(tmp_path_factory):
    """Light of `stepped`, with another unit."""
    t_us = np.arange(0, END_US + 1, 2000)
    folder = tmp_path_factory.mktemp("auto") / "s"
    with StackWriter(folder, stack_json(W, H, (1000 * t_us).tolist())) as writer:
        for i, plane in enumerate(light_at(t_us)):
            writer.write_frame(i, plane[None])
    return folder


def exposures(folder):
    return np.loadtxt(folder / "exposures.csv", np.int64, delimiter=",", skiprows=1, ndmin=2)[:, 1:]


@pytest.fixture(scope="module")
def options(stack):
    """Of pecs.sense, for the photocurrent of `stepped`."""
    unit_a = float(pecs.Chip("davis346").photocurrent(stack, [0], gain=1)[0].max() / 1.5)
    return {"chip": "davis346", "seed": 3, "readout": "ideal", "gain": 1e-12 / unit_a, "overrides": AUTO}


def test_the_program_has_the_exposures_of_the_sensor(stepped, stack, options, tmp_path):
    pecs.sense(stack, tmp_path / "o.npz", frames=tmp_path / "f", **options)
    found, wanted = exposures(tmp_path / "f"), np.stack(stepped[1][1:3], 1)
    assert found.shape == wanted.shape and np.abs(found - wanted).max() <= 2  # the unit is rounded
    assert len(pecs.read(tmp_path / "o.npz")) == pytest.approx(len(stepped[0]), rel=0.01)


def test_a_later_window_has_the_exposures_of_the_whole(stack, options, tmp_path):
    start_us = 10 * PERIOD_US
    for name, more in {"whole": {}, "later": {"start_us": start_us, "duration_us": 8 * PERIOD_US}}.items():
        pecs.sense(stack, tmp_path / f"{name}.npz", frames=tmp_path / name, **options, **more)
    later = exposures(tmp_path / "later") + start_us
    assert np.array_equal(later, exposures(tmp_path / "whole")[10:18])


def test_aedat4_has_the_exposures(stack, options, tmp_path):
    dv = pytest.importorskip("dv_processing")
    out = tmp_path / "o.aedat4"
    pecs.sense(stack, out, frames=out, **options)
    pecs.sense(stack, tmp_path / "o.npz", frames=tmp_path / "f", **options)
    recording = dv.io.MonoCameraRecording(str(out))
    for begin_us, end_us in exposures(tmp_path / "f"):
        frame = recording.getNextFrame()
        assert frame.timestamp == begin_us
        assert frame.exposure.total_seconds() == pytest.approx(1e-6 * (end_us - begin_us))
    assert recording.getNextFrame() is None


def test_long_loops_are_simulated_whole(tmp_path):
    """Loops of more than 128 MiB are otherwise simulated band by band, but an exposure depends on all rows."""
    with StackWriter(tmp_path / "s", stack_json(346, 100, list(range(0, 10**9, 10**6)), period_ns=10**9)) as writer:
        for i in range(1000):
            writer.write_frame(i, np.full((1, 100, 346), 1e-4 * (1 + (i > 200)), np.float32))
    overrides = {"frame_auto_mean": WANTED, "frame_period_s": 0.024, "frame_exposure_s": 0.004}
    options = {"chip": "davis346", "model": "esim", "noise": False, "overrides": overrides, "duration_us": 480_000}
    pecs.sense(tmp_path / "s", tmp_path / "o.npz", frames=tmp_path / "f", **options)
    exposure_us = np.diff(exposures(tmp_path / "f"))[:, 0]
    assert len(exposure_us) == 20 and exposure_us[-1] < 0.7 * exposure_us[8]


def test_rolling_rows_that_end_after_the_next_begin():
    """The exposure is then that after the last frame which was complete."""
    settings = AUTO | {"frame_row_s": 0.002}  # 46 ms from row to row in all, more than a period
    _, frames = simulate(np.arange(0, CHANGES_US[0], 2000), overrides=settings)
    exposure_us, means = frames.end_us - frames.begin_us, middle_means(frames)
    assert exposure_us[0] == exposure_us[1] == 4000
    law = np.clip(np.rint(exposure_us[1:-1] * (1 + 0.765 * (WANTED - means[:-2]))), 10, 25_000)
    assert np.array_equal(exposure_us[2:], law) and np.abs(means[-3:] - WANTED).max() < 0.03


@pytest.mark.parametrize(
    ("values", "frames", "words"),
    [
        (["frame_auto_mean=0.5"], False, "--set frame_auto_mean=0.5: has no effect without --frames"),
        (["frame_exposure_s=0.005"], False, "--set frame_exposure_s=0.005: has no effect without --frames"),
        (["frame_auto_gain=1"], True, "--set frame_auto_gain=1: has no effect without frame_auto_mean"),
        (
            ["frame_auto_libcaer=1", "frame_auto_mean=0.5"],
            True,
            "frame_auto_mean: got 0.5, wanted 0 with frame_auto_lib",
        ),
        (["frame_auto_libcaer=1", "frame_auto_gain=1"], True, "frame_auto_gain=1: has no effect without frame_auto_m"),
        (["frame_auto_mean=1"], True, "frame_auto_mean: got 1, wanted a number in [0, 0.95]"),
    ],
)
def test_values_without_effect_are_refused(values, frames, words, stack, tmp_path, pecs_program):
    args = [word for value in values for word in ("--set", value)] + (["--frames", tmp_path / "f"] if frames else [])
    done = pecs_program("sense", stack, "-o", tmp_path / "o.npz", "--chip", "davis346", "--quiet", *args)
    assert done.returncode == 2 and words in done.stderr, done.stderr
    assert not (tmp_path / "f").exists() and not (tmp_path / "o.npz").exists()


def test_a_sensor_without_frames_refuses_values_of_frames():
    with pytest.raises(pecs.PecsError, match="frame_auto_mean=0.5: has no effect without chip_frames"):
        pecs.Sensor(8, 8, "davis346", overrides={"frame_auto_mean": 0.5})
