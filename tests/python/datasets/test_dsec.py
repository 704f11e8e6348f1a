"""DSEC and DSEC-Detection as written, by event-vision-library, DSEC's own code and OpenCV, against the scene itself."""

import json

import cv2
import h5py
import numpy as np
import pecs
import pytest
from pecs.datasets import Sequence, writers
from pecs.datasets.rectify import Rectifier, Stereo
from support import small_sequence as small

W, H = 96, 72


@pytest.fixture(scope="module")
def dsec(exported, outside):
    return outside("dsec", exported("dsec")[0] / "train" / "0000")


def rect_scene(eye, t_us):
    """For every pixel of the rectified picture: points of the world, depth along its axis, ids."""
    grid = np.stack([*np.meshgrid(np.arange(W), np.arange(H)), np.ones((H, W))], -1).reshape(-1, 3)
    rays = grid @ np.linalg.inv(eye.K_rect).T @ eye.R_rect
    world, z, ids, _ = eye.look(t_us, rays / rays[:, 2:])
    return world, z * (rays / rays[:, 2:] @ eye.R_rect[2]), ids


def rect_project(eye, world, t_us):
    camera_from_world = np.linalg.inv(eye.world_from_camera(t_us))
    points = (world @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]) @ eye.R_rect.T
    pixels = points @ eye.K_rect.T
    return pixels[:, :2] / pixels[:, 2:]


def inside_one_surface(ids):
    """Pixels whose neighbours see the same thing."""
    ids = ids.reshape(H, W).astype(np.uint8)
    return cv2.erode(ids, np.ones((5, 5))) == cv2.dilate(ids, np.ones((5, 5)))


def test_dsec_events_by_event_vision_library(sequence, dsec):
    for side in ("left", "right"):
        camera = sequence.cameras[side]
        events = camera.events()
        small.same_events([dsec[f"{side}_{k}"] for k in ("t_s", "x", "y", "p")], events)
        window = events[(events["t"] > 20_500) & (events["t"] <= 71_200)]
        small.same_events([dsec[f"{side}_window_{k}"] for k in ("t_s", "x", "y", "p")], window)
        np.testing.assert_array_equal(dsec[f"{side}_map"], camera.rectify_map())
        assert len(dsec[f"{side}_ms_to_idx"]) == 101 and dsec[f"{side}_ms_to_idx"][0] == 0


def test_dsec_events_by_dsecs_own_slicer(sequence, exported):
    from support.outside.dsec_eventslicer import EventSlicer

    events = sequence.cameras["right"].events()
    with h5py.File(exported("dsec")[0] / "train" / "0000" / "events" / "right" / "events.h5") as file:
        slicer = EventSlicer(file)
        for start, end in ((0, 10_000), (12_345, 50_001), (90_000, 100_000)):  # to the last window of the truth
            found = slicer.get_events(start, end)
            want = events[(events["t"] >= start) & (events["t"] < end)]
            small.same_events([found[k] for k in "txyp"], want, seconds=False)


def test_dsec_disparity_is_the_scenes(dsec):
    left, right, *_ = small.rig()
    np.testing.assert_array_equal(np.rint(dsec["disparity_times"] * 1e6), small.TRUTH_US)
    for i, t in enumerate(small.TRUTH_US):
        world, z, ids = rect_scene(left, t)
        want = left.picture(left.K_rect[0, 0] * 0.12 / z)
        known, inner = dsec["disparity_known"][i], inside_one_surface(ids)
        assert (known & inner).sum() > 0.8 * inner.sum() and inner.sum() > 4000
        error = (dsec["disparity"][i] - want)[known & inner]
        assert np.sqrt((error**2).mean()) < 0.002 and np.abs(error).max() < 0.006
    # The right camera sees the same points in the same rows, so far to the left.
    right_px = rect_project(right, world, t)
    left_px = rect_project(left, world, t)
    assert np.abs(right_px[:, 1] - left_px[:, 1]).max() < 1e-6
    np.testing.assert_allclose(left.picture(left_px[:, 0] - right_px[:, 0]), want, atol=1e-6)


