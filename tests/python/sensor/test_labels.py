"""Numbers of what is seen, between two planes of them and at events' times: against a scene that is known."""

import numpy as np
import pecs
import pytest
from support.labels import OBJECTS, STEP_US, H, Rectangle, W, write_truth
from support.moving_scene import write_stack


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.37, 0.5, 0.81, 1.0])
@pytest.mark.parametrize("step", [(12.0, 4.0), (-9.5, 0.0), (0.3, 0.2), (0.0, 25.0)])
def test_a_rectangle_before_a_background(step, fraction):
    scene = Rectangle(step)
    found = pecs.carry_labels(scene.ids(0), scene.ids(1), scene.motion(), fraction)
    wanted = scene.ids(fraction)
    assert found.dtype == np.int32 and set(np.unique(found)) == {2, 3, 7}
    wrong = found != wanted
    assert not (wrong & ~scene.is_rim(fraction)).any()
    # On the rim, where the nearest pixel decides, few.
    assert wrong.sum() <= 0.35 * scene.is_rim(fraction).sum()


def test_ids_are_not_blended_and_the_nearer_hides():
    """Hidden at both ends: what stands behind is not seen; what comes from behind is, from the other side."""
    scene = Rectangle(step=(12.0, 0.0), drift=(0.0, 0.0))
    first, second = 1000 * scene.ids(0), 1000 * scene.ids(1)
    found = pecs.carry_labels(first, second, scene.motion(), 0.5)
    assert set(np.unique(found)) == {2000, 3000, 7000}
    assert found[26, 22] == 2000 and first[26, 22] == 7000  # uncovered: the second plane's
    assert found[26, 47] == 3000 and second[26, 47] == 7000  # not yet covered: the first one's
    # Unknown motion: the id that both have there, or 0.
    nan = np.full((20, H, W), np.nan)
    unknown = pecs.carry_labels(first, second, nan, 0.5)
    assert np.array_equal(unknown, np.where(first == second, first, 0)) and (unknown == 0).sum() > 100


def test_wrong_arguments_are_refused():
    ids, motion = np.ones((H, W), int), np.zeros((20, H, W))
    assert np.array_equal(pecs.carry_labels(ids.astype(np.float32), ids.astype(np.uint8), motion[:2], 0.3), ids)
    for arguments in (
        (ids, ids[:-1], motion, 0.5),
        (ids[None], ids[None], motion, 0.5),
        (ids, ids, motion[:3], 0.5),
        (ids, ids, motion, 1.01),
        (ids + 0.5, ids, motion, 0.5),
        (ids * 2**40, ids, motion, 0.5),
    ):
        with pytest.raises(ValueError):
            pecs.carry_labels(*arguments)


def events_at(t_us, x, y):
    out = np.zeros(len(t_us), pecs.EVENT_DTYPE)
    out["t"], out["x"], out["y"] = t_us, x, y
    return out


def random_events(count, end_us):
    random = np.random.default_rng(3)
    return events_at(
        np.sort(random.integers(0, end_us + 1, count)), random.integers(0, W, count), random.integers(0, H, count)
    )


@pytest.mark.parametrize("light", [True, False])
def test_events_get_what_their_pixel_saw(tmp_path, light):
    scene = Rectangle()
    truth = write_truth(tmp_path / "truth", scene, 3, light)
    events = random_events(20_000, 3 * STEP_US)
    found = pecs.event_labels(events, truth)
    assert found.dtype == np.uint16 and set(np.unique(found)) == {2, 3, 7}
    x, y, at = (events[name].astype(float) for name in "xyt")
    outline, line = scene.edges(x, y, at / STEP_US)
    wanted = np.where(outline < 0, 7, np.where(line < 0, 2, 3))
    rim = (np.abs(outline) < 1.25) | (np.abs(line) < 1.25)
    assert np.array_equal(found[~rim], wanted[~rim]) and (~rim).sum() > 15_000
    assert np.mean(found[rim] != wanted[rim]) < 0.35


