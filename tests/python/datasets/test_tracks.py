"""Tracks of points between any two times, against the scene in closed form."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from pecs.datasets import Sequence
from support import small_sequence as small

LEFT = small.rig()[0]


def directions(pixels, **_setting):
    """Directions of pecs' pixels, through the distortion of the left camera."""
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-14)
    xy = cv2.undistortPointsIter((pixels - 0.5).reshape(-1, 1, 2), LEFT.K, LEFT.distortion, None, None, stop)[:, 0]
    return np.concatenate([xy, np.ones((len(xy), 1))], 1)


def pixels(points):
    known = np.isfinite(points).all(-1)
    out = np.full((len(points), 2), np.nan)
    if known.any():
        out[known] = cv2.projectPoints(points[known], np.zeros(3), np.zeros(3), LEFT.K, LEFT.distortion)[0][:, 0] + 0.5
    return out


@pytest.fixture(scope="module")
def camera(sequence):
    """The left camera, whose lens is OpenCV's model."""
    left = Sequence(sequence.folder).cameras["left"]
    left.__dict__["view"] = SimpleNamespace(lens=SimpleNamespace(directions=directions), pixels=pixels, setting={})
    return left


def sought(points, at_us, times):
    """Positions and depths, and whether the ray to each position meets the point first."""
    world, _, ids, _ = LEFT.look(at_us, directions(points + 0.5))
    found, seen = [], []
    for t in times:
        moved = LEFT.moved(world, ids, at_us, t)
        at, z = LEFT.project(moved, t)
        first = LEFT.look(t, directions(at + 0.5))[1]
        inside = ((at > -0.5) & (at < [LEFT.width - 0.5, LEFT.height - 0.5])).all(1)
        found.append(at), seen.append(inside & (z < first * 1.001))
    return np.array(found), np.array(seen), ids


@pytest.mark.parametrize("at_us", [0, 50_000, 100_000, 33_000, 78_500])
def test_points_follow_their_surfaces(camera, at_us):
    rng = np.random.default_rng(at_us)
    points = rng.uniform([2, 2], [93, 69], (400, 2))
    times = [0.0, 12_345.0, 30_000.0, 61_000.0, 100_000.0]
    want, seen, ids = sought(points, at_us, times)
    got, visible = camera.tracks(points, at_us, times)
    known = np.isfinite(got).all((0, 2))
    assert known.mean() > 0.99 and {small.CARD, small.WALL} == set(ids[known])
    error = np.linalg.norm(got - want, axis=-1)[:, known]
    # At an edge the surface is that of the nearest pixel's centre, so that a few points are on another one.
    assert np.median(error) < 1e-5 and np.mean(error < 0.02) > 0.98
    good = known & (np.linalg.norm(got - want, axis=-1).max(0) < 0.02)
    assert np.mean(visible[:, good] == seen[:, good]) > 0.97
    assert (~visible[:, good] & ~seen[:, good]).sum() > 5  # hidden by the card, or outside


def test_there_and_back(camera):
    points = np.array([[48.0, 40.0], [20.25, 30.5], [70.0, 20.0]])
    (there,), seen = camera.tracks(points, 20_000, 60_000)
    assert seen.all()
    (back,), _ = camera.tracks(there, 60_000, 20_000)
    np.testing.assert_allclose(back, points, atol=0.01)


def test_what_is_not_known(camera):
    got, seen = camera.tracks([[-3, 5], [200, 5]], 0, [0, 50_000])
    assert np.isnan(got).all() and not seen.any() and got.shape == (2, 2, 2)
    for at_us, times in ((100_002, [0]), (0, [-3.0])):
        with pytest.raises(IndexError, match="us of truth"):
            camera.tracks([[5, 5]], at_us, times)
