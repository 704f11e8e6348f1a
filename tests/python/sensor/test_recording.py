"""The sensor from outside: corner, rates, and the real recording."""

import json
import os
import subprocess
import sys

import numpy as np
import pecs
import pytest


def test_small_signal_corner_follows_the_light():
    """A lamp that flickers: the amplitude falls to 1/sqrt(2) where the frequency is kappa times the photocurrent."""
    kappa, dark = 2.9e15, 1e-17  # of the profile
    overrides = {
        "contrast_threshold_on": 0.01,
        "contrast_threshold_off": 0.01,
        "refractory_period_s": 0,
        "corner_hz_per_a": kappa,
        "amplifier_cutoff_hz": 0,
        "dark_current_a": dark,
    }
    for photocurrent in (1e-15, 1e-14, 1e-13):
        corner = kappa * (photocurrent + dark)
        counts = []
        for frequency in (corner / 30, corner):
            cycles, per_cycle = 8, 200
            t = np.arange(cycles * per_cycle + 1) / (per_cycle * frequency)
            lamp = (1 + 0.15 * np.sin(2 * np.pi * frequency * t)).astype(np.float32)
            frames = np.ascontiguousarray(np.broadcast_to(lamp[:, None, None], (len(t), 2, 2)))
            e = pecs.simulate(
                frames, t * 1e6, overrides=overrides, noise=False, photocurrent_a=photocurrent, readout="ideal"
            )
            settled = e[e["t"] > (cycles - 4) / frequency * 1e6]
            counts.append(len(settled))
        assert counts[1] / counts[0] == pytest.approx(1 / np.sqrt(2), rel=0.04), photocurrent


@pytest.fixture
def with_map(root, tmp_path):
    """A chip without other noise and with a pixel map of these contents."""

    def write(**contents):
        chip = json.loads((root / "sensor/chips/imx636.json").read_text())
        for key in ("noise_std", "leak_rate_hz", "refractory_period_s"):
            chip["values"][key]["value"] = 0
        text = {"pecs_pixel_map": 1, "source": "made up"} | contents
        (tmp_path / "pixels.json").write_text(json.dumps({k: v for k, v in text.items() if v is not None}))
        (tmp_path / "chip.json").write_text(json.dumps(chip | {"pixel_map": "pixels.json"}))
        return str(tmp_path / "chip.json")

    return write


def of_pixels(events, width, height):
    """Numbers of ON and of OFF events of each pixel."""
    pixel = events["y"].astype(int) * width + events["x"]
    return [np.bincount(pixel[events["p"] == p], minlength=width * height).reshape(height, width) for p in (1, 0)]


def test_a_pixel_map_sets_thresholds_of_its_region(with_map):
    """A ramp up and down: as many events as thresholds fit; outside the region as the profile says."""
    rng = np.random.default_rng(3)
    on, off = rng.uniform(0.7, 1.4, (2, 3, 5))
    chip = with_map(region=[4, 2, 5, 3], threshold_on=on.ravel().tolist(), threshold_off=off.ravel().tolist())
    t_us = np.arange(4001) * 500.0
    lamp = np.exp(5 * (1 - np.abs(1 - t_us / 1e6))).astype(np.float32)
    frames = np.ascontiguousarray(np.broadcast_to(lamp[:, None, None], (len(t_us), 8, 12)))
    overrides = {"contrast_threshold_on": 0.2, "contrast_threshold_off": 0.3, "threshold_mismatch": 0}
    overrides |= {"background_on_hz": 0, "background_off_hz": 0, "hot_pixel_fraction": 0}
    overrides |= {"corner_hz_per_a": 0, "amplifier_cutoff_hz": 0}
    counts = of_pixels(
        pecs.simulate(frames, t_us, time_unit="us", chip=chip, overrides=overrides, readout="ideal"), 12, 8
    )
    wanted = [np.full((8, 12), 5 / 0.2), np.full((8, 12), 5 / 0.3)]
    wanted[0][2:5, 4:9], wanted[1][2:5, 4:9] = 5 / 0.2 / on, 5 / 0.3 / off
    for got, number in zip(counts, wanted, strict=True):
        assert np.abs(got - number).max() < 2.1  # a rest of the way up counts for the way down


