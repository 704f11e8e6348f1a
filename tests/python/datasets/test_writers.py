"""Every format of pecs.datasets.writers but DSEC (test_datasets_dsec.py), read back by readers of others and
compared with the scene itself."""

import csv
import hashlib
import json
import sys

import cv2
import h5py
import numpy as np
import pecs
import pytest
from pecs.datasets import Sequence, writers
from support import small_sequence as small

W, H = 96, 72


def grey(path):
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2GRAY)


def left_out(report):
    return {entry["what"]: entry["why"] for entry in report["left_out"]}


def test_class_numbers_are_those_of_the_readers(sequence, monkeypatch):
    """A person is a pedestrian, a pavement is no object, and what a reader drops is listed."""
    from pecs.datasets.truth import Truth
    from pecs.datasets.writers import _shared, prophesee

    names = dict(enumerate(("bicycle", "box", "pavement", "person", "traffic_sign", "wall"), 1))
    monkeypatch.setattr(Truth, "classes", property(lambda self: names))
    found = _shared.class_numbers([sequence], prophesee.CLASSES["gen4"])
    assert {name: found.get(name) for name in names.values()} == {
        **{"bicycle": 1, "box": 7, "pavement": None, "person": 0, "traffic_sign": 5, "wall": None}
    }
    assert _shared.class_numbers([sequence], first=1) == {"bicycle": 1, "box": 2, "person": 3, "traffic_sign": 4}
    report = _shared.Report()
    _shared.report_unread(report, found, 3, "RVT")
    unread = [entry["what"] for entry in report.as_dict()["left_out"]]
    assert "class box for RVT" in unread and "class person for RVT" not in unread


# --- Prophesee --------------------------------------------------------------------------------------------------------


def test_prophesee_events(sequence, exported, tmp_path):
    import expelliarmus

    folder, _ = exported("prophesee")
    events = sequence.cameras["left"].events()
    with h5py.File(folder / "train" / "0000_left_td.h5") as file:
        small.same_events([file[f"events/{k}"][:] for k in "txyp"], events, seconds=False)
        assert (file["events/height"][()].item(), file["events/width"][()].item()) == (H, W)  # as RVT asks
    writers.write("prophesee", [sequence], tmp_path / "dat", events="dat", generation="gen1")
    found = expelliarmus.Wizard(encoding="dat").read(str(tmp_path / "dat" / "train" / "0000_left_td.dat"))
    small.same_events([found[k] for k in "txyp"], events, seconds=False)


def test_prophesee_boxes(sequence, exported):
    folder, report = exported("prophesee")
    labels = np.load(folder / "train" / "0000_left_bbox.npy")
    fields = labels.dtype.fields
    assert labels.dtype.itemsize == 40
    assert {name: fields[name][1] for name in fields} == {
        **{"t": 0, "x": 8, "y": 12, "w": 16, "h": 20, "class_id": 24, "track_id": 28, "class_confidence": 32}
    }
    np.testing.assert_array_equal(labels["t"], small.TRUTH_US)
    truth = sequence.cameras["left"].truth
    for i, row in enumerate(labels):
        want = cv2.boundingRect((truth.instances(i) == small.CARD).astype(np.uint8))
        assert tuple(row[k] for k in "xywh") == want
    assert report["sequences"]["0000"]["boxes"] == 2 * len(labels) == report["rvt"]["gen1"]["boxes"]


