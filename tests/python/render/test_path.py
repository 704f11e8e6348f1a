"""The camera on a path (`--camera-path`): through a lens and a pinhole, in a scene folder and a .blend, against
projection; what the path's file may not say."""

import json

import numpy as np
import pecs
import pytest
from scipy.spatial.transform import Rotation, Slerp
from support import make_blends, pecs_blender
from support.views import HEIGHT, WIDTH, LensCamera, Pinhole, check_travel, motion

COMMON = ("--bands", 1, "--samples", 1)
LENS = ("--lens", "cmount_8mm_f2p8", "--focus", 4, "--fnumber", 4, "--film-shift", 0.3, -0.2)
AHEAD = Rotation.from_euler("x", -90, degrees=True)  # world_from_camera of one that looks along +y
TIMES = [-0.5, 0.7, 1.3, 4.0]
POSITIONS = np.array([[0, 0, 0], [0.1, 0.2, 0.05], [0.3, 0.1, -0.1], [0.0, -0.5, 0.1]])
TURNS = Rotation.from_euler("zxy", [[0, 0, 0], [2, 1, 4], [-3, 2, 8], [1, 0, -5]], degrees=True) * AHEAD


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    return make_blends("motion", tmp_path_factory.mktemp("path"), "led", "centimetres")


def write(path, times, positions, turns):
    """A TUM file; every second quaternion with the other sign."""
    rows = ["# t_s tx ty tz qx qy qz qw", ""]
    for i, (t, p, q) in enumerate(zip(times, positions, turns.as_quat(), strict=True)):
        rows.append(" ".join(f"{v:.17g}" for v in (t, *p, *(q * (-1) ** i))) + "  # row")
    path.write_text("\n".join(rows))
    return path


@pytest.fixture(scope="module")
def path(blends):
    return write(blends / "path.txt", TIMES, POSITIONS, TURNS)


def camera_from_world(t):
    world = np.eye(4)
    world[:3, :3] = Slerp(TIMES, TURNS)(t).as_matrix()
    world[:3, 3] = [np.interp(t, TIMES, axis) for axis in POSITIONS.T]
    return np.linalg.inv(world)


@pytest.mark.parametrize("lens", [(), LENS])
def test_a_blends_camera_follows(blends, path, tmp_path, lens):
    """Whatever else moves it; and motion and depth with it."""
    args = ("--frames", 3, "--fps", 1, "--no-light", "--layers", "motion,depth", "--camera-path", path, *lens)
    pecs_blender("render", blends / "led.blend", "-o", tmp_path / "s", *COMMON, *args)
    camera = LensCamera(tmp_path / "s") if lens else Pinhole()
    for i in (0, 1):
        ways = motion(tmp_path / "s", i)
        for way, times in zip(ways, ((i, i + 1), (i + 1, i)), strict=True):
            check_travel(way, camera, times, camera_from_world)
        with pecs.StackReader(tmp_path / "s") as stack:
            seen = stack.read_layer("depth", i)[1]
        assert np.allclose(seen, ways[0][8], rtol=1e-5)


