"""The layer `objects` and objects.json against Cycles' own Cryptomatte, against projection through a pinhole and a lens
with 5 % distortion, and against renders of one thing alone; resumed, in shards, merged (scenes of blend_things.py)."""

import itertools
import json

import numpy as np
import pecs
import pytest
from support import contents, growing_pecs_blender, make_blends, pecs_blender, run_support
from support.views import FLIP, LensCamera, Pinhole, shift, turn

SIZE = WIDTH, HEIGHT = 160, 120
ARGS = ("--frames", 2, "--fps", 1, "--bands", 1, "--no-light", "--layers", "objects,depth")
FISHEYE = ("--lens", "fisheye_10mm_f4_muller", "--focus", 4, "--fnumber", 8, "--chip", "davis346")


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    return make_blends("things", tmp_path_factory.mktemp("things"))


@pytest.fixture(scope="module")
def whole(blends):
    pecs_blender("render", blends / "things.blend", "-o", blends / "s", *ARGS)
    return blends / "s"


def ids_of(folder, index=0):
    with pecs.StackReader(folder) as stack:
        ids = stack.read_layer("objects", index)[0]
    assert (ids == ids.round()).all()
    return ids.astype(int)


def known(folder):
    return json.loads((folder / "objects.json").read_text())


def by_name(folder, index=0):
    """{name: all that is said of it at an instant}"""
    whole = known(folder)
    things = {thing["id"]: thing for thing in whole["objects"]}
    return {things[one["id"]]["name"]: things[one["id"]] | one for one in whole["instants"][index]["objects"]}


def test_names_and_classes(whole):
    things = by_name(whole)
    wanted = {"ball": "ball", "behind": None, "flag": None, "room": "wall"}
    wanted |= {f"car {i}": "car" for i in range(3)} | {f"empty {i}/tree": "tree" for i in range(2)}
    wanted |= {f"leaves/leaves#0.{i}": None for i in range(3)}
    assert {name: thing["class"] for name, thing in things.items()} == wanted
    classes = {"1": "ball", "2": "car", "3": "tree", "4": "wall"}
    assert known(whole)["classes"] == classes and known(whole)["format"] == 1
    for thing in things.values():
        assert classes.get(str(thing["class_id"])) == thing["class"]
    ids = [thing["id"] for thing in known(whole)["objects"]]
    assert ids == sorted(ids) and ids[0] >= 1
    assert [instant["t_ns"] for instant in known(whole)["instants"]] == [0, 10**9]


