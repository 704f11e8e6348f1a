"""pecs.datasets.Sequence: what it reads is what the scene is, and every fault is one clear line."""

import json
import pickle
import shutil
from types import SimpleNamespace

import numpy as np
import pecs
import pytest
from pecs._poses import read_tum
from pecs.datasets import Sequence, card, checks, cli, manifest, sequences
from support import small_sequence as small


@pytest.fixture
def folder(sequence):
    return sequence.folder


@pytest.fixture
def broken(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "0000")


def change(folder, edit):
    path = folder / "sequence.json"
    info = json.loads(path.read_text())
    edit(info)
    path.write_text(json.dumps(info))


def test_truth_is_the_scenes(folder):
    sequence = Sequence(folder)
    left = small.rig()[0]
    truth = sequence.cameras["left"].truth
    np.testing.assert_array_equal(truth.times_us, small.TRUTH_US)
    world, z, ids, normals = left.look(20_000)
    distance, z_read = truth.depth(2)
    np.testing.assert_allclose(z_read, left.picture(z), rtol=1e-6)
    np.testing.assert_allclose(distance, left.picture(z * np.linalg.norm(left.rays, axis=1)), rtol=1e-6)
    np.testing.assert_array_equal(truth.instances(2), left.picture(ids))
    assert set(np.unique(ids)) == {small.CARD, small.WALL}
    np.testing.assert_allclose(truth.normal(2), np.moveaxis(left.picture(normals), -1, 0), atol=1e-6)
    np.testing.assert_allclose(truth.flow(2), left.flow(20_000, 30_000)[0], atol=1e-5)
    np.testing.assert_allclose(truth.flow_back(2), left.flow(30_000, 20_000)[0], atol=1e-5)
    assert truth.motion(2).shape == (20, 72, 96)
    with pytest.raises(IndexError):
        truth.flow(len(truth) - 1)
    assert truth.layers == ("depth", "normal", "objects", "motion")


def test_what_is_visible_at_both_ends(folder, monkeypatch):
    """A strip of 10 columns at 1 m moves 3 px to the right before a wall at 4 m: it hides 3 columns of the wall, leaves
    3 free, and what leaves the picture is not seen either."""
    truth = Sequence(folder).cameras["left"].truth
    columns = np.broadcast_to(np.arange(96), truth.shape)

    def strip(i):
        return (columns >= 40 + 3 * i) & (columns < 50 + 3 * i)

    def layer(name, i, wanted):
        moves = {"x_end": 3.0 * strip(i), "back_x_end": -3.0 * strip(i + 1)}
        moves |= {way + "z_end": np.where(strip(i + k), 1.0, 4.0) for way, k in (("", 0), ("back_", 1))}
        moves["x_end"][:, 94] = 5
        return np.stack([moves.get(channel, np.zeros(truth.shape)) for channel in wanted])

    monkeypatch.setattr(truth, "layer", layer)
    monkeypatch.setattr(truth, "depth", lambda i: np.where(strip(i), 1.0, 4.0)[None].repeat(2, 0))
    for i, to, hidden in ((0, 1, [50, 51, 52, 94]), (1, 0, [40, 41, 42])):
        seen = truth.visible_at(i, to)
        assert np.flatnonzero(~seen[30]).tolist() == hidden and (seen == seen[30]).all()
    on_the_way = truth.visible_at(0, 2)[30]  # hidden at the first or at the second time after it
    assert np.flatnonzero(~on_the_way).tolist() == [50, 51, 52, 53, 54, 55, 94]
    with pytest.raises(IndexError, match="another instant"):
        truth.visible_at(2, 2)


def test_boxes_and_object_poses(folder):
    truth = Sequence(folder).cameras["right"].truth
    assert truth.classes == {1: "card"}
    card, wall = truth.boxes(3)
    y, x = np.nonzero(truth.instances(3) == small.CARD)
    assert [card[k] for k in ("x0", "y0", "x1", "y1")] == [x.min(), y.min(), x.max() + 1, y.max() + 1]
    assert (card["class_id"], wall["class_id"], card["visible_px"]) == (1, 0, len(x))
    # What is seen of an unhidden convex thing reaches its amodal box within a pixel.
    for k in ("x0", "y0", "x1", "y1"):
        assert abs(card[k] - card["amodal_" + k]) < 1
    np.testing.assert_allclose(truth.object_poses(3)[small.CARD][:3, 3], small.CARD_CENTRE + 0.03 * small.CARD_SPEED)


