"""The motion layer against geometry (scenes of blend_motion.py), through a pinhole and a lens; resumed, in shards,
merged.

World: x right, y ahead, z up; the camera at the origin looks along y."""

import json

import numpy as np
import pecs
import pytest
from support import contents, growing_pecs_blender, make_blends, pecs_blender
from support.views import (
    HEIGHT,
    TOLERANCE_PX,
    WIDTH,
    LensCamera,
    Pinhole,
    check_travel,
    check_way,
    motion,
    pixel_centres,
    shift,
    still,
    turn,
)

COMMON = ("--bands", 1, "--samples", 1, "--fps", 1)
LENS_NAME = "cmount_8mm_f2p8"


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    return make_blends("motion", tmp_path_factory.mktemp("motion"))


def render(blends, name, *args, frames=2):
    """The folder of a stack with motion, rendered once."""
    folder = blends / "-".join(map(str, (name, frames, *args)))
    if not folder.is_dir():
        pecs_blender(
            "render", blends / f"{name}.blend", "-o", folder, *COMMON, "--frames", frames, "--layers", "motion", *args
        )
    return folder


# In blend_motion.py's scenes: what lies at which distances [m], and where it is: world_from_local(t)
RIGID = {
    (3.4, 4.1): lambda t: shift(-1 + 0.3 * t, 4 - 0.2 * t, 0.1 * t),
    (4.9, 5.1): lambda t: shift(1.2, 5, 0) @ turn(1, 0.3 * t),
    (7.9, 8.1): still,
}


def shear(t):
    m = np.eye(4)
    m[0, 2], m[2, 2] = 0.3 * t, 1 + 0.2 * t
    return m


DEFORMING = {  # by x [m] at 4 m
    (-1.65, -0.75): lambda t: shift(-1.2, 4, 0) @ turn(1, 0.3 * t),
    (-0.45, 0.45): lambda t: shift(0.1 * t, 4, 0) @ shear(min(t, 1)),  # a key's value ends at 1
}


@pytest.mark.parametrize("name", ["rigid", "centimetres"])
@pytest.mark.parametrize("interval", [0, 1])
def test_rigid_things(blends, name, interval):
    there, back = motion(render(blends, name, frames=3), interval)
    for way, times in ((there, (interval, interval + 1)), (back, (interval + 1, interval))):
        moves = check_way(way, Pinhole(), RIGID, times)
        rest = (way[8] > 7) | np.isinf(way[8])  # the wall and the sky
        assert (moves[:, rest] == 0).all() and np.isinf(way[9][np.isinf(way[8])]).all()
        assert np.abs(moves).max() > 3


def test_through_a_lens(blends):
    args = ("--lens", LENS_NAME, "--focus", 4, "--fnumber", 4, "--film-shift", 0.3, -0.2)
    folder = render(blends, "rigid", *args, "--samples", 16)
    for way, times in zip(motion(folder), ((0, 1), (1, 0)), strict=True):
        check_way(way, LensCamera(folder), RIGID, times, least=0.99)
    folder = render(blends, "travel", *args, "--samples", 16)
    for way, times in zip(motion(folder), ((0, 1), (1, 0)), strict=True):
        check_travel(way, LensCamera(folder), times, travelling)


def test_through_a_lens_with_distortion(blends):
    """A distortion of 5 % in the corners."""
    args = ("--lens", "fisheye_10mm_f4_muller", "--focus", 4, "--fnumber", 8, "--chip", "davis346", "--samples", 16)
    folder = render(blends, "rigid", *args)
    for way, times in zip(motion(folder), ((0, 1), (1, 0)), strict=True):
        check_way(way, LensCamera(folder), RIGID, times, least=0.9)
    folder = render(blends, "deforming", *args)
    camera, (there, _) = LensCamera(folder), motion(folder)
    for (low, high), pose in DEFORMING.items():
        only = there.copy()
        x = camera.rays()[0] * there[8]
        only[8][(x < low) | (x > high) | (there[8] > 5)] = np.inf
        moves = check_way(only, camera, {(3.9, 4.1): pose}, (0, 1), least=0.9)
        assert np.abs(moves[:, np.isfinite(only[8])]).max() > 1


