"""Events as planes, against plain loops in NumPy."""

import numpy as np
import pecs
import pytest

W, H, COUNT = 20, 12, 4000


@pytest.fixture(scope="module")
def events():
    random = np.random.default_rng(1)
    out = np.zeros(COUNT, pecs.EVENT_DTYPE)
    out["t"] = np.sort(random.integers(1000, 51_001, COUNT))
    out["x"], out["y"], out["p"] = (
        random.integers(0, W, COUNT),
        random.integers(0, H, COUNT),
        random.random(COUNT) < 0.6,
    )
    return out


def grid_of(events, bins, begin, end):
    """As rpg_e2vid's events_to_voxel_grid, over any window."""
    out = np.zeros((bins, H, W))
    for t, x, y, p in events.tolist():
        if not begin <= t <= end:
            continue
        at = (bins - 1) * (t - begin) / (end - begin) if end > begin else 0.0
        for b in range(bins):
            out[b, y, x] += (1 if p else -1) * max(0.0, 1 - abs(b - at))
    return out


@pytest.mark.parametrize("bins", [1, 2, 5, 16])
@pytest.mark.parametrize("window", [(1000, 51_000), (10_000, 20_000), (-5000.5, 60_000.25), (30_000, 30_000)])
def test_voxel_grid(events, bins, window):
    wanted = grid_of(events, bins, *window)
    found = pecs.voxel_grid(events, W, H, bins, *window)
    assert found.shape == (bins, H, W) and found.dtype == np.float32
    np.testing.assert_allclose(found, wanted, atol=1e-4)
    assert np.abs(wanted).sum() > 1 or window[0] == window[1]


def test_normalised_as_e2vid_does(events):
    grid = pecs.voxel_grid(events, W, H, 5, 0, 3000).astype(float)
    some = grid != 0
    assert 0.05 < some.mean() < 0.95
    wanted = np.where(some, (grid - grid[some].mean()) / grid[some].std(), 0)
    np.testing.assert_allclose(pecs.voxel_grid(events, W, H, 5, 0, 3000, normalise=True), wanted, atol=1e-5)
    alike = events[:1].copy()
    assert np.array_equal(pecs.voxel_grid(alike, W, H, 3, normalise=True), np.zeros((3, H, W)))
    assert not pecs.voxel_grid(events[:0], W, H, 3, normalise=True).any()


@pytest.mark.parametrize("window", [(1000, 51_000), (10_000, 20_000.5)])
def test_time_surface(events, window):
    begin, end = window
    wanted = np.zeros((2, H, W))
    for t, x, y, p in events.tolist():
        if begin <= t <= end:
            wanted[p, y, x] = np.exp(-(end - t) / 3000)
    found = pecs.time_surface(events, W, H, 3000, begin, end)
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    assert np.array_equal(pecs.time_surface(events[::-1], W, H, 3000, begin, end), found)
    assert 0 < np.count_nonzero(found) and (found[:, :, :] <= 1).all()


@pytest.mark.parametrize("bins", [1, 3])
def test_event_histogram(events, bins):
    begin, end = 5000, 20_000
    wanted = np.zeros((2, bins, H, W))
    for t, x, y, p in events.tolist():
        if begin <= t <= end:
            wanted[p, min(int((t - begin) * bins / (end - begin)), bins - 1), y, x] += 1
    found = pecs.event_histogram(events, W, H, bins, begin, end)
    assert np.array_equal(found, wanted.reshape(2 * bins, H, W)) and found.sum() > 500


def test_the_window_is_that_of_the_events(events):
    begin, end = events["t"][0], events["t"][-1]
    assert np.array_equal(pecs.voxel_grid(events, W, H, 4), pecs.voxel_grid(events, W, H, 4, begin, end))
    assert pecs.event_histogram(events, W, H).sum() == COUNT
    assert not pecs.time_surface(events[:0], W, H, 1000.0).any()


def test_arrays_of_others(events):
    """Fields of other types and strides; a buffer of the caller's."""
    other = np.zeros(COUNT, [("p", "?"), ("y", "<i4"), ("x", "<i2"), ("t", "<u8")])
    for name in "txyp":
        other[name] = events[name]
    wanted = pecs.voxel_grid(events, W, H, 3)
    out = np.full((3, H, W), np.nan, np.float32)
    assert pecs.voxel_grid(other[::1], W, H, 3, out=out) is out and np.array_equal(out, wanted)
    assert np.array_equal(pecs.event_histogram(other[::2], W, H), pecs.event_histogram(events[::2], W, H))
    read_only = np.broadcast_to(np.float32(0), (3, H, W)).copy()
    read_only.flags.writeable = False
    for bad in (
        read_only,
        out[:2],
        out.astype(float),
        out.transpose(1, 2, 0),
        np.zeros((3, H, 2 * W), np.float32)[:, :, ::2],
    ):
        with pytest.raises(ValueError, match="out: got"):
            pecs.voxel_grid(events, W, H, 3, out=bad)


def test_wrong_arguments_are_one_line(events):
    with pytest.raises(pecs.PecsInputError, match=r"events: pixel: got \(\d+, \d+\), wanted one of 19x12"):
        pecs.voxel_grid(events, W - 1, H)
    for call in (
        lambda: pecs.voxel_grid(events, W, H, 0),
        lambda: pecs.voxel_grid(events, W, H, 1 << 20),
        lambda: pecs.event_histogram(events, W, H, 0),
        lambda: pecs.voxel_grid(events, 0, H),
        lambda: pecs.voxel_grid(events, W, -1),
        lambda: pecs.voxel_grid(events, W, H, 3, 10, 5),
        lambda: pecs.voxel_grid(events, W, H, 3, float("nan"), 5),
        lambda: pecs.time_surface(events, W, H, 0.0),
        lambda: pecs.time_surface(events, W, H, float("nan")),
    ):
        with pytest.raises(ValueError, match="got .*, wanted"):
            call()
