"""The sensor from outside: corner, rates, and the real recording."""

import json
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


@pytest.mark.parametrize("chip", ["imx636", "gen3_vga", "davis346"])
def test_background_and_leak_rates(chip):
    """Within 2 % of the profile's, intervals exponential."""
    overrides = {"background_on_hz": 4.0, "background_off_hz": 6.0, "noise_std": 0.0, "refractory_period_s": 0.0}
    overrides["leak_rate_hz"] = 0.0
    still = np.full((11, 120, 120), 0.5, np.float32)
    t_us = np.arange(11) * 1e5
    e = pecs.simulate(still, t_us, chip=chip, overrides=overrides, readout="ideal")
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
    """R_360_L with the shipped profile, only the light free: what docs/sensor.md promises."""
    recording = shared / "data/real/R_360_L.hdf5"
    if not recording.is_file():
        pytest.skip(f"needs {recording}")
    program = pecs_program("--version").args[0]
    done = subprocess.run(
        [sys.executable, root / "scripts/fit_chip.py", recording, "--program", program], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    r = json.loads(done.stdout)
    for polarity in ("on", "off"):
        assert r["delay_overlap"][polarity] >= 0.95
        assert r["earth_mover_deg"][polarity] <= 1
    for real, simulated in zip(r["events_per_edge"]["real"], r["events_per_edge"]["simulated"], strict=True):
        assert simulated == pytest.approx(real, rel=0.05)
    assert 8 <= r["pair_sd_deg"]["simulated"] <= 11
    for real, simulated in zip(r["background_hz"]["real"], r["background_hz"]["simulated"], strict=True):
        assert simulated == pytest.approx(real, rel=0.2)
    assert r["paper"]["chamfer"] <= 2.15 and r["paper"]["gaussian"] <= 1.59