def test_a_period_repeats_the_stack(tmp_path):
    """A rectangle moves there and, in the interval that closes the period, back."""
    there = Rectangle(drift=(0.0, 0.0))
    back = Rectangle(step=(-12.0, -4.0), drift=(0.0, 0.0), at=(20.3 + 12, 20.6 + 4))
    objects = OBJECTS, [there.ids(k)[None].astype(np.float32) for k in (0, 1)]
    motions, times = [there.motion(), back.motion()], [0, 1000 * STEP_US]
    truth = write_stack(
        tmp_path / "s", [np.ones((H, W), np.float32)] * 2, times, motions, period_ns=2 * times[1], more=[objects]
    )
    events = random_events(20_000, 5 * STEP_US)
    found = pecs.event_labels(events, truth)
    x, y, at = (events[name].astype(float) for name in "xyt")
    t = at / STEP_US % 2
    outlines = [scene.edges(x, y, t - k)[0] for k, scene in enumerate((there, back))]
    outline, line = np.where(t < 1, *outlines), there.edges(x, y, t)[1]
    wanted = np.where(outline < 0, 7, np.where(line < 0, 2, 3))
    rim = (np.abs(outline) < 1.25) | (np.abs(line) < 1.25)
    assert np.array_equal(found[~rim], wanted[~rim]) and (~rim).sum() > 15_000


def test_time_counts_from_the_first_instant(tmp_path):
    scene = Rectangle()
    truth = write_truth(tmp_path / "truth", scene, 2)
    events = random_events(3000, 2 * STEP_US)
    wanted = pecs.event_labels(events, truth)
    later = events.copy()
    later["t"] += 500
    with pecs.StackReader(truth) as stack:
        assert np.array_equal(pecs.event_labels(later, stack, begin_us=500), wanted)
    outside = events_at([-1, 0, 2 * STEP_US, 2 * STEP_US + 1], 5, 5)
    assert pecs.event_labels(outside, truth).tolist() == [0, 2, 2, 0]
    assert len(pecs.event_labels(events[:0], truth)) == 0


def test_subpixels(tmp_path):
    """The middle of an event's pixel lies in one of four pixels of the files."""
    scene = Rectangle(drift=(0.0, 0.0), step=(0.0, 0.0))
    truth = write_truth(tmp_path / "truth", scene, 1, light=False, subpixels=2)
    y, x = np.mgrid[: H // 2, : W // 2].reshape(2, -1)
    found = pecs.event_labels(events_at(np.full(len(x), 100), x, y), truth)
    assert np.array_equal(found.reshape(H // 2, W // 2), scene.ids(0)[1::2, 1::2])


def test_a_truth_without_light_tells_its_layers(tmp_path, pecs_program):
    done = pecs_program("info", write_truth(tmp_path / "truth", Rectangle(), 1, light=False))
    assert done.returncode == 0 and "objects: instance" in done.stdout and "band" not in done.stdout, done.stderr


def test_wrong_inputs_are_one_line(tmp_path):
    scene = Rectangle()
    truth = write_truth(tmp_path / "truth", scene, 1)
    events = random_events(10, STEP_US)
    with pytest.raises(ValueError, match="layer: got ids, wanted one of light, motion, objects"):
        pecs.event_labels(events, truth, "ids")
    for layer in ("motion", "light"):
        with pytest.raises(ValueError, match="wanted one channel, at instants"):
            pecs.event_labels(events, truth, layer)
    with pytest.raises(ValueError, match="wanted the order of time"):
        pecs.event_labels(events[::-1], truth)
    with pytest.raises(ValueError, match=r"pixel: got \(80, 0\), wanted one of 80x60"):
        pecs.event_labels(events_at([5], 80, 0), truth)
    with pytest.raises(pecs.PecsNotFoundError):
        pecs.event_labels(events, tmp_path / "none")
    still = write_stack(tmp_path / "still", [np.ones((H, W), np.float32)] * 2, [0, 1000], more=[(OBJECTS, [])])
    with pytest.raises(ValueError, match="layers: got no motion"):
        pecs.event_labels(events, still)
    for value in (0.5, -1, 65536):
        bad = write_truth(tmp_path / str(value), scene, 1, ids=[np.full((H, W), value)] * 2)
        with pytest.raises(ValueError, match=f"objects: got {value}, wanted whole numbers"):
            pecs.event_labels(events, bad)
    bad = write_truth(tmp_path / "bad", scene, 1)
    (bad / "objects_000001.exr").unlink()
    with pytest.raises(pecs.PecsNotFoundError, match="objects_000001.exr"):
        pecs.event_labels(events, bad)
