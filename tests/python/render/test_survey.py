"""Points on a scene's surfaces (`pecs_blender survey`) against what the scenes of blend_things.py are made of."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from support import make_blends, pecs_blender

SPACING_M = 0.05


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    return make_blends("things", tmp_path_factory.mktemp("survey"), "things", "centimetres", "bad_class")


def survey(scene, output, *args):
    pecs_blender("survey", scene, "-o", output, *args)
    with np.load(output) as arrays:
        return dict(arrays)


@pytest.fixture(scope="module")
def whole(blends):
    return survey(blends / "things.blend", blends / "s.npz", "--frames", 3, "--fps", 2, "--spacing", SPACING_M)


def of(found, name, instant=None):
    """Points and normals of a thing, that stands still or at an instant."""
    (number,) = found["ids"][found["names"] == name]
    if instant is None:
        mine = found["static_objects"] == number
        return found["static_points"][mine].astype(float), found["static_normals"][mine].astype(float)
    rows = slice(*found["first"][instant : instant + 2])
    mine = found["objects"][rows] == number
    return found["points"][rows][mine].astype(float), found["normals"][rows][mine].astype(float)


def test_a_ball(whole):
    points, normals = of(whole, "ball")
    out = points - [-1.2, 4, 0.6]
    assert np.abs(np.linalg.norm(out, axis=1) - 0.5).max() < 1e-3
    assert (np.einsum("ni,ni->n", out / 0.5, normals) > 0.99).all()
    assert len(points) == pytest.approx(np.pi / SPACING_M**2, rel=0.02)
    directions = np.random.default_rng(1).normal(size=(2000, 3))
    on_ball = [-1.2, 4, 0.6] + 0.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assert KDTree(points).query(on_ball)[0].max() < 2 * SPACING_M


def test_a_box_without_gaps(whole):
    """The room: big polygons."""
    points, normals = of(whole, "room")
    off = np.abs(points - [0, 5, 6])
    assert np.allclose(off.max(1), 10, atol=1e-5) and np.allclose(np.abs(normals).max(1), 1)
    rng = np.random.default_rng(1)
    on_wall = np.column_stack([np.full(3000, 10.0), *rng.uniform(-5, 15, (2, 3000))]) + [0, 0, 1]
    assert KDTree(points).query(on_wall)[0].max() < 2 * SPACING_M


def test_what_moves_is_where_it_is(whole):
    """A car that moves, a flag that grows; everything else is written once."""
    assert whole["times_s"].tolist() == [0, 0.5, 1] and whole["first"][0] == 0
    for i, t in enumerate(whole["times_s"]):
        points, _ = of(whole, "car 0", i)
        assert len(points) > 6 * 0.9 / SPACING_M**2
        centre = np.array([0.2 - 0.2 * t, 4, -0.6 + 0.1 * t])
        assert np.allclose(np.abs(points - centre).max(1), 0.5, atol=1e-5)
        flag, _ = of(whole, "flag", i)
        assert np.ptp(flag[:, 0]) == pytest.approx(0.9 * (1 + 0.5 * t), abs=SPACING_M)
    moving = {whole["names"][whole["ids"] == k][0] for k in np.unique(whole["objects"])}
    assert moving == {"car 0", "flag"}
    still = {whole["names"][whole["ids"] == k][0] for k in np.unique(whole["static_objects"])}
    assert {"car 1", "empty 0/tree", "leaves/leaves#0.2", "behind", "room"} <= still and not still & moving
    classes = dict(zip(whole["names"], whole["classes"], strict=True))
    assert classes["car 0"] == "car" and classes["room"] == "wall" and classes["flag"] == ""
    assert whole["bounds_m"].tolist() == [[-10, -5, -4], [10, 15, 16]]
    assert whole["duration_s"] == 10 and np.isnan(whole["period_s"]) and whole["unit_m"] == 1


def test_metres_whatever_the_unit(blends, tmp_path):
    found = survey(blends / "centimetres.blend", tmp_path / "s.npz", "--frames", 1)
    plane, normals = of(found, "plane")
    turn = Rotation.from_euler("xyz", [20, 10, 30], degrees=True)
    local = turn.inv().apply(plane - [0.7, 4, 0])
    assert np.abs(local[:, 1]).max() < 1e-5 and np.abs(local[:, [0, 2]]).max() == pytest.approx(0.5, abs=0.01)
    assert np.allclose(np.abs(turn.inv().apply(normals)[:, 1]), 1)
    assert 190_000 < len(found["static_points"]) < 210_000 and found["unit_m"] == np.float32(0.01)


def test_a_scene_folder_covers_its_period(root, tmp_path):
    found = survey(root / "scenes/room", tmp_path / "s.npz", "--spacing", 0.1, "--set", "swing_hz=2")
    assert found["period_s"] == 0.5 and found["times_s"] == pytest.approx(np.arange(5) * 0.1)
    hanging = [of(found, "hanging ball", i)[0].mean(0) for i in range(5)]
    assert np.abs(np.diff(np.array(hanging)[:, 0])).max() > 0.1
    again = tmp_path / "again.npz"
    survey(root / "scenes/room", again, "--spacing", 0.1, "--set", "swing_hz=2")
    assert again.read_bytes() == (tmp_path / "s.npz").read_bytes()


@pytest.mark.parametrize(
    "scene, output, args, code, line",
    [
        ("things.blend", "s.txt", (), 2, "the extension must be .npz"),
        ("things.blend", "no/s.npz", (), 2, "the folder does not exist"),
        ("things.blend", "s.npz", ("--spacing", 0), 2, "--spacing: got 0, wanted a finite number"),
        ("things.blend", "s.npz", ("--spacing", 1e-6), 2, "wanted at most"),
        ("things.blend", "s.npz", ("--fps", "nan"), 2, "--fps: got 'nan'"),
        ("things.blend", "s.npz", ("--frames", "x"), 2, "--frames"),
        ("bad_class.blend", "s.npz", (), 4, "'thing'.pecs_class: got 3"),
        ("gone.blend", "s.npz", (), 3, "no such file"),
    ],
)
def test_bad_input_is_one_line(blends, tmp_path, scene, output, args, code, line):
    result = pecs_blender("survey", blends / scene, "-o", tmp_path / output, *args, check=False)
    assert result.returncode == code and line in result.stderr and len(result.stderr.splitlines()) == 1, result.stderr
    assert not list(tmp_path.iterdir())