@pytest.mark.parametrize("generation", ["gen1", "gen4"])
@pytest.mark.parametrize("training", [True, False])
def test_count_of_boxes_by_rvts_own_filters(generation, training, sequence):
    """At RVT's own size of the picture, boxes around all its limits."""
    from pecs.datasets.writers.prophesee import BBOX_DTYPE, survive_rvt
    from support.outside import rvt_filters as rvt

    camera = Sequence(sequence.folder).cameras["left"]
    camera.width, camera.height = rvt.dataset_2_width[generation], rvt.dataset_2_height[generation]
    rng = np.random.default_rng(1)
    labels = np.zeros(4000, BBOX_DTYPE)
    labels["w"], labels["h"] = rng.integers(5, 90, 4000), rng.integers(5, 90, 4000)
    labels["w"][::5] = rng.integers(camera.width * 8 // 10, camera.width, 800)
    labels["x"], labels["y"] = rng.integers(-40, camera.width, 4000), rng.integers(-40, camera.height, 4000)
    labels["class_id"], labels["track_id"] = rng.integers(0, 6, 4000), np.arange(4000)
    kept = labels.copy()
    kept = rvt.prophesee_remove_labels_filter_gen4(kept) if generation == "gen4" else kept
    kept = rvt.prophesee_bbox_filter(rvt.crop_to_fov_filter(kept, generation), generation)
    kept = rvt.remove_faulty_huge_bbox_filter(kept, generation) if training else kept
    ours = labels["track_id"][survive_rvt(labels, generation, camera, training)]
    assert 100 < len(kept) < 3900
    np.testing.assert_array_equal(ours, kept["track_id"])


# --- Video reconstruction ---------------------------------------------------------------------------------------------


def test_evreal(sequence, exported):
    folder, report = exported("evreal")
    at = folder / "0000_left"
    xy, events = np.load(at / "events_xy.npy"), sequence.cameras["left"].events()
    small.same_events([np.load(at / "events_ts.npy"), xy[:, 0], xy[:, 1], np.load(at / "events_p.npy")], events)
    images, times = np.load(at / "images.npy", mmap_mode="r"), np.load(at / "images_ts.npy")
    indices = np.load(at / "image_event_indices.npy")
    assert images.shape == (5, H, W, 1) and images.dtype == np.uint8
    for k, frame in enumerate(sequence.cameras["frame"].frames()):
        np.testing.assert_array_equal(images[k][:, :, 0], grey(frame.path))
        assert times[k].item() == pytest.approx(frame.middle_us * 1e-6)
        start = indices[k][0]
        assert events["t"][start - 1] < frame.middle_us <= events["t"][start]
    assert json.loads((at / "metadata.json").read_text())["sensor_resolution"] == [H, W]
    assert not (folder / "0000_right").exists()
    assert "camera right" in left_out(report)


def test_evreal_by_its_own_loader(sequence, exported, outside):
    found = outside("evreal", exported("evreal")[0] / "0000_left")
    events, frames = sequence.cameras["left"].events(), sequence.cameras["frame"].frames()
    # EVREAL's first item ends with the first picture and holds no events; the last picture has none.
    assert found["event_count"][0] == 0 and len(found["event_count"]) == len(frames) - 1
    for i in range(1, len(frames) - 1):
        between = (events["t"] >= frames[i - 1].middle_us) & (events["t"] < frames[i].middle_us)
        assert found["event_count"][i] == between.sum() > 1000
        signed = np.zeros((H, W))
        np.add.at(signed, (events["y"][between], events["x"][between]), 2.0 * events["p"][between] - 1)
        np.testing.assert_allclose(found["events"][i].sum(0), signed, atol=1e-4)
        np.testing.assert_allclose(found["events"][i], pecs.voxel_grid(events[between], W, H, 5), atol=1e-4)
        np.testing.assert_allclose(found["frame"][i, 0] * 255, grey(frames[i].path), atol=1e-3)
        assert found["frame_timestamp"][i] == pytest.approx(frames[i].middle_us * 1e-6)


def test_event_cnn(sequence, exported):
    """As event_cnn_minimal's DynamicH5Dataset reads it."""
    folder, _ = exported("event_cnn")
    left, events = small.rig()[0], sequence.cameras["left"].events()
    with h5py.File(folder / "train" / "0000_left.h5") as file:
        small.same_events([file[f"events/{k}s"][:] for k in "txyp"], events)
        assert (file.attrs["num_events"], file.attrs["num_imgs"]) == (len(events), 5)
        assert file.attrs["num_pos"] == events["p"].sum() and file.attrs["sensor_resolution"].tolist() == [H, W]
        assert [*file["images"]] == [f"image{i:09d}" for i in range(5)]
        for i, name in enumerate(file["images"]):
            image = file["images"][name]
            assert image.attrs["timestamp"] == pytest.approx(0.01 + 0.02 * i)
            assert (
                events["t"][image.attrs["event_idx"] - 1] < 10_000 + 20_000 * i <= events["t"][image.attrs["event_idx"]]
            )
            assert image.shape == (H, W)
        # Displacement in the time of a window, as the loader makes it of the flow.
        flow = file["flow"]["flow000000002"][:] * 0.001
        want = left.flow(50_000, 51_000)[0]
        np.testing.assert_allclose(np.moveaxis(flow, 0, -1), want, atol=0.003)
        assert np.abs(want).max() > 0.05


@pytest.fixture(scope="module")
def ecd(exported, outside):
    return outside("ecd", exported("ecd")[0] / "0000_left")


def test_ecd_by_event_vision_library(sequence, ecd):
    events, camera = sequence.cameras["left"].events(), sequence.cameras["left"]
    small.same_events([ecd[k] for k in ("t_s", "x", "y", "p")], events)
    np.testing.assert_allclose(ecd["image_times"], [0.01, 0.03, 0.05, 0.07, 0.09])
    want = grey(sequence.cameras["frame"].frames()[1].path)
    np.testing.assert_array_equal(ecd["images"][1].reshape(H, W), want)
    np.testing.assert_allclose(ecd["imu_linear_acceleration"], np.tile([0, -9.81, 0], (101, 1)))
    np.testing.assert_allclose(ecd["imu_timestamp"], np.arange(101) * 1e-3)
    t_us, poses = camera.poses()
    np.testing.assert_allclose(ecd["pose_timestamp"], t_us * 1e-6)
    np.testing.assert_allclose(ecd["pose_position"], poses[:, :3, 3], atol=1e-9)
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_quat(ecd["pose_quaternion"][7]).as_matrix()
    np.testing.assert_allclose(turned, small.WORLD_FROM_RIG[:3, :3], atol=1e-9)
    np.testing.assert_allclose(ecd["K"], camera.K)
    np.testing.assert_allclose(ecd["D"], camera.distortion)


def test_e2vid_text_and_euroc_imu(sequence, exported):
    at = exported("ecd")[0] / "0000_right"
    assert (at / "e2vid.txt").read_text().splitlines()[0].split() == [str(W), str(H)]
    found = np.loadtxt(at / "e2vid.txt", skiprows=1)
    small.same_events(found.T, sequence.cameras["right"].events())
    rows = list(csv.reader((at / "imu0" / "data.csv").read_text().splitlines()))
    assert rows[0][0] == "#timestamp [ns]" and [float(v) for v in rows[3]] == [2_000_000, 0, 0, 0, 0, -9.81, 0]
    z = np.load(at / "depth" / "00000004.npy")
    right = small.rig()[1]
    np.testing.assert_allclose(z, right.picture(right.look(40_000)[1]), rtol=1e-6)
    assert (at / "depth.txt").read_text().splitlines()[4] == "0.040000 depth/00000004.npy"


# --- ROS --------------------------------------------------------------------------------------------------------------


def test_ros_by_rosbags(sequence, exported):
    from rosbags.highlevel import AnyReader

    folder, report = exported("ros")
    found = {}
    with AnyReader([folder / "0000"]) as reader:
        times = []
        for connection, t_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
            times.append(t_ns)
            stamp = message.header.stamp
            assert t_ns == max(1, stamp.sec * 10**9 + stamp.nanosec)
    left, frames, names = sequence.cameras["left"], sequence.cameras["frame"].frames(), ("events", "pose", "depthmap")
    assert times == sorted(times) and {f"/cam{i}/{name}" for i in (0, 1) for name in names} <= set(found)
    small.same_events([pecs.ros.read_bag(folder / "0000", "/cam1/events")[k] for k in "txyp"],
                      sequence.cameras["right"].events(), seconds=False)  # fmt: skip
    for image, frame in zip(found["/cam0/image_raw"], frames, strict=True):
        picture = cv2.imread(str(frame.path))[..., ::-1]
        assert (image.encoding, image.step) == ("rgb8", 3 * W)
        np.testing.assert_array_equal(image.data.reshape(H, W, 3), picture)
        assert image.header.stamp.nanosec == 1000 * frame.middle_us
    info = found["/cam0/camera_info"][0]
    assert len(found["/cam0/camera_info"]) == len(frames) and info.distortion_model == "plumb_bob"
    np.testing.assert_array_equal(info.k.reshape(3, 3), left.K)
    np.testing.assert_array_equal(info.d[: len(left.distortion)], left.distortion)
    # ROS: P of both cameras takes points in the left one's rectified axes to rectified pixels.
    point = np.array([0.3, -0.2, 2.0, 1.0])
    np.testing.assert_allclose(info.p.reshape(3, 4) @ point, left.K_rect @ point[:3])
    right = sequence.cameras["right"]
    from_left = right.R_rect @ np.linalg.inv(right.rig_from_camera)[:3] @ left.rig_from_camera
    from_left[:, :3] = from_left[:, :3] @ left.R_rect.T
    P = found["/cam1/camera_info"][0].p.reshape(3, 4)
    np.testing.assert_allclose(P @ point, right.K_rect @ from_left @ point, rtol=1e-9)
    assert P[0, 3] == pytest.approx(-right.K_rect[0, 0] * 0.12) and abs(P[1:, 3]).max() < 1e-9
    t_us, poses = left.poses()
    for t, pose, message in zip(t_us, poses, found["/cam0/pose"], strict=True):
        p, q = message.pose.position, message.pose.orientation
        np.testing.assert_allclose([p.x, p.y, p.z], pose[:3, 3])
        turned = pecs._poses.matrix_from_quaternion([q.x, q.y, q.z, q.w])
        np.testing.assert_allclose(turned, pose[:3, :3], atol=1e-9)
        assert message.header.stamp.nanosec == round(1000 * t) and message.header.frame_id == "world"
    for i, image in enumerate(found["/cam0/depthmap"]):
        assert image.encoding == "32FC1"
        np.testing.assert_array_equal(image.data.view("<f4").reshape(H, W), left.truth.depth(i)[1])
    flow = np.stack([getattr(found["/cam0/optic_flow"][4], name) for name in ("flow_x", "flow_y")], -1).reshape(H, W, 2)
    np.testing.assert_allclose(flow * 0.01, left.truth.flow(4), rtol=1e-5)
    imu = [[m.linear_acceleration.y, m.angular_velocity.x, m.orientation_covariance[0]] for m in found["/imu"]]
    np.testing.assert_allclose(imu, np.tile([-9.81, 0, -1], (101, 1)))
    assert report["sequences"]["0000"]["image_raw"] >= len(frames)
    assert "normals, masks, boxes, causes, objects" in left_out(report)


@pytest.mark.parametrize("storage", ["mcap", "ros1"])
def test_ros_images_of_a_davis_are_grey(storage, tmp_path):
    from rosbags.highlevel import AnyReader

    folder = small.write(tmp_path / "0000")
    taken = np.random.default_rng(1).integers(0, 1024, (2, H, W)).astype(np.uint16) << 6  # the ADC's upper bits
    (folder / "right/frames/images").mkdir(parents=True)
    for i, picture in enumerate(taken):
        cv2.imwrite(str(folder / f"right/frames/images/frame_{i:08d}.png"), picture)
    (folder / "right/frames/exposures.csv").write_text("index,start_us,end_us\n0,0,10000\n1,43000,47000\n")
    writers.write("ros", [pecs.datasets.Sequence(folder)], tmp_path / "r", storage=storage)
    assert "frames of camera right" in left_out(writers.write("dsec", [pecs.datasets.Sequence(folder)], tmp_path / "d"))
    with AnyReader([tmp_path / "r" / ("0000.bag" if storage == "ros1" else "0000")]) as reader:
        of_topic = {"/cam1/image_raw": [], "/cam1/exposure": []}
        for c, t_ns, raw in reader.messages(c for c in reader.connections if c.topic in of_topic):
            of_topic[c.topic].append((t_ns, reader.deserialize(raw, c.msgtype)))
    images, exposures = of_topic.values()
    assert [(t_ns, e.data) for t_ns, e in exposures] == [(5_000_000, 10_000), (45_000_000, 4000)]
    for (_, image), picture, t_ms in zip(images, taken, (5, 45), strict=True):
        assert (image.encoding, image.step, image.header.stamp.nanosec) == ("mono8", W, t_ms * 10**6)
        np.testing.assert_array_equal(image.data.reshape(H, W), picture >> 8)


def test_ros1_by_import_rosbag(sequence, tmp_path, outside):
    """A bag of ROS 1 by an independent reader: events, pose, IMU, picture, flow."""
    writers.write("ros", [sequence], tmp_path / "r", storage="ros1")
    found = outside("ros1", tmp_path / "r" / "0000.bag")
    left = sequence.cameras["left"]
    small.same_events([found[f"/cam0/events:{k}"] for k in ("ts", "x", "y", "pol")], left.events())
    np.testing.assert_allclose(found["/cam0/pose:point"], left.poses()[1][:, :3, 3])
    np.testing.assert_allclose(found["/imu:acc"][:, 1], -9.81)
    fails(pecs.PecsInputError, "storage: got x, wanted ros1", "ros", [sequence], tmp_path / "x", storage="x")


# --- COCO, WebDataset -------------------------------------------------------------------------------------


def test_coco_by_pycocotools(sequence, exported, capsys):
    from pycocotools.coco import COCO

    folder, report = exported("coco")
    for name, instants in (("left", range(1, 11)), ("frame", (1, 3, 5, 7, 9))):
        camera = sequence.cameras[name]
        coco = COCO(folder / "annotations" / f"train_{name}.json")
        assert coco.loadCats(coco.getCatIds())[0]["name"] == "card"
        assert len(coco.getImgIds()) == len(instants)
        for image, i in zip(coco.loadImgs(coco.getImgIds()), instants, strict=True):
            assert image["t_us"] == camera.truth.times_us[i]
            picture = cv2.imread(str(folder / image["file_name"]))
            assert picture.shape == (H, W, 3)
            (annotation,) = coco.loadAnns(coco.getAnnIds(image["id"]))
            mask = coco.annToMask(annotation)
            np.testing.assert_array_equal(mask, camera.truth.instances(i) == small.CARD)
            assert annotation["area"] == mask.sum() and annotation["bbox"] == list(cv2.boundingRect(mask))
            assert annotation["track_id"] == small.CARD
    np.testing.assert_array_equal(picture, cv2.imread(str(sequence.cameras["frame"].frames()[4].path)))
    assert "camera rgb" in left_out(report)


def test_webdataset_by_its_own_reader(sequence, tmp_path, outside):
    writers.write("webdataset", [sequence], tmp_path / "w", samples_per_shard=8)
    found = outside("webdataset", tmp_path / "w")
    assert len(found["shards"]) == 3  # 2 cameras x 10 intervals by 8
    assert found["keys"].tolist() == [f"0000-{name}-{i:06d}" for name in ("left", "right") for i in range(10)]
    camera = sequence.cameras["right"]
    events, truth = camera.events(), camera.truth
    key, inside = "0000-right-000004", (events["t"] >= 40_000) & (events["t"] < 50_000)
    small.same_events([found[f"{key}/events"][k] for k in "txyp"], events[inside], seconds=False)
    np.testing.assert_array_equal(found[f"{key}/causes"], camera.causes()[inside])
    np.testing.assert_array_equal(found[f"{key}/objects"], camera.objects()[inside])
    np.testing.assert_array_equal(found[f"{key}/flow"], truth.flow(4))
    np.testing.assert_array_equal(found[f"{key}/depth"], truth.depth(5))
    np.testing.assert_array_equal(found[f"{key}/instances"], truth.instances(5))
    assert found[f"{key}/boxes"]["id"].tolist() == [small.CARD, small.WALL]
    assert found[f"{key}/start_us"] == 40_000 and f"{key}/frame" not in found
    frame = cv2.imread(str(sequence.cameras["frame"].frames()[2].path))[..., ::-1]
    np.testing.assert_array_equal(found["0000-left-000004/frame"], frame)


def test_radiance(sequence, exported):
    """A point of the scene, by the poses and intrinsics of transforms.json, is at the pixel where the scene has it; the
    counts are those of E2NeRF's own script on the text file."""
    folder, report = exported("radiance")
    at, camera = folder / "train" / "0000_left", sequence.cameras["left"]
    top = json.loads((at / "transforms.json").read_text())
    left, frames = small.rig()[0], sequence.cameras["frame"].frames()
    assert (top["w"], top["h"], len(top["frames"])) == (W, H, len(frames))
    lens = np.array([[top["fl_x"], 0, top["cx"]], [0, top["fl_y"], top["cy"]], [0, 0, 1]])
    distortion = np.array([top[k] for k in ("k1", "k2", "p1", "p2")])
    for row, frame in zip(top["frames"], frames, strict=True):
        world = left.look(frame.middle_us)[0]
        points = np.linalg.inv(np.array(row["transform_matrix"])) @ np.append(world, np.ones((len(world), 1)), 1).T
        seen = cv2.projectPoints(points[:3].T * [1, -1, -1], np.zeros(3), np.zeros(3), lens, distortion)[0][:, 0]
        x, y = np.meshgrid(np.arange(W) + 0.5, np.arange(H) + 0.5)
        assert np.abs(seen - np.stack([x.ravel(), y.ravel()], 1)).max() < 0.01
        np.testing.assert_array_equal(cv2.imread(str(at / row["file_path"])), cv2.imread(str(frame.path)))
        assert np.array(row["exposure_matrices"]).shape == (5, 4, 4) and (at / row["sharp_file_path"]).is_file()
    rows = np.loadtxt(at / "events.txt", comments="#")
    small.same_events([rows[:, k] for k in range(4)], camera.events())
    counts = np.load(at / "events.npy")
    assert counts.shape == (len(frames), 4, W * H) and np.abs(counts).sum() > 100
    for found, frame in zip(counts, frames, strict=True):
        wanted, step = np.zeros((4, H, W)), (frame.end_us - frame.start_us) / 4
        for t, x, y, p in rows:
            k = (t * 1e6 - frame.start_us + 0.01) / step
            if 0 <= k < 4:
                wanted[int(k), int(y), int(x)] += 1 if p else -1
        np.testing.assert_array_equal(found.reshape(4, H, W), wanted)
    assert "motion of objects" in left_out(report) and "camera right" in left_out(report)


def test_radiance_by_a_loader_of_radiance_fields(sequence, exported, outside):
    """Rays of nerfbaselines through the pixels of each picture pass the points of the scene that are seen there."""
    folder = exported("radiance")[0] / "train" / "0000_left"
    left, frames, found = small.rig()[0], sequence.cameras["frame"].frames(), outside("radiance", folder)
    assert found["names"].tolist() == [f"{i:06d}.png" for i in range(len(frames))]
    x, y = found["pixels"].T
    for frame, origin, ray in zip(frames, found["origins"], found["directions"], strict=True):
        way = left.look(frame.middle_us)[0].reshape(H, W, 3)[y, x] - origin
        angle = np.linalg.norm(np.cross(way, ray), axis=1) / np.linalg.norm(way, axis=1) / np.linalg.norm(ray, axis=1)
        assert angle.max() * left.K[0, 0] < 0.02  # pixels


def test_picture_of_events():
    events = np.zeros(7, pecs.EVENT_DTYPE)
    events["x"], events["p"] = [0, 0, 0, 1, 2, 2, 2], [1, 1, 1, 0, 0, 0, 0]
    assert pecs.event_picture(events, 4, 1).tolist() == [[[7, 118, 180], [226, 142, 77], [214, 98, 7], [255] * 3]]
    with pytest.raises(pecs.PecsInputError, match="pixel"):
        pecs.event_picture(events, 2, 1)


# --- All of them ------------------------------------------------------------------------------------------------------


def hashes(folder):
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.mark.parametrize("name", writers.WRITERS)
def test_same_bytes_again_and_a_report(name, sequence, exported, tmp_path):
    folder, report = exported(name)
    assert writers.write(name, [Sequence(sequence.folder)], tmp_path / name) == report
    assert hashes(tmp_path / name) == hashes(folder) and len(hashes(folder)) > 1
    assert json.loads((folder / "export.json").read_text()) == report
    assert report["format"] == name and any(report["sequences"]["0000"].values())
    assert not list(tmp_path.glob("*.partial"))


def test_only_events(tmp_path, sequence):
    """A sequence of one event camera without truth, pictures or IMU: every writer says what it left out, or why it
    cannot."""
    from pecs.datasets.sequence import Camera

    bare = tmp_path / "sequences" / "bare"
    (bare / "left").mkdir(parents=True)
    info = json.loads((sequence.folder / "sequence.json").read_text())
    info |= {"cameras": [info["cameras"][0] | {"partner": None, "baseline_m": None}], "imu": None, "name": "bare"}
    (bare / "sequence.json").write_text(json.dumps(info))
    for name in ("events.h5", "rectify_map.npy", "camera_path.txt"):
        (bare / "left" / name).write_bytes((sequence.folder / "left" / name).read_bytes())
    alone = Sequence(bare)
    assert isinstance(alone.cameras["left"], Camera)
    expected = {"dsec": "flow, disparity", "dsec_detection": "boxes", "prophesee": "boxes"}
    expected |= {
        "ecd": "imu.txt, imu0/data.csv",
        "ros": "image_raw of camera left",
        "coco": "camera left",
        "webdataset": "camera left",
    }
    picture_formats = ("evreal", "event_cnn", "radiance")
    for name in picture_formats:
        fails(pecs.PecsInputError, f"{name}: the event camera takes no frames", name, [alone], tmp_path / name)
    for name in set(writers.WRITERS) - {*picture_formats}:
        report = writers.write(name, [alone], tmp_path / name)
        assert expected[name] in left_out(report), name
    with h5py.File(tmp_path / "prophesee" / "train" / "bare_td.h5") as file:
        assert len(file["events/t"]) == len(alone.cameras["left"].events())


def fails(kind, wanted, *args, **kwargs):
    with pytest.raises(kind) as error:
        writers.write(*args, **kwargs)
    assert wanted in str(error.value) and "\n" not in str(error.value), str(error.value)


def test_what_cannot_be_written(sequence, tmp_path):
    fails(pecs.PecsInputError, "format: got 'mvsec', wanted one of dsec", "mvsec", [sequence], tmp_path / "a")
    fails(pecs.PecsInputError, "dsec: there are no sequences", "dsec", [], tmp_path / "a")
    fails(pecs.PecsInputError, "got a name twice in 0000, 0000", "ecd", [sequence, sequence], tmp_path / "a")
    (tmp_path / "full").mkdir()
    fails(pecs.PecsOutputError, "full: exists", "ecd", [sequence], tmp_path / "full")
    writers.write("coco", [sequence], tmp_path / "full", replace=True)
    assert (tmp_path / "full/annotations/train_left.json").is_file()
    (tmp_path / "file").touch()
    fails(pecs.PecsOutputError, "Not a directory", "ecd", [sequence], tmp_path / "file" / "x")
    fails(pecs.PecsInputError, "got generation 'gen2'", "prophesee", [sequence], tmp_path / "a", generation="gen2")
    fails(
        pecs.PecsInputError, "samples_per_shard: got 0", "webdataset", [sequence], tmp_path / "a", samples_per_shard=0
    )
    alike = [Sequence(sequence.folder) for _ in range(2)]
    alike[0].name, alike[1].name = "a.b", "a_b"
    fails(pecs.PecsInputError, "got a key twice in a_b-left, ", "webdataset", alike, tmp_path / "a")
    skewed = Sequence(sequence.folder)
    skewed.cameras["right"].R_rect = np.eye(3)
    fails(pecs.PecsInputError, "wanted a rectified pair", "dsec", [skewed], tmp_path / "a")
    (skewed,) = [Sequence(sequence.folder)]
    skewed.cameras = {"rgb": skewed.cameras["rgb"]}
    fails(pecs.PecsInputError, "got no event camera", "dsec", [skewed], tmp_path / "a")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("name", ["dsec", "ecd", "webdataset", "coco"])
def test_a_full_disk(name, sequence, small_disk):
    fails(pecs.PecsOutputError, "space", name, [sequence], small_disk / "a")
    assert not (small_disk / "a").exists() and (small_disk / "a.partial").is_dir()


def test_a_writer_without_its_library_says_so(sequence, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pycocotools.mask", None)
    fails(pecs.PecsError, "scripts/setup.sh --with datasets)", "coco", [sequence], tmp_path / "a")