def hash_of(name):
    """MurmurHash3 x86 32, as Cryptomatte has it."""
    data, h, mask = name.encode(), 0, 0xFFFFFFFF

    def turned(x, by):
        return ((x << by) | (x >> (32 - by))) & mask

    def mixed(k):
        return turned(k * 0xCC9E2D51 & mask, 15) * 0x1B873593 & mask

    for i in range(0, len(data) - 3, 4):
        h = (turned(h ^ mixed(int.from_bytes(data[i : i + 4], "little")), 13) * 5 + 0xE6546B64) & mask
    if rest := data[len(data) // 4 * 4 :]:
        h ^= mixed(int.from_bytes(rest, "little"))
    h ^= len(data)
    for shift_by, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        h = (h ^ (h >> shift_by)) * factor & mask
    exponent = h >> 23 & 255
    h ^= (1 << 23) if exponent in (0, 255) else 0
    return np.uint32(h).view(np.float32)


def test_masks_are_cryptomattes(root, blends, whole):
    """Where more than half of a pixel is of an object, by 64 samples of Cycles' own."""
    run_support("blend_things", "--cryptomatte", blends / "things.blend", blends / "masks.npz")
    passes = np.concatenate([v for _, v in sorted(np.load(blends / "masks.npz").items())])
    ids, things, checked = ids_of(whole), by_name(whole), 0
    parts = {"tree": ["trunk", "crown"], "leaves": ["leaf", "leaves"]}
    for base in ("ball", "car 0", "car 1", "car 2", "flag", "room", "tree", "leaves"):
        hashes = [hash_of(name) for name in parts.get(base, [base])]
        coverage = sum(np.where(passes[k] == h, passes[k + 1], 0) for h in hashes for k in range(0, len(passes), 2))
        theirs = coverage > 0.5
        ours = np.isin(ids, [t["id"] for name, t in things.items() if name == base or base in name.split("/", 1)[-1]])
        if base == "leaves":
            ours = np.isin(ids, [t["id"] for name, t in things.items() if name.startswith("leaves/")])
        assert ours.sum() > 100, base
        assert (ours & theirs).sum() / (ours | theirs).sum() >= 0.99, base
        checked += 1
    assert checked == 8


def test_boxes_are_those_of_the_masks(whole):
    for index in (0, 1):
        ids, seen = ids_of(whole, index), 0
        for name, thing in by_name(whole, index).items():
            y, x = np.nonzero(ids == thing["id"])
            assert thing["visible_px"] == len(y), name
            if len(y):
                assert thing["box_px"] == [x.min(), y.min(), x.max() + 1, y.max() + 1], name
                a, b = thing["amodal_px"], thing["box_px"]  # at most a pixel's half more on each side
                assert a[0] <= b[0] + 0.5 and a[1] <= b[1] + 0.5 and a[2] >= b[2] - 0.5 and a[3] >= b[3] - 0.5, name
                seen += 1
            else:
                assert thing["box_px"] is None
        assert seen >= 10 and 0 not in np.unique(ids)  # the room is all around
    assert by_name(whole)["behind"]["amodal_px"] is None and by_name(whole)["behind"]["truncated"] == 1


def corners(thing):
    """[4, n]: on the edges of its own box, densely, in the world."""
    size, centre = np.array(thing["size_m"]), np.array(thing["centre_local"])
    unit = [np.array(c) for c in itertools.product((-0.5, 0.5), repeat=3)]
    edges = [(a, b) for a, b in itertools.combinations(unit, 2) if np.abs(a - b).sum() == 1]
    points = np.concatenate([a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in edges])
    return np.array(thing["world_from_object"]) @ np.vstack([(points * size + centre).T, np.ones(len(points))])


def film_box(camera, points):
    film = camera.film((FLIP @ points)[:3, None, :])[:, 0]
    return [*film.min(1), *film.max(1)]


class WidePinhole(Pinhole):
    def film(self, points):
        return points[:2] / points[2] * WIDTH + np.array([WIDTH / 2, HEIGHT / 2])[:, None, None]


@pytest.fixture(scope="module")
def fisheye(blends):
    args = ("--width", WIDTH, "--height", HEIGHT, *FISHEYE, "--samples", 1)
    pecs_blender("render", blends / "things.blend", "-o", blends / "f", *ARGS, *args)
    return blends / "f"


@pytest.mark.parametrize("kind", ["pinhole", "fisheye"])
def test_own_boxes_fill_the_film_boxes(whole, fisheye, kind):
    """Cubes: pose and size, through the image map, give the amodal box."""
    folder, camera = (whole, WidePinhole()) if kind == "pinhole" else (fisheye, LensCamera(fisheye))
    checked = 0
    for index in (0, 1):
        for name, thing in by_name(folder, index).items():
            if name.startswith(("car", "leaves/", "flag")):
                wanted = np.array(film_box(camera, corners(thing)))
                if not np.isfinite(wanted).all():
                    continue
                assert np.abs(wanted - thing["amodal_px"]).max() < 0.02, name
                share = 1.0
                for low, high, end in ((*wanted[::2], WIDTH), (*wanted[1::2], HEIGHT)):
                    share *= max(0, min(high, end) - max(low, 0)) / (high - low)
                assert thing["truncated"] == pytest.approx(1 - share, abs=1e-3), name
                checked += 1
    assert checked >= (14 if kind == "pinhole" else 5)


def test_poses(whole):
    """A mirrored, stretched car; one that moves; a flag that grows, whose own box also does."""
    first, second = (by_name(whole, i) for i in (0, 1))
    stretched = first["car 1"]
    assert stretched["size_m"] == pytest.approx([1.5, 0.8, 1.2], abs=1e-6)
    turned = np.array(stretched["world_from_object"])
    assert np.linalg.det(turned[:3, :3]) == pytest.approx(1) and turned[:3, 3] == pytest.approx([0.7, 5.5, -0.4])
    assert turned[:3, 0] == pytest.approx([np.cos(np.radians(20)), np.sin(np.radians(20)), 0], abs=1e-6)
    assert np.allclose(first["car 0"]["world_from_object"], shift(0.2, 4, -0.6), atol=1e-6)
    assert np.allclose(second["car 0"]["world_from_object"], shift(0.0, 4, -0.5), atol=1e-6)
    tree = first["empty 1/tree"]["world_from_object"]  # of the trunk; Blender 5.2 takes the crown first
    assert any(np.allclose(tree, shift(-0.9, 5, z) @ turn(2, np.radians(30))) for z in (-0.6, -0.25))
    assert first["empty 1/tree"]["size_m"] == pytest.approx([0.6, 0.6, 0.125 + 0.65], abs=1e-3)
    assert first["flag"]["size_m"] == pytest.approx([0.9, 0, 0.9], abs=1e-6)
    assert second["flag"]["size_m"] == pytest.approx([1.35, 0, 0.9], abs=1e-6)


def test_what_is_hidden(blends, whole):
    """As much as a render of the thing alone shows more of it."""
    pecs_blender("render", blends / "alone.blend", "-o", blends / "alone", *ARGS)
    for index in (0, 1):
        alone = by_name(blends / "alone", index)["car 1"]
        thing = by_name(whole, index)["car 1"]
        assert alone["occluded"] == 0 and alone["amodal_px"] == thing["amodal_px"]
        assert 0.1 < thing["occluded"] < 0.9
        assert thing["occluded"] == pytest.approx(1 - thing["visible_px"] / alone["visible_px"], abs=0.005)
    visible = by_name(whole)["room"]["visible_px"]  # the room is everywhere; every few pixels are asked
    assert by_name(whole)["room"]["occluded"] == pytest.approx(1 - visible / (WIDTH * HEIGHT), abs=0.005)


def test_centimetres(blends):
    pecs_blender("render", blends / "centimetres.blend", "-o", blends / "cm", *ARGS)
    things = by_name(blends / "cm")
    assert things["ball"]["size_m"] == pytest.approx([1, 1, 1], abs=1e-3)
    assert np.array(things["cube"]["world_from_object"])[:3, 3] == pytest.approx([-0.2, 5, -1.2])
    for name in ("cube", "plane"):
        wanted = film_box(WidePinhole(), corners(things[name]))
        assert things[name]["amodal_px"] == pytest.approx(wanted, abs=0.02)
    ids = ids_of(blends / "cm")
    assert set(np.unique(ids)) == {0, *(thing["id"] for thing in things.values())}


def test_twins_are_told_apart(blends):
    """By place, where Cycles' Random is the same."""
    pecs_blender("render", blends / "twins.blend", "-o", blends / "twins", *ARGS)
    things = sorted(by_name(blends / "twins").values(), key=lambda thing: thing["world_from_object"][0][3])
    assert len(things) == 2 and things[0]["name"] != things[1]["name"]
    assert [thing["box_px"][::2] for thing in things] == [[34, 80], [80, 126]]
    assert all(thing["visible_px"] == 46 * 46 for thing in things)


def test_numbers_are_the_cameras_and_the_plans(blends, whole, tmp_path):
    """Another camera, other instants, a shard: the same things have the same numbers."""
    path = tmp_path / "path.txt"
    path.write_text("0 0.5 0 0 0.7071067811865476 0 0 -0.7071067811865476")
    args = ("--frames", "1:4", "--fps", 3, "--bands", 1, "--no-light", "--layers", "objects", "--camera-path", path)
    pecs_blender("render", blends / "things.blend", "-o", tmp_path / "s", *args)
    numbers = [{t["name"]: (t["id"], t["class_id"]) for t in known(f)["objects"]} for f in (whole, tmp_path / "s")]
    assert numbers[0] == numbers[1]


def test_a_stopped_job_goes_on(blends, whole, tmp_path):
    args = ("render", blends / "things.blend", "-o", tmp_path / "s", *ARGS)
    pecs_blender(*args, "--only", "0:1")
    assert not (tmp_path / "s/objects.json").exists()
    (tmp_path / "s/objects_000000.exr").unlink()
    growing_pecs_blender(*args)
    assert contents(tmp_path / "s") == contents(whole)
    (tmp_path / "s/objects_000001.json").unlink()
    (tmp_path / "s/objects.json").unlink()
    assert "1 of 2 exist already" in pecs_blender(*args).stderr
    assert contents(tmp_path / "s") == contents(whole)
    pecs_blender("render", blends / "things.blend", "-o", tmp_path / "s", *ARGS[:-1], "depth", "--overwrite")
    assert not [name for name in contents(tmp_path / "s") if name.startswith("objects")]


def test_shards_merge(blends, whole, tmp_path):
    for name, only in (("a", "0:1"), ("b", "1:2")):
        pecs_blender("render", blends / "things.blend", "-o", tmp_path / name, *ARGS, "--only", only)
    pecs_blender("merge", tmp_path / "b", tmp_path / "a", "-o", tmp_path / "s")
    assert contents(tmp_path / "s") == contents(whole)
    (tmp_path / "a/objects_000000.json").unlink()
    result = pecs_blender("merge", tmp_path / "b", tmp_path / "a", "-o", tmp_path / "x", check=False)
    assert result.returncode == 4 and "objects: instant 0 ns" in result.stderr


@pytest.mark.parametrize(
    "name, what", [("bad_class", "'thing'.pecs_class: got 3"), ("blank_class", "'all'.pecs_class")]
)
def test_a_class_without_name_is_one_line(blends, tmp_path, name, what):
    result = pecs_blender("render", blends / f"{name}.blend", "-o", tmp_path / "s", *ARGS, check=False)
    assert result.returncode == 4 and what in result.stderr and len(result.stderr.splitlines()) == 1
