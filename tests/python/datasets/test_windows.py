"""pecs.datasets.Windows: the windows' events, what is true of them, PyTorch's DataLoader and tonic's transforms."""

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import cv2
import numpy as np
import pecs
import pytest
from pecs.datasets import Sequence, Windows
from support import small_sequence as small

W, H = 96, 72
ALL = ("flow", "depth", "instances", "boxes", "frame", "causes", "objects")


@pytest.fixture
def data(sequence):
    return Windows(sequence, "left", window_us=20_000, fields=ALL)


def test_windows_by_time_hold_every_event_once(sequence, data):
    events = sequence.cameras["left"].events()
    assert len(data) == 5
    found = np.concatenate([item["events"] for item in (data[i] for i in range(len(data)))])
    for name in "txyp":
        np.testing.assert_array_equal(found[name], events[name])
    for i, item in enumerate(data[i] for i in range(5)):
        assert (item["start_us"], item["end_us"]) == (20_000 * i, 20_000 * (i + 1))
        inside = (events["t"] >= item["start_us"]) & (events["t"] < item["end_us"])
        np.testing.assert_array_equal(item["causes"], sequence.cameras["left"].causes()[inside])
        np.testing.assert_array_equal(item["objects"], sequence.cameras["left"].objects()[inside])


@pytest.mark.parametrize("window, step, count", [(30_000, 7_000, 11), (100_000, None, 1), (100_001, None, 0)])
def test_windows_that_overlap(sequence, window, step, count):
    events = sequence.cameras["left"].events()
    data = Windows(sequence, "left", window_us=window, step_us=step)
    assert len(data) == count
    for i in range(count):
        start = i * (step or window)
        want = events["t"][(events["t"] >= start) & (events["t"] < start + window)]
        np.testing.assert_array_equal(data[i]["events"]["t"], want)


def test_windows_by_count(sequence):
    events = sequence.cameras["right"].events()
    data = Windows(sequence, "right", by="count", count=3000, step=1000)
    assert len(data) == (len(events) - 3000) // 1000 + 1
    item = data[-1]
    first = (len(data) - 1) * 1000
    np.testing.assert_array_equal(item["events"]["t"], events["t"][first : first + 3000])
    assert (item["start_us"], item["end_us"]) == (events["t"][first], events["t"][first + 2999])


def test_all_cameras_of_all_sequences(sequence):
    data = Windows([sequence, Sequence(sequence.folder)], window_us=50_000)
    assert [data[i]["camera"] for i in range(len(data))] == ["left", "left", "right", "right"] * 2
    assert data[-1]["start_us"] == 50_000
    with pytest.raises(IndexError):
        data[8]


def test_truth_of_a_window(sequence, data):
    left, item = small.rig()[0], data[2]
    assert (item["truth_us"], item["flow_us"].tolist()) == (60_000, [40_000, 60_000])
    np.testing.assert_allclose(item["depth"][1], left.picture(left.look(60_000)[1]), rtol=1e-6)
    np.testing.assert_array_equal(item["instances"], left.picture(left.look(60_000)[2]))
    assert item["boxes"]["id"].tolist() == [small.CARD, small.WALL]
    picture = cv2.imread(str(sequence.cameras["frame"].frames()[2].path))  # 47.5 to 52.5 ms: its middle is nearest
    assert item["frame_us"].tolist() == [47_500, 52_500]
    np.testing.assert_array_equal(np.moveaxis(item["frame"], 0, -1), picture[..., ::-1])