def travelling(t):
    angle = np.pi / 2 + 0.02 * t, 0.01 * t, 0.05 * t
    world = shift(0.2 * t, 0.1 * t, 0.05 * t) @ turn(2, angle[2]) @ turn(1, angle[1]) @ turn(0, angle[0])
    return np.diag([1, -1, -1, 1]) @ np.linalg.inv(world)


def test_a_camera_that_travels(blends):
    for way, times in zip(motion(render(blends, "travel")), ((0, 1), (1, 0)), strict=True):
        check_travel(way, Pinhole(), times, travelling)


def test_markers_change_the_camera(blends):
    """The lens and the view also change; the samples are those of the command line."""
    args = ("--lens", LENS_NAME, "--focus", 4, "--fnumber", 4, "--film-shift", 0.3, -0.2, "--samples", 16)
    changes, stays = (render(blends, name, *args, frames=3) for name in ("cut", "uncut"))
    for light, same in (("frame_000000.exr", False), ("frame_000001.exr", True), ("frame_000002.exr", True)):
        assert ((changes / light).read_bytes() == (stays / light).read_bytes()) == same

    assert np.isnan(motion(changes)[:, :8]).all()  # a cut is no motion
    assert (motion(changes, 1)[:, :8] == 0).all()


def test_every_instance_goes_its_own_way(blends):
    """Instances of a collection, of one mesh, and made by geometry nodes."""
    there, back = motion(render(blends, "instances"))
    by_square = {}  # where its centre is at t = 0 -> where at t = 1 (x, y ahead, z)
    for i in range(3):
        by_square[-1.2 + 1.2 * i, 0.7] = (-1.2 + 1.2 * i + 0.1 * (i + 1), 4, 0.7)
        by_square[-1.2 + 1.2 * i, -0.7] = (-1.2 + 1.2 * i + 0.15, 4, -0.75)
    for i in range(2):
        by_square[-0.5 + i, 0] = (-0.5 + i, 4 + 0.2 * i, -0.05 * i)
    centres, seen = pixel_centres(), 0
    for (x, z), after in by_square.items():
        on_film = WIDTH / 2 + 16 * x, HEIGHT / 2 - 16 * z  # 16 px per metre at 4 m
        column, row = int(on_film[0]), int(on_film[1])
        at = centres[:, row, column]
        local = (at[0] - on_film[0]) / 16, (on_film[1] - at[1]) / 16
        wanted = WIDTH / 2 + 64 * (after[0] + local[0]) / after[1], HEIGHT / 2 - 64 * (after[2] + local[1]) / after[1]
        assert there[6:8, row, column] == pytest.approx(wanted - at, abs=TOLERANCE_PX), (x, z)
        seen += 1
    assert seen == 8 and len({tuple(v) for v in there[6:8, np.isfinite(there[8])].T.round(2)}) >= 8
    assert not np.isnan(there).any() and not np.isnan(back).any()


def test_what_vanishes_is_not_known(blends):
    there, back = motion(render(blends, "vanishing"))
    square = there[8] < 5
    assert square.sum() == 256 and np.isfinite(there[8][square]).all()
    assert np.isnan(there[:8, square]).all() and np.isnan(there[9][square]).all()
    assert (there[:8, ~square] == 0).all() and (back[:8] == 0).all() and not (back[8] < 5).any()