def test_a_pixel_map_sets_rates_and_hot_pixels(with_map):
    on, off = np.zeros((3, 40)), np.zeros((3, 40))
    on[0], off[1], on[2], off[2] = 20, 35, 5, 10
    table = {
        "region": [10, 1, 40, 3],
        "background_on_hz": on.ravel().tolist(),
        "background_off_hz": off.ravel().tolist(),
    }
    still, t_us = np.full((11, 6, 60), 0.5, np.float32), np.arange(11) * 5e5
    chip = with_map(**table, hot_pixels=[[3, 0, 200], [55, 5, 400]])
    overrides = {"background_on_hz": 2, "background_off_hz": 1, "hot_pixel_fraction": 0.1, "hot_pixel_hz": 900}
    e = pecs.simulate(still, t_us, time_unit="us", chip=chip, overrides=overrides, readout="ideal")
    found = of_pixels(e, 60, 6)
    hot = np.zeros((6, 60))
    hot[0, 3], hot[5, 55] = 200, 400
    outside = np.ones((6, 60), bool)
    outside[1:4, 10:50] = False
    for counts, hz, rates in zip(found, (2, 1), (on, off), strict=True):
        for row in range(3):
            expected = rates[row, 0] * 40 * 5
            assert abs(counts[1 + row, 10:50].sum() - expected) <= 4 * np.sqrt(expected)
        quiet = outside & (hot == 0)
        assert abs(counts[quiet].sum() - hz * quiet.sum() * 5) <= 4 * np.sqrt(hz * quiet.sum() * 5)
    for y, x in np.argwhere(hot > 0):
        assert abs(found[0][y, x] - (2 + hot[y, x]) * 5) < 5 * np.sqrt(hot[y, x] * 5)
    counts = found[1][2, 10:50]
    assert 0.5 < counts.var(ddof=1) / counts.mean() < 1.7  # Poisson
    assert len(pecs.simulate(still, t_us, time_unit="us", chip=chip, noise=False)) == 0
    two = pecs.Sensor(60, 6, chip, overrides=overrides, readout="ideal", time_unit="us")  # however the frames are given
    parts = [two.push(still[:4], t_us[:4]), two.push(still[4:], t_us[4:]), two.finish()]
    assert np.array_equal(np.concatenate(parts), e)


def test_a_sample_of_noise_rates_is_drawn_from(with_map):
    """Every pixel draws one entry of a map without region: here half of the pixels are silent."""
    chip = with_map(background_on_hz=[0, 40], background_off_hz=[0, 0])
    e = pecs.simulate(np.full((11, 40, 50), 0.5, np.float32), np.arange(11) * 1e5, chip=chip, readout="ideal")
    silent = 2000 - len(np.unique(e["y"].astype(int) * 50 + e["x"]))
    assert abs(silent - 1000) < 4 * np.sqrt(500) and (e["p"] == 1).all()
    assert len(e) / (2000 - silent) == pytest.approx(40, rel=0.03)