def test_truth_of_the_same_pixels(folder):
    """A camera behind the same lens needs no truth of its own."""
    cameras = Sequence(folder).cameras
    assert cameras["frame"].has_truth and cameras["frame"].truth.folder == cameras["left"].folder / "truth"
    assert not cameras["rgb"].has_truth


def test_poses_and_imu(folder):
    sequence = Sequence(folder)
    eye, camera = small.rig()[1], sequence.cameras["right"]
    t_us, poses = camera.poses()
    assert len(t_us) == 101
    np.testing.assert_allclose(t_us, np.arange(101) * 1000.0)
    np.testing.assert_allclose(poses[40], eye.world_from_camera(40_000), atol=1e-9)
    rig_t, rig = sequence.poses()
    np.testing.assert_allclose(rig[40] @ camera.rig_from_camera, poses[40], atol=1e-9)
    np.testing.assert_allclose(sequence.imu()["accel"], np.tile([0, -9.81, 0], (101, 1)))
    np.testing.assert_array_equal(sequence.imu()["t_us"], rig_t)


def test_who_is_left(folder):
    sequence = Sequence(folder)
    ((left, right),) = sequence.stereo_pairs()
    assert (left.name, right.name) == ("left", "right")
    assert sequence.stereo_pairs("rgb") == []


def test_events_and_frames(folder):
    sequence = Sequence(folder)
    left = sequence.cameras["left"]
    events = left.events()
    assert len(events) > 2000 and (events.width, events.height) == (96, 72)
    assert len(left.causes()) == len(left.objects()) == len(events)
    assert set(np.unique(left.objects())) == {small.CARD, small.WALL}
    frames = sequence.cameras["rgb"].frames()
    assert [f.middle_us for f in frames] == [10_000, 30_000, 50_000, 70_000, 90_000]
    assert all(f.path.is_file() and f.sharp_path.is_file() for f in frames)
    assert left.frames() == []


@pytest.mark.parametrize("window", [(0, 100_000), (0, 0.5), (12_345, 12_346), (3000, 4000), (99_500, 1e9), (-5, 1500)])
def test_parts_of_an_event_file(folder, window):
    camera = Sequence(folder).cameras["left"]
    events = camera.events()
    want = events[(events["t"] >= window[0]) & (events["t"] < window[1])]
    with camera.event_file() as file:
        got = file.between(*window)
        np.testing.assert_array_equal(got, want)
        assert got.width == 96
        np.testing.assert_array_equal(np.concatenate([*file.blocks(1000)]), events)


def test_an_event_file_that_begins_late(tmp_path):
    """Then times in the file begin near 0, by t_offset."""
    late = np.zeros(50, pecs.EVENT_DTYPE)
    late["t"] = 5 * 3_600_000_000 + np.arange(50) * 400
    pecs.write(tmp_path / "e.h5", late, 10, 10, format="dsec")
    with pecs.datasets.EventFile(tmp_path / "e.h5") as file:
        assert file.t_offset_us > 0
        np.testing.assert_array_equal(file.between(late["t"][7], late["t"][19])["t"], late["t"][7:19])


def test_pickles_and_reopens(folder):
    sequence = Sequence(folder)
    sequence.cameras["left"].truth.depth(0)
    again = pickle.loads(pickle.dumps(sequence))
    np.testing.assert_array_equal(again.cameras["left"].truth.depth(0), sequence.cameras["left"].truth.depth(0))


def test_a_set_by_split(folder):
    unfinished = folder.parent / "0001.partial"
    shutil.copytree(folder, unfinished)
    assert [s.name for s in sequences(folder.parents[1])] == ["0000"]
    shutil.rmtree(unfinished)
    assert sequences(folder.parents[1], "val") == []