def test_meshes_that_deform(blends):
    """By an armature and by a shape key, whose shear is affine; one that grows is not known."""
    folder = render(blends, "deforming", frames=3)

    x = pixel_centres()[0]
    for way, times in zip(motion(folder), ((0, 1), (1, 0)), strict=True):
        for (low, high), pose in DEFORMING.items():
            if times[0] == 0:  # where it is known which is which
                only = way.copy()
                only[8][(x < WIDTH / 2 + 16 * low) | (x > WIDTH / 2 + 16 * high) | (way[8] > 5)] = np.inf
                moves = check_way(only, Pinhole(), {(3.9, 4.1): pose}, times)
                assert np.abs(moves[:, np.isfinite(only[8])]).max() > 1
        grows = (way[8] < 5) & (x > WIDTH / 2 + 16 * 0.8)
        assert grows.any() and np.isnan(way[0][grows]).all()
        assert (way[:8, way[8] > 5] == 0).all()
        moving = (way[8] < 5) & ~grows
        assert moving.sum() > 300 and np.isfinite(way[:, moving]).all()


def test_light_is_the_same_beside_motion(blends, tmp_path):
    for name in ("deforming", "instances"):
        beside = render(blends, name, frames=3)
        pecs_blender("render", blends / f"{name}.blend", "-o", tmp_path / name, *COMMON, "--frames", 3)
        alone = {n: b for n, b in contents(tmp_path / name).items() if n.startswith("frame")}
        assert len(alone) == 3 and alone.items() <= contents(beside).items()


def test_a_scene_folders_light_is_the_same_beside_motion(root, tmp_path):
    """Cycles keeps its state between frames: the noise would change if the motion layer made it restart."""
    args = ("--frames", 2, "--fps", 100, "--bands", 1, "--samples", 4, "--lens", "none", "--width", 48)
    for name, more in (("alone", ()), ("beside", ("--layers", "motion"))):
        pecs_blender("render", root / "scenes/room", "-o", tmp_path / name, *args, *more)
    with pecs.StackReader(tmp_path / "alone") as alone, pecs.StackReader(tmp_path / "beside") as beside:
        for i in range(2):
            assert np.mean(alone.read_frame(i) == beside.read_frame(i)) > 0.99  # Cycles' glass varies in the last digit


def test_shards_of_a_plan_have_all_intervals(blends, tmp_path):
    whole = render(blends, "travel", frames=4)
    args = ("render", blends / "travel.blend", *COMMON, "--layers", "motion")
    for name, only in (("a", "0:2"), ("b", "2:4")):
        pecs_blender(*args, "-o", tmp_path / name, "--frames", 4, "--only", only)
    names = [sorted(p.name for p in (tmp_path / n).glob("motion*")) for n in "ab"]
    assert names == [["motion_000000.exr", "motion_000001.exr"], ["motion_000002.exr"]]
    pecs_blender("merge", tmp_path / "b", tmp_path / "a", "-o", tmp_path / "merged")
    assert contents(tmp_path / "merged") == contents(whole)

    for name, frames in (("c", "0:2"), ("d", "2:4"), ("e", "1:3")):  # of instants: one interval lies between
        pecs_blender(*args, "-o", tmp_path / name, "--frames", frames)
    result = pecs_blender("merge", tmp_path / "c", tmp_path / "d", "-o", tmp_path / "x", check=False)
    assert result.returncode == 4 and "motion: interval 1000000000 to 2000000000 ns" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    pecs_blender("merge", *(tmp_path / n for n in "cde"), "-o", tmp_path / "y")  # e has it
    assert contents(tmp_path / "y") == contents(whole)


def test_a_stopped_job_goes_on(blends, tmp_path):
    """After a restart, and where files are missing."""
    whole = contents(render(blends, "rigid", frames=3))
    args = ("render", blends / "rigid.blend", "-o", tmp_path / "s", *COMMON, "--frames", 3, "--layers", "motion")
    result = growing_pecs_blender(*args)
    assert "1 of 3 exist already" in result.stderr and contents(tmp_path / "s") == whole
    (tmp_path / "s/motion_000001.exr").unlink()
    (tmp_path / "s/motion_000000.exr").write_bytes(whole["motion_000000.exr"][:-9])
    before = (tmp_path / "s/frame_000001.exr").stat().st_mtime_ns
    result = pecs_blender(*args)
    assert "1 of 3 exist already" in result.stderr and contents(tmp_path / "s") == whole
    assert (tmp_path / "s/frame_000001.exr").stat().st_mtime_ns == before


