"""`--warmup`: pixels that have been on before the first frame."""

import numpy as np
import pecs
import pytest
from pecs.sensor import LABELS
from pecs.stack import StackWriter
from support.small_stacks import stack_json, write

SIZE = (60, 80)
LEAK = {"leak_rate_hz": 5.0, "noise_std": 0, "background_on_hz": 0, "background_off_hz": 0, "hot_pixel_fraction": 0}


def still(i, values):
    return np.full_like(values, 1e-4)


def ramp(i, values):
    return np.full_like(values, 1e-4 * np.exp(0.02 * i))


def events(folder, tmp_path, **options):
    report = pecs.sense(folder, tmp_path / "e.h5", chip="davis346", format="dsec", readout="ideal", **options)
    return pecs.read(tmp_path / "e.h5", "dsec"), report["results"]


def test_leak_events_come_from_the_first_moment_on(tmp_path):
    """5 Hz in 4800 pixels for 100 ms: 2400. At rest, few pixels reach their threshold in that time."""
    folder = write(tmp_path / "s", frames=101, change=still, size=SIZE)
    at_rest, _ = events(folder, tmp_path, overrides=LEAK, duration_us=100_000)
    assert len(at_rest) < 10
    options = {"overrides": LEAK, "duration_us": 100_000, "labels": tmp_path / "c.npy"}
    found, _ = events(folder, tmp_path, warmup_us=20_000, **options)
    mismatch_and_poisson = 0.05
    wanted = 5.0 * 60 * 80 * 0.1
    assert abs(len(found) / wanted - 1) < mismatch_and_poisson
    assert (np.load(tmp_path / "c.npy") == LABELS.index("leak")).all()
    halves = np.histogram(found["t"], 4, (0, 100_000))[0]
    assert halves.min() > 0.8 * halves.mean()


def test_the_rate_of_a_ramp_is_even_from_the_start(tmp_path):
    """ln I rises by 20 per second: 20 / threshold events a second and pixel, without a silent time before the first."""
    folder = write(tmp_path / "s", frames=201, change=ramp, size=SIZE)
    quiet = {"overrides": LEAK | {"leak_rate_hz": 0.0}}
    first, later = {}, {}
    for warmup_us in (0, 20_000):
        found, _ = events(folder, tmp_path, **quiet, duration_us=180_000, warmup_us=warmup_us)
        counts = np.histogram(found["t"], 90, (0, 180_000))[0]  # of 2 ms
        first[warmup_us], later[warmup_us] = counts[1:3].mean(), counts[45:].mean()
    assert first[0] < 0.02 * later[0]
    assert abs(first[20_000] / later[20_000] - 1) < 0.1
    assert abs(later[20_000] / later[0] - 1) < 0.03


def test_a_slow_ramp_in_dim_light_is_not_silent_at_first(tmp_path):
    """2 per second at a corner of 10 Hz. If pixels stay as far from their thresholds as noise reaches once per second,
    the first 30 ms have a fifth of the later rate."""
    folder = write(tmp_path / "s", frames=202, change=lambda i, v: np.full_like(v, 1e-5 * np.exp(0.002 * i)), size=SIZE)
    quiet = {"background_on_hz": 0, "background_off_hz": 0, "hot_pixel_fraction": 0}
    found, report = events(folder, tmp_path, overrides=quiet, duration_us=200_000, warmup_us=20_000)
    assert 9 < report["corner_hz"]["median"] < 11
    counts = np.histogram(found["t"], 20, (0, 200_000))[0]
    assert 0.5 < counts[:3].mean() / counts[10:].mean() < 1.1


def test_noise_is_even_from_the_start(tmp_path):
    """In still light of a corner of 64 Hz, the rate of the first 5 ms is that of the last 14 ms of 29. For distances
    drawn evenly up to the threshold it is 1.7 times that, for pixels at rest half of it."""
    frames, size = 581, (120, 160)
    stack = stack_json(size[1], size[0], [i * 50_000 for i in range(frames)])
    with StackWriter(tmp_path / "s", stack) as writer:
        for i in range(frames):
            writer.write_frame(i, np.full((1, *size), 3e-5, np.float32))
    options = {"chip": "imx636", "format": "dsec", "readout": "ideal", "duration_us": 29_000, "warmup_us": 20_000}
    pecs.sense(tmp_path / "s", tmp_path / "e.h5", **options)
    counts = np.histogram(pecs.read(tmp_path / "e.h5", "dsec")["t"], 29, (0, 29_000))[0]
    assert 30 < counts[15:].mean() and abs(counts[:5].mean() / counts[15:].mean() - 1) < 0.25


def test_the_output_begins_at_the_first_frame(tmp_path):
    """Whatever the warm-up is, times and counts are those of the stack's window, and threads change nothing."""
    folder = write(tmp_path / "s", size=SIZE, level=1e-4, pixel_pitch_m=18.5e-6)
    one, report = events(folder, tmp_path, warmup_us=5_000, start_us=1_000, duration_us=20_000, threads=1)
    two, _ = events(folder, tmp_path, warmup_us=5_000, start_us=1_000, duration_us=20_000, threads=2)
    np.testing.assert_array_equal(one, two)
    assert len(one) > 1000 and one["t"][0] < 500 and 19_000 < one["t"][-1] < 20_000
    assert report["events"] == len(one) and report["warnings"] == []


def test_a_periodic_stack_has_loops_for_it(tmp_path):
    folder = write(tmp_path / "s", period_ns=24_000_000)
    with pytest.raises(pecs.PecsInputError, match="--warmup: got 5000 us, wanted --warmup-loops for a periodic stack"):
        pecs.sense(folder, tmp_path / "e.raw", warmup_us=5_000)


def test_a_later_window_has_the_events_of_the_whole(tmp_path):
    """Also after a warm-up, the readout is busy when the window begins; it began with an idle one."""
    folder = write(tmp_path / "s", frames=21, change=lambda i, values: ramp(8 * i, values), size=(12, 16))
    options = {"chip": "davis346", "warmup_us": 5000, "overrides": {"readout_rate_hz": 2e4}}
    pecs.sense(folder, tmp_path / "all.npz", **options)
    pecs.sense(folder, tmp_path / "part.npz", start_us=9050, duration_us=4000, **options)
    whole, part = pecs.read(tmp_path / "all.npz"), pecs.read(tmp_path / "part.npz")
    whole["t"] -= 9050
    assert np.array_equal(part, whole[(whole["t"] >= 0) & (whole["t"] < 4000)]) and len(part) > 20