def camera(i, **values):
    return lambda info: info["cameras"][i].update(values)


@pytest.mark.parametrize(
    "edit, wanted",
    [
        (lambda info: info.update(format=2), "format: got 2, wanted 1"),
        (lambda info: info.pop("cameras"), "cameras: got nothing, wanted a list"),
        (lambda info: info.update(duration_us=0), "duration_us: got 0, wanted a whole number >= 1"),
        (camera(1, name="left"), 'cameras[1].name: got "left", wanted a name that no other camera has'),
        (camera(1, name="LEFT"), 'cameras[1].name: got "LEFT", wanted a name that no other camera has'),
        (camera(0, name="a\nb"), 'cameras[0].name: got "a\\nb", wanted text without control characters'),
        (lambda info: info.update(name="../../x"), 'name: got "../../x", wanted a name of a file'),
        (lambda info: info.update(split="/tmp/x"), 'split: got "/tmp/x", wanted a name of a file'),
        (lambda info: info.update(name=".."), 'name: got "..", wanted a name of a file'),
        (lambda info: info.update(split="a\0b"), "split: got "),
        (camera(0, name="../left"), 'cameras[0].name: got "../left"'),
        (camera(0, kind="lidar"), 'cameras[0].kind: got "lidar", wanted one of events, rgb'),
        (camera(0, width=True), "cameras[0].width: got true"),
        (camera(0, K=[[1, 0], [0, 1]]), "cameras[0].K: got [[1, 0], [0, 1]], wanted 3 x 3 finite numbers"),
        (camera(0, K="x"), 'cameras[0].K: got "x"'),
        (camera(0, R_rect=(2 * np.eye(3)).tolist()), "cameras[0].R_rect: got "),
        (camera(0, distortion=[0.1]), "cameras[0].distortion: got [0.1], wanted 4, 5, 8, 12 or 14"),
        (camera(0, partner="rgb"), "camera left: partner: got rgb"),
        (camera(3, pixels_of="rgb"), "camera frame: pixels_of: got rgb, wanted a camera of the same place"),
        (camera(0, baseline_m=None), "camera left: baseline_m: got null, wanted metres"),
    ],
)
def test_what_sequence_json_says_wrong(broken, edit, wanted):
    change(broken, edit)
    with pytest.raises(pecs.PecsInputError) as error:
        Sequence(broken)
    assert wanted in str(error.value) and "sequence.json" in str(error.value) and "\n" not in str(error.value)