def test_flow_over_several_intervals(sequence):
    """Joined flows against the scene: exact to 0.01 px away from edges; hidden points are not guessed."""
    left = small.rig()[0]
    truth = sequence.cameras["left"].truth
    for start, end in ((0, 2), (1, 6), (0, 10), (2, 0), (9, 4)):
        flow = truth.flow(start, end)
        t0, t1 = small.TRUTH_US[start], small.TRUTH_US[end]
        world, _, ids, _ = left.look(t0)
        moved, _ = left.project(left.moved(world, ids, t0, t1), t1)
        want, ids = left.picture(moved - left.grid), left.picture(ids)
        known = np.isfinite(flow).all(-1)
        inner = cv2.erode(ids.astype(np.uint8), np.ones((7, 7))) == cv2.dilate(ids.astype(np.uint8), np.ones((7, 7)))
        error = np.linalg.norm((flow - want)[known & inner], axis=-1)
        assert known.mean() > 0.7 and np.sqrt((error**2).mean()) < 0.01 * abs(end - start)
        assert (np.linalg.norm((flow - want)[known], axis=-1) < 1).mean() > 0.99
        if end - start < 5:
            continue
        # What the card hides before the last interval begins has no flow.
        before = small.TRUTH_US[end - 1]
        x, y = np.rint(left.project(left.moved(world, ids.ravel(), t0, before), before)[0]).astype(int).T
        inside = (x >= 0) & (x < W) & (y >= 0) & (y < H)
        seen = np.full(len(x), -1)
        seen[inside] = left.picture(left.look(before)[2])[y[inside], x[inside]]
        hidden = (ids.ravel() == small.WALL) & (seen == small.CARD)
        assert hidden.sum() > 50 and not known.ravel()[hidden].any()
    with pytest.raises(IndexError):
        truth.flow(3, 3)


@pytest.mark.parametrize("t_us", [30_000, 33_000, 37_500, 100_000])
def test_velocity_at_any_time(sequence, t_us):
    left, truth = small.rig()[0], sequence.cameras["left"].truth
    want = (left.flow(t_us, t_us + 50)[0] - left.flow(t_us, t_us - 50)[0]) / 100e-6
    ids = left.picture(left.look(t_us)[2]).astype(np.uint8)
    inner = cv2.erode(ids, np.ones((5, 5))) == cv2.dilate(ids, np.ones((5, 5)))
    found = truth.velocity_at(t_us)
    error = np.linalg.norm((found - want)[inner], axis=-1)
    assert np.isfinite(found).all() and inner.sum() > 5000
    assert np.sqrt((error**2).mean()) < 0.002 * np.abs(want).max()
    with pytest.raises(IndexError):
        truth.velocity_at(100_002)


def test_transform_gets_the_events(sequence):
    data = Windows(sequence, "left", window_us=20_000, transform=len)
    assert data[1]["events"] == len(Windows(sequence, "left", window_us=20_000)[1]["events"])