@pytest.mark.parametrize(
    ("contents", "words"),
    [
        ({"background_on_hz": [1, 2], "background_off_hz": [1]}, "background_off_hz: got 1 values, wanted 2"),
        ({"background_on_hz": [], "background_off_hz": []}, "0 values"),
        ({"background_on_hz": [1]}, "background_off_hz"),
        ({"background_on_hz": [-1], "background_off_hz": [0]}, "background_on_hz[0]"),
        ({"region": [0, 0, 1], "threshold_on": [1], "threshold_off": [1]}, "region"),
        ({"region": [0, 0, 2, 2], "threshold_on": [1], "threshold_off": [1]}, "wanted 4"),
        ({"region": [3, 0, 2, 1], "threshold_on": [1, 1], "threshold_off": [1, 1]}, "within the frames' 4x4"),
        ({"threshold_on": [0], "threshold_off": [1]}, "threshold_on[0]"),
        ({"hot_pixels": [[4, 0, 10]]}, "pixel 4,0"),
        ({"hot_pixels": [[1, 10]]}, "[x, y, Hz]"),
        ({"hot_pixels": [[1.5, 0, 10]]}, "x and y whole"),
        ({"region": [0, 0.5, 2, 1]}, "whole pixels"),
        ({"speed": 1}, "speed"),
        ({"source": None}, "source"),
    ],
)
def test_a_bad_pixel_map_is_named(with_map, contents, words):
    with pytest.raises(pecs.PecsError) as error:
        pecs.simulate(np.ones((3, 4, 4), np.float32), np.arange(3) * 1e3, chip=with_map(**contents))
    assert "pixels.json" in str(error.value) and words in str(error.value)


@pytest.mark.parametrize("chip", ["imx636", "gen3_vga", "davis346"])
def test_background_and_leak_rates(chip):
    """Within 2 % of the profile's, intervals exponential."""
    overrides = {"background_on_hz": 4.0, "background_off_hz": 6.0, "noise_std": 0.0, "refractory_period_s": 0.0}
    overrides["leak_rate_hz"] = 0.0
    still = np.full((11, 120, 120), 0.5, np.float32)
    t_us = np.arange(11) * 1e5
    e = pecs.simulate(still, t_us, time_unit="us", chip=chip, overrides=overrides, readout="ideal")
    pixels = 120 * 120
    assert (e["p"] == 1).sum() / pixels == pytest.approx(4, rel=0.02)
    assert (e["p"] == 0).sum() / pixels == pytest.approx(6, rel=0.02)
    order = np.lexsort((e["t"], e["y"].astype(int) * 120 + e["x"]))
    pixel, t = (e["y"].astype(int) * 120 + e["x"])[order], e["t"][order] * 1e-6
    gaps = np.diff(t)[np.diff(pixel) == 0]
    # Exponential, cut at the end of the second: the share of gaps below g is known up to that.
    expected = 1 - np.exp(-10 * 0.02)
    assert np.mean(gaps < 0.02) == pytest.approx(expected * 10 / (10 - 1 + np.exp(-10)) * (1 - 0.5 * 0.02), rel=0.03)
    leak = {"background_on_hz": 0.0, "background_off_hz": 0.0, "leak_rate_hz": 10.0, "noise_std": 0.0}
    leak |= {"threshold_mismatch": 0.0, "refractory_period_s": 0.0}
    e = pecs.simulate(np.full((51, 8, 8), 0.5, np.float32), np.arange(51) * 1e5, chip=chip, overrides=leak)
    assert len(e) / 64 / 5 == pytest.approx(10, rel=0.02) and (e["p"] == 1).all()


def test_real_recording(root, shared, pecs_program):
    """R_360_L with the shipped profile, only the light free: what docs/reference/sensor.md promises."""
    recording = shared / "data/real/R_360_L.hdf5"
    if not recording.is_file():
        pytest.skip(f"needs {recording}")
    environment = os.environ | {"PECS_PROGRAM": str(pecs_program("--version").args[0])}
    command = [sys.executable, root / "scripts/studies/fit_disk.py", recording]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    r = json.loads(done.stdout)
    for polarity in ("on", "off"):
        assert r["delay_overlap"][polarity] >= 0.95
        assert r["earth_mover_deg"][polarity] <= 1
        per_edge = r["events_per_edge"][polarity]
        assert per_edge["sim"] == pytest.approx(per_edge["real"], rel=0.06)
    assert 8 <= r["pair_sd_deg"]["simulated"] <= 11
    for real, simulated in zip(r["background_hz"]["real"], r["background_hz"]["simulated"], strict=True):
        assert simulated == pytest.approx(real, rel=0.2)
    assert r["paper"]["chamfer"] <= 2.15 and r["paper"]["gaussian"] <= 1.59