def spoil(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_what_other_files_say_wrong(broken):
    left, rgb = (Sequence(broken).cameras[name] for name in ("left", "rgb"))

    def fails(call, wanted, kind=pecs.PecsInputError):
        with pytest.raises(kind) as error:
            call()
        assert wanted in str(error.value) and "\n" not in str(error.value), str(error.value)

    np.save(broken / "left" / "causes.npy", np.array(left.causes())[:-1])
    fails(left.causes, "causes.npy: length")
    np.save(broken / "left" / "causes.npy", np.full(len(left.objects()), 9, "u1"))
    fails(left.causes, "causes.npy: greatest value: got 9, wanted less than")
    np.save(broken / "left" / "objects.npy", np.zeros(3))
    fails(left.objects, "objects.npy: dtype: got float64, wanted <u2")
    np.save(broken / "left" / "rectify_map.npy", np.zeros((72, 95, 2), np.float32))
    fails(left.rectify_map, "rectify_map.npy: shape: got [72, 95, 2], wanted [72, 96, 2]")
    spoil(broken / "left" / "truth" / "objects.json", '"class_id": 1', '"class_id": 7')
    fails(lambda: left.truth.boxes(0), "objects[0].class_id: got 7")
    (broken / "rgb" / "rgb" / "000003.png").unlink()
    fails(rgb.frames, "000003.png: no such file", pecs.PecsNotFoundError)
    spoil(broken / "rgb" / "rgb.csv", "1,27500", "2,27500")
    fails(rgb.frames, "rgb.csv: line 3: got [2, 27500, 32500], wanted index 1")
    spoil(broken / "imu.csv", "-9.81", "nan")
    fails(Sequence(broken).imu, 'imu.csv: line 2: got "0,0,0,0,0,nan,0", wanted 7')
    spoil(broken / "poses.txt", "\n0.002 ", "\n0.0005 ")
    fails(Sequence(broken).poses, 'poses.txt: line 4: time: got "0.0005"')
    (broken / "left" / "events.h5").unlink()
    fails(left.events, "events.h5: no such file", pecs.PecsNotFoundError)
    fails(lambda: rgb.truth, "truth/stack.json: no such file", pecs.PecsNotFoundError)
    fails(lambda: Sequence(broken / "nowhere"), "wanted a sequence", pecs.PecsNotFoundError)


def test_a_window_costs_what_it_contains(sequence, monkeypatch):
    """Labels are checked once, and a camera path is read once, however many windows and times follow."""
    camera, counts = Sequence(sequence.folder).cameras["left"], {"max": 0, "read": 0}

    def count(what, function):
        def counted(*args, **options):
            counts[what] += 1
            return function(*args, **options)

        return counted

    monkeypatch.setattr(np.memmap, "max", count("max", np.ndarray.max), raising=False)
    monkeypatch.setattr("pecs.datasets.sequence.read_tum", count("read", read_tum))
    for _ in range(5):
        causes, poses = camera.causes(), camera.poses()[1]
        poses[:] = 0  # a copy
    assert len(causes) == len(camera.events()) and counts == {"max": 1, "read": 1} and camera.poses()[1].any()


def test_events_that_stages_drop_were_fired(broken):
    """Of 100 events that the readout lost, among those that it sent."""
    stages = {"roi": 5000, "mask": 10, "afk": 0, "trail": 3000, "erc": 90}
    results = {"dropped": 100, "dropped_by_stage": stages, "corner_hz": {}, "photocurrent_a": {}}
    (broken / "left/events.h5.run.json").write_text(json.dumps({"results": results}))
    sequence = Sequence(broken)
    left = sequence.cameras["left"]
    found = checks.events(sequence, left)
    assert found["dropped_share"] == pytest.approx(100 / (100 + 3100 + len(left.events())))


def test_damaged_sequences_are_no_part_of_the_set(folder, tmp_path):
    for name in ("0000", "0001"):
        manifest.seal(shutil.copytree(folder, tmp_path / "sequences" / name))
    for number in (1, 2):
        (tmp_path / "sequences/0001/poses.txt").write_text("damaged")
        cli._move_aside([0, 1], tmp_path)
        assert [one.folder.name for one in sequences(tmp_path)] == ["0000"]
        assert (tmp_path / f"damaged/0001.{number}/poses.txt").read_text() == "damaged"
        manifest.seal(shutil.copytree(folder, tmp_path / "sequences/0001"))
    manifest.check_count(SimpleNamespace(sequences=2), tmp_path)
    with pytest.raises(pecs.PecsOutputError, match="0001: the recipe has 1 sequences"):
        manifest.check_count(SimpleNamespace(sequences=1), tmp_path)


@pytest.mark.parametrize(
    ("layers", "said"),
    [
        (("depth", "objects", "motion"), "At 30 Hz: depth, motion, objects; per event: cause, and object"),
        (("depth",), "At 30 Hz: depth; per event: cause."),
    ],
)
def test_datasheet_lists_what_there_is(layers, said):
    values = {"layers": layers, "times_us": np.array([0, 33333.333, 66666.667]), "__len__": lambda _: 3}
    truth = type("Truth", (), values)()
    camera = {"name": "left", "kind": "events", "width": 8, "height": 6, "has_truth": True}
    camera = SimpleNamespace(**camera, truth=truth, info={"chip": "ideal", "lens": "none", "pixels_of": None})
    made = SimpleNamespace(split="train", duration_us=10**6, cameras={"left": camera}, info={"scene": "s", "imu": None})
    recipe = SimpleNamespace(name="r", about={}, sha256="", truth=SimpleNamespace(layers=layers))
    assert said in card._datasheet(recipe, {"versions": {"pecs": "1"}, "sequences": []}, [made])