def test_dsec_flow_is_the_scenes(dsec):
    left = small.rig()[0]
    for name, step in (("forward", 1), ("backward", -1)):
        pairs = np.rint(dsec[f"{name}_times"] * 1e6).astype(int)
        assert len(pairs) == 10 and (pairs[:, 1] - pairs[:, 0] == step * 10_000).all()
        for i, (start, end) in enumerate(pairs):
            world, _, ids = rect_scene(left, start)
            moved = rect_project(left, left.moved(world, ids, start, end), end)
            want = left.picture(moved - rect_project(left, world, start))
            known = dsec[f"{name}_known"][i] & inside_one_surface(ids)
            assert known.sum() > 4000 and np.abs(want[known]).max() > 0.5
            error = (dsec[name][i] - want)[known]
            assert np.sqrt((error**2).mean()) < 0.003 and np.abs(error).max() < 0.006


def test_dsec_flow_over_longer(sequence, tmp_path):
    """As DSEC's 100 ms over its truth: here 30 ms over instants of 10 ms."""
    left = small.rig()[0]
    writers.write("dsec", [sequence], tmp_path / "d", flow_us=30_000)
    folder = tmp_path / "d" / "train" / "0000" / "flow"
    for name, start, end in (("forward", 30_000, 60_000), ("backward", 60_000, 30_000)):
        lines = (folder / f"{name}_timestamps.txt").read_text().splitlines()
        assert len(lines) == 4 and lines[2] == f"{start}, {end}"
        rgb = cv2.imread(str(folder / name / "000001.png"), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(float)
        world, _, ids = rect_scene(left, start)
        moved = rect_project(left, left.moved(world, ids, start, end), end)
        want = left.picture(moved - rect_project(left, world, start))
        known = (rgb[..., 2] == 1) & inside_one_surface(ids)
        error = ((rgb[..., :2] - 2**15) / 128 - want)[known]
        assert known.sum() > 4000 and np.sqrt((error**2).mean()) < 0.01
    with pytest.raises(pecs.PecsInputError, match="flow_us: got 35000, wanted the time between"):
        writers.write("dsec", [sequence], tmp_path / "e", flow_us=35_000)


def test_through_a_lens_that_opencv_has_no_model_of(tmp_path):
    """Half a pixel off at 60 px of wave length: rectify_map.npy holds it, K and the distortion do not."""
    left, right, *_ = small.rig(bent_px=0.5)
    sequence = Sequence(small.write(tmp_path / "0000", bent_px=0.5))
    rectifier = Rectifier(sequence.cameras["left"])
    stereo = Stereo(sequence.cameras["left"], sequence.cameras["right"])
    truth = sequence.cameras["left"].truth
    world, z, ids = rect_scene(left, 30_000)
    known = inside_one_surface(ids)
    surface = truth.instances(3)
    px = rectifier.disparity(truth.depth(3)[1].astype(float), stereo, surface)
    flow = rectifier.flow(truth.flow(3, 5), surface)
    moved = rect_project(left, left.moved(world, ids, 30_000, 50_000), 50_000)
    for found, want in (
        (px[..., None], left.picture(left.K_rect[0, 0] * 0.12 / z)[..., None]),
        (flow, left.picture(moved - rect_project(left, world, 30_000))),
    ):
        inner = known & np.isfinite(found).all(-1)
        assert inner.sum() > 4000 and np.sqrt(((found - want)[inner] ** 2).mean()) < 0.003
    back = rectifier.lens.from_rect(rectifier.lens.to_rect(rectifier.lens.pixels + 0.3))
    np.testing.assert_allclose(back, rectifier.lens.pixels + 0.3, atol=1e-3)


def test_dsec_codes_of_16_bits_by_another_decoder(exported, dsec):
    import imageio.v3 as imageio

    folder = exported("dsec")[0] / "train" / "0000"
    rgb = cv2.imread(str(folder / "flow" / "forward" / "000003.png"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert rgb.dtype == np.uint16 and set(np.unique(rgb[..., 2])) == {0, 1}
    known = rgb[..., 2] == 1
    np.testing.assert_array_equal((rgb[..., :2].astype(float) - 2**15)[known] / 128, dsec["forward"][3][known])
    assert (rgb[..., :2][~known] == 2**15).all()
    code = imageio.imread(folder / "disparity" / "event" / "000003.png")
    assert code.dtype == np.uint16 and code.shape == (H, W)
    np.testing.assert_array_equal(code / 256, dsec["disparity"][3])


def test_dsec_codes_at_their_ends():
    from pecs.datasets.writers.dsec import disparity_picture, flow_picture

    flow = np.array([[[-256, 0], [255.99, 1 / 256], [256, 0], [0, -256.01], [np.nan, 0], [0.01, -0.01], [1, 1]]])
    code, misfits = flow_picture(flow, np.arange(7)[None] < 6)
    assert code.tolist() == [
        [[0, 32768, 1], [65535, 32768, 1], [32768, 32768, 0], [32768, 32768, 0], [32768, 32768, 0], [32769, 32767, 1]]
        + [[32768, 32768, 0]]  # hidden
    ]
    assert misfits == 2
    code, misfits = disparity_picture(np.array([[0.0, 1 / 256, 255.99, 256.0, -1.0, np.nan]]))
    assert code.tolist() == [[0, 1, 65533, 0, 0, 0]] and misfits == 3


def test_dsec_calibration_aligns_rows(dsec):
    """OpenCV's rectification by the written file: rows match, and Q gives the depth back."""
    left, right, rgb, _ = small.rig()
    world, z, _, _ = left.look(50_000)
    rows = []
    for eye, n in ((left, 0), (right, 3)):
        pixels, depth = eye.project(world, 50_000)
        seen = (pixels >= 0).all(1) & (pixels < [W - 1, H - 1]).all(1) & (depth > 0)
        f, kr = dsec[f"K{n}"], dsec[f"Kr{n}"]
        K, Kr = (np.array([[v[0], 0, v[2]], [0, v[1], v[3]], [0, 0, 1]]) for v in (f, kr))
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        rows.append((cv2.undistortPointsIter(pixels[:, None], K, dsec[f"D{n}"], dsec[f"R{n}"], Kr, stop)[:, 0], seen))
    both = rows[0][1] & rows[1][1]
    assert both.sum() > 4000
    a, b = rows[0][0][both], rows[1][0][both]
    assert np.abs(a[:, 1] - b[:, 1]).max() < 0.01
    points = np.column_stack([a, a[:, 0] - b[:, 0], np.ones(len(a))]) @ dsec["Q"].T
    rect = np.column_stack([left.rays * z[:, None]])[both] @ left.R_rect.T
    np.testing.assert_allclose(points[:, :3] / points[:, 3:], rect, atol=1e-3)
    np.testing.assert_allclose(dsec["T10"], np.linalg.inv(rgb.rig_from_camera), atol=1e-9)
    np.testing.assert_allclose(dsec["T31"] @ dsec["T10"], np.linalg.inv(right.rig_from_camera), atol=1e-9)


def test_dsec_images(sequence, dsec):
    camera = sequence.cameras["rgb"]
    assert np.rint(dsec["image_times"] * 1e6).tolist() == [10_000, 30_000, 50_000, 70_000, 90_000]
    assert np.rint(dsec["exposures"][1] * 1e6).tolist() == [27_500, 32_500]
    want = cv2.undistort(cv2.imread(str(camera.frames()[2].path)), camera.K, camera.distortion)
    assert np.abs(dsec["images"][2].astype(int) - want).mean() < 0.5


def test_dsec_detection(sequence, exported):
    folder, report = exported("dsec_detection")
    at = folder / "train" / "0000"
    tracks = np.load(at / "object_detections" / "left" / "tracks.npy")
    assert json.loads((folder / "classes.json").read_text())["card"] == 8
    times = np.genfromtxt(at / "images" / "timestamps.txt", dtype="int64")
    np.testing.assert_array_equal(tracks["t"], times)  # one box at every picture, as dsec-det pairs them
    ids = sequence.cameras["left"].truth.instances(3)
    x, y, w, h = cv2.boundingRect((ids == small.CARD).astype(np.uint8))
    assert [float(tracks[1][k]) for k in "xywh"] == [x, y, w, h]
    assert set(tracks["class_id"]) == {8} and set(tracks["track_id"]) == {small.CARD}
    pictures = sorted((at / "images" / "left" / "distorted").glob("*.png"))
    assert len(pictures) == len(times)
    # View of the other camera in the directions of the left one's pixels.
    left, _, rgb, _ = small.rig()
    want = np.clip(60 * left.picture(rgb.light(50_000, left.rays)), 0, 255)
    seen = cv2.imread(str(pictures[2]))[..., 1].astype(float)
    inner = np.s_[10:-10, 10:-10]
    assert np.corrcoef(seen[inner].ravel(), want[inner].ravel())[0, 1] > 0.97
    assert report["sequences"]["0000"]["boxes"] == 5