def test_planes_of_a_window(sequence):
    """They span the window from its begin to its end, wherever its first and last event lie."""
    planes = {"voxel_grid": {"bins": 5}, "time_surface": {"tau_us": 3000}, "event_histogram": {"bins": 4}}
    item = Windows(sequence, "left", window_us=20_000, **planes)[1]
    t, x, y, p = (item["events"][k].astype(int) for k in "txyp")
    at = (t - 20_000) / 20_000 * 4
    want = np.zeros((5, H, W))
    for b in range(5):
        np.add.at(want[b], (y, x), (2 * p - 1) * np.maximum(0, 1 - np.abs(b - at)))
    np.testing.assert_allclose(item["voxel_grid"], want, atol=1e-4)
    last = np.full((2, H, W), -np.inf)
    np.maximum.at(last, (p, y, x), t)
    np.testing.assert_allclose(item["time_surface"], np.exp((last - 40_000) / 3000), atol=1e-5)
    counts = np.zeros((2, 4, H, W))
    np.add.at(counts, (p, (t - 20_000) // 5000, y, x), 1)
    np.testing.assert_array_equal(item["event_histogram"], counts.reshape(8, H, W))
    bare = Windows(sequence, "left", window_us=20_000, keep_events=False, voxel_grid={"bins": 5})[1]
    assert "events" not in bare
    np.testing.assert_array_equal(bare["voxel_grid"], item["voxel_grid"])


def total(data, index):
    item = data[index]
    return len(item["events"]), float(np.nansum(item["flow"])), float(item["depth"].sum())


@pytest.mark.parametrize("how", ["fork", "spawn"])
def test_in_other_processes(data, how):
    """Workers reopen the files that this process has open."""
    want = [total(data, i) for i in (0, 3)]
    with ProcessPoolExecutor(2, multiprocessing.get_context(how)) as pool:
        found = [*pool.map(total, [data, data], (0, 3))]
    assert found == want
    assert total(data, 3) == want[1]  # and here all is as it was


def test_pickles(data):
    data[0]
    again = pickle.loads(pickle.dumps(data))
    np.testing.assert_array_equal(again[4]["events"], data[4]["events"])


def test_few_files_are_open(sequence, monkeypatch):
    monkeypatch.setattr(pecs.datasets.windows, "_OPEN_FILES", 2)
    data = Windows([sequence, Sequence(sequence.folder)], window_us=100_000)
    for i in (0, 1, 2, 3, 0, 3):
        assert len(data[i]["events"]) > 1000 and len(data._open) <= 2


@pytest.mark.parametrize(
    "options, wanted",
    [
        ({"by": "space"}, "got by 'space'"),
        ({"window_us": 0}, "of 0 every"),
        ({"by": "count", "count": 10, "step": -1}, "of 10 every -1"),
        ({"step_us": 0}, "of 50000 every 0"),
        ({"count": 1000}, "got by 'time' and count, wanted by 'count'"),
        ({"by": "count", "window_us": 1000, "step_us": 10}, "got by 'count' and window_us, step_us, wanted by 'time'"),
        ({"transform": len, "keep_events": False}, "got a transform and keep_events False"),
        ({"fields": ["flow", "smell"]}, "fields: got smell, wanted flow"),
        ({"camera": "rgb"}, "camera: got 'rgb', which is no event camera"),
        ({"camera": "right", "fields": ["frame"]}, "right: got no frame, wanted fields that every camera"),
    ],
)
def test_wrong_options(sequence, options, wanted):
    with pytest.raises(pecs.PecsInputError) as error:
        Windows(sequence, **options)
    assert wanted in str(error.value) and "\n" not in str(error.value)


@pytest.fixture(scope="module")
def others(sequence, outside):
    return outside("windows", sequence.folder)


def test_torch_loads_in_workers(others, data):
    assert others["torch_items"].tolist() == [0, 0, 1, 1, 2]  # batches of two, by two workers, in order
    assert others["torch_n"].tolist() == [len(data[i]["events"]) for i in range(5)]
    for i in range(5):
        item = data[i]
        np.testing.assert_array_equal(others["torch_flow"][i], item["flow"])
        np.testing.assert_array_equal(others["torch_frame"][i], item["frame"])
        np.testing.assert_array_equal(others["torch_t"][i], item["events"]["t"].sum())
    grids = np.stack(
        [Windows(data.sequences, "left", window_us=20_000, voxel_grid={})[i]["voxel_grid"] for i in range(5)]
    )
    np.testing.assert_array_equal(others["torch_voxels"], grids)
    assert others["torch_late_us"].tolist() == [2**26 + 0.5]
    assert others["torch_boxes"].shape == (10, 7)
    np.testing.assert_array_equal(others["torch_boxes"][2:4, 1], [small.CARD, small.WALL])


def test_tonics_transforms(others, data):
    for i in range(5):
        events = data[i]["events"]
        counts = np.zeros((2, H, W), int)
        np.add.at(counts, (events["p"], events["y"], events["x"]), 1)
        lost = counts - others["tonic_frames"][i].sum(0)  # tonic's last bin ends before the last event
        assert lost.min() == 0 and lost.sum() <= 5
        # A voxel grid's bins share one ON and one minus OFF of each event, except what leaves through the last one.
        signed = np.zeros((H, W))
        np.add.at(signed, (events["y"], events["x"]), 2.0 * events["p"] - 1)
        assert np.abs(others["tonic_voxels"][i].sum((0, 1)) - signed).sum() < 0.25 * np.abs(signed).sum()
        assert np.corrcoef(others["tonic_voxels"][i].sum((0, 1)).ravel(), signed.ravel())[0, 1] > 0.9
    assert (others["tonic_denoised"] < [len(data[i]["events"]) for i in range(5)]).all()
    assert (others["tonic_denoised"] > 0).all()