def test_metres_whatever_the_unit(blends, tmp_path):
    """The scene `rigid` in centimetres: a wall at 8 m."""
    path = write(tmp_path / "p.txt", [0], [[0, 3, 0]], Rotation.concatenate([AHEAD]))
    args = ("--frames", 1, "--no-light", "--layers", "depth", "--camera-path", path)
    pecs_blender("render", blends / "centimetres.blend", "-o", tmp_path / "s", *COMMON, *args)
    with pecs.StackReader(tmp_path / "s") as stack:
        depth = stack.read_layer("depth", 0)[1]
    assert depth[HEIGHT // 2, 2] == pytest.approx(5, rel=1e-5)


def box_depth(rays, world_from_camera):
    """Depth along the optical axis to the walls of the scenes' room (build.py)."""
    low, high = np.array([-1.2, -0.4, -0.9]), np.array([1.2, 1.8, 0.9])
    along = np.einsum("ij,jyx->iyx", world_from_camera[:3, :3], np.stack([*rays, np.ones_like(rays[0])]))
    at = world_from_camera[:3, 3][:, None, None]
    with np.errstate(divide="ignore"):
        walls = np.where(along > 0, (high[:, None, None] - at) / along, (low[:, None, None] - at) / along)
    return walls.min(0)


@pytest.mark.parametrize("lens", ["none", "pecs_lab_15mm"])
def test_a_scene_folders_camera_follows(root, tmp_path, lens):
    turns = Rotation.from_euler("zx", [[150, 5], [230, -10]], degrees=True) * AHEAD  # away from the disk
    positions = np.array([[0.1, 0, 0], [-0.2, -0.1, 0.2]])
    path = write(tmp_path / "p.txt", [0.002, 0.012], positions, turns)
    args = ("--frames", "2:12", "--fps", 1000, "--width", WIDTH, "--height", HEIGHT, "--layers", "depth", "--no-light")
    more = ("--focal", 6, "--film-width", 6) if lens == "none" else ()
    args = (*COMMON, *args, "--lens", lens, *more, "--camera-path", path)
    pecs_blender("render", root / "scenes/rotating_disk", "-o", tmp_path / "s", *args)
    camera = Pinhole() if lens == "none" else LensCamera(tmp_path / "s")
    with pecs.StackReader(tmp_path / "s") as stack:
        for i, t in ((0, 0.002), (7, 0.009)):
            world = np.eye(4)
            world[:3, :3] = Slerp([0.002, 0.012], turns)(t).as_matrix()
            world[:3, 3] = [np.interp(t, [0.002, 0.012], axis) for axis in positions.T]
            wanted, seen = box_depth(camera.rays(), world), stack.read_layer("depth", i)[1]
            known = np.isfinite(wanted)
            assert known.mean() > 0.9 and np.ptp(wanted[known]) > 0.1 * wanted.min()
            assert np.abs(seen[known] / wanted[known] - 1).max() < 1e-4


def test_light_follows(blends, tmp_path):
    """At its rows, a path of the camera's own poses gives the same light."""
    make_blends("motion", tmp_path, "travel")
    turns = Rotation.from_euler("xyz", [[90, 0, 0], np.degrees([np.pi / 2 + 0.02, 0.01, 0.05])], degrees=True)
    turns *= Rotation.from_matrix(np.diag([1.0, -1, -1]))
    path = write(tmp_path / "p.txt", [0, 1], [[0, 0, 0], [0.2, 0.1, 0.05]], turns)
    light = []
    for name, more in (("own", ()), ("led", ("--camera-path", path))):
        args = (*COMMON, "--frames", 2, "--fps", 1, *LENS, "--samples", 64, *more)
        pecs_blender("render", tmp_path / "travel.blend", "-o", tmp_path / name, *args)
        with pecs.StackReader(tmp_path / name) as stack:
            light.append(np.array([stack.read_frame(i) for i in (0, 1)]))
    own, led = light
    assert own.max() > 0 and np.abs(own[0] - own[1]).mean() > 0.02 * own.mean()
    assert np.abs(own - led).mean() < 1e-3 * own.mean()


def test_keyframes_follow(blends, path, tmp_path):
    """--time adaptive takes as many as the path asks for; the motion between them is the path's."""
    args = ("--frames", 33, "--fps", 16, "--time", "adaptive", "--subpixels", 1, "--step", 4)
    pecs_blender("render", blends / "led.blend", "-o", tmp_path / "s", *COMMON, *args, "--camera-path", path)
    stack = json.loads((tmp_path / "s/stack.json").read_text())
    times = np.array(stack["times_ns"]) * 1e-9
    assert 5 < len(times) < 33
    ways = motion(tmp_path / "s", 2)
    begin, end = times[2:4]
    # `z` and `z_end` are rounded to 16 bits.
    check_travel(ways[0], Pinhole(), (begin, end), camera_from_world, depth_rtol=2e-5)


def test_another_path_is_another_stack(blends, path, tmp_path):
    args = ("render", blends / "led.blend", "-o", tmp_path / "s", *COMMON, "--frames", 2, "--no-light")
    args = (*args, "--layers", "depth", "--fps", 1, "--camera-path")
    pecs_blender(*args, path)
    copy = tmp_path / "elsewhere.txt"
    copy.write_bytes(path.read_bytes())
    assert "2 of 2 exist already" in pecs_blender(*args, copy).stderr
    write(copy, TIMES, 1.01 * POSITIONS, TURNS)
    result = pecs_blender(*args, copy, check=False)
    assert result.returncode == 5 and "camera_path_sha256" in result.stderr and "--overwrite" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "text, line",
    [
        ("0 0 0 0 0 0 0 1 5", 'line 1: got "0 0 0 0 0 0 0 1 5", wanted 8 finite numbers'),
        ("0 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1", "times: got 0 to 0.5 s, wanted all of 0 to 1 s"),
        ("0.5 0 0 0 0 0 0 1\n5 0 0 0 0 0 0 1", "times: got 0.5 to 5 s, wanted all of 0 to 1 s"),
        (None, "no such file or folder"),
    ],
)
def test_bad_paths_are_one_line(blends, tmp_path, text, line):
    """tests/python/datasets/test_trajectories.py has all that can be wrong with a file of poses."""
    path = tmp_path / "bad.txt"
    if text is not None:
        path.write_text(text)
    args = ("--frames", 2, "--fps", 1, "--no-light", "--layers", "depth", "--camera-path", path)
    result = pecs_blender("render", blends / "led.blend", "-o", tmp_path / "s", *COMMON, *args, check=False)
    assert result.returncode == (3 if text is None else 4) and line in result.stderr, result.stderr
    assert str(path) in result.stderr and len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "s").exists()


def test_a_period_ends_where_it_began(root, tmp_path):
    turns = Rotation.from_euler("z", [[0], [10], [0]], degrees=True) * AHEAD
    args = ("render", root / "scenes/rotating_disk", *COMMON, "--frames", "period", "--fps", 20, "--width", 16)
    args = (*args, "--lens", "none", "--no-light", "--layers", "depth")
    for name, end in (("same", 0), ("other", 0.1)):
        path = write(tmp_path / f"{name}.txt", [0, 0.01, 100], [[0, 0, 0], [0, 0.1, 0], [end, 0, 0]], turns)
        result = pecs_blender(*args, "-o", tmp_path / name, "--camera-path", path, check=False)
        assert result.returncode == 4 and "wanted the first pose, for one period" in result.stderr
    path = write(tmp_path / "still.txt", [0], [[0, 0, 0]], turns[:1])
    pecs_blender(*args, "-o", tmp_path / "still", "--camera-path", path)