def test_a_scene_that_repeats_has_an_interval_more(root, tmp_path):
    args = ("--frames", "period", "--fps", 100, "--bands", 1, "--samples", 1, "--lens", "none", "--width", WIDTH)
    pecs_blender("render", root / "scenes/room", "-o", tmp_path / "s", *args, "--layers", "motion,depth")
    stack = json.loads((tmp_path / "s/stack.json").read_text())
    assert [entry["name"] for entry in stack["layers"]] == ["motion", "depth"]
    assert stack["layers"][0]["at"] == "interval" and len(stack["layers"][0]["channels"]) == 20
    n = len(stack["times_ns"])
    assert n > 2 and len(list((tmp_path / "s").glob("motion_*.exr"))) == n == len(
        list((tmp_path / "s").glob("depth_*"))
    )
    there, back = motion(tmp_path / "s", n - 1)
    with pecs.StackReader(tmp_path / "s") as reader:
        first, last = reader.read_layer("depth", 0)[1], reader.read_layer("depth", n - 1)[1]
    assert there[8] == pytest.approx(last, rel=1e-5)
    assert np.mean(np.abs(back[8] / first - 1) < 1e-4) > 0.99  # it ends where the first instant begins
    assert 0.02 < (there[6] != 0).mean() < 0.5  # the rest of the room is still


def test_what_is_clear_is_looked_through(blends):
    """A box of nothing but fog, and a pane."""
    there, _ = motion(render(blends, "fog"))
    square = (there[8] > 3.9) & (there[8] < 4.1)
    assert square.sum() == 256 and (there[8] > 3.9).all()
    assert there[6, square] == pytest.approx(3.2, abs=TOLERANCE_PX) and (there[:8, ~square] == 0).all()


def test_holes_of_a_texture_are_looked_through(blends):
    """As Cycles does, which depth asks; and all of a clear material's polygons."""
    folder = render(blends, "holes", "--layers", "depth,motion")
    there, _ = motion(folder)
    with pecs.StackReader(folder) as stack:
        depth = stack.read_layer("depth", 0)[1]
    x, y = pixel_centres()
    clear = (x > WIDTH / 2) & (y < HEIGHT / 2)
    assert there[8][~clear] == pytest.approx(depth[~clear], rel=1e-5) and (there[8][clear] > 5).all()
    plate = there[8] < 5
    assert 0.3 < plate[~clear].mean() < 0.8
    assert (there[:8, plate] == 0).all()
    assert there[6, ~plate] == pytest.approx(np.full((~plate).sum(), 4.0), abs=TOLERANCE_PX)


def test_physics_that_is_not_baked(blends, tmp_path):
    """A rigid body falls with 9.81 m/s^2, Blender's damping of 4 % per second apart, and takes a child along; nodes
    move another thing; a shard without layers has the same light."""
    args = ("--fps", 24)
    folder = render(blends, "falling", *args, frames=5)
    falls = []
    for i in range(4):
        there, _ = motion(folder, i)
        far = np.isfinite(there[8]) & (there[8] > 3)
        body, child = (far & part for part in (pixel_centres()[0] < 38, pixel_centres()[0] > 38))
        played = there[6, there[8] < 3]
        assert len(played) >= 25 and played == pytest.approx(0.02 * WIDTH / 2, abs=TOLERANCE_PX)
        assert body.sum() >= 49 and child.sum() >= 16
        moving = there[:, body | child]
        assert np.ptp(moving[7]) < TOLERANCE_PX and np.abs(moving[6]).max() < TOLERANCE_PX
        falls.append(moving[7].mean())
    assert np.diff(falls) == pytest.approx(9.81 / 24**2 * WIDTH / 4, rel=0.01)
    pecs_blender(
        "render", blends / "falling.blend", "-o", tmp_path / "s", *COMMON, *args, "--frames", 5, "--only", "3:5"
    )
    alone = {n: b for n, b in contents(tmp_path / "s").items() if n.startswith("frame")}
    assert len(alone) == 2 and alone.items() <= contents(folder).items()
