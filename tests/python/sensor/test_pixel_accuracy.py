"""Event times from 1 kHz frames against the same scene at 100 kHz (pixel_accuracy.py, on a smaller picture)."""

import pytest
from support import load_script


def test_times_against_100_khz(root):
    pixel_accuracy = load_script(root / "scripts/bench/pixel_accuracy.py")
    got = pixel_accuracy.measure(12, 1000, (150, 130))["pecs"]
    assert got["true_events"] > 10_000
    assert got["recall"] > 0.997 and got["precision"] > 0.997
    assert got["smooth"]["median_us"] < 0.4
    assert got["edges"]["median_us"] < 180
    assert abs(got["smooth"]["bias_us"]) < 0.2
    # Events come at all phases of a frame, as the truth's do.
    assert got["clumping"] == pytest.approx(got["true_clumping"], rel=0.1)
