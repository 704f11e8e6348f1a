"""Scenes for data sets: classes on every object, one object per car and person, the same bits in every run."""

import json
import subprocess
import sys

import numpy as np
import pecs
import pytest
from support import pecs_blender

CLASSES = {
    "street": "building road lane_mark pavement tree pole traffic_sign bin car person",
    "room": "wall floor table picture globe ball box",
}
LIST = """
import json, sys
from pathlib import Path
import bpy, pecs
import numpy as np
from pecs_blender.scene.scene_file import load_scene
from pecs_blender.scene import cycles
cycles.empty_scene()
parts = load_scene(Path(sys.argv[1]), sys.argv[2:]).build()
found = {}
for t_s in (0.0, 0.25):
    parts.pose(t_s)
    bpy.context.view_layer.update()
    for thing in bpy.data.objects:
        if thing.type == "MESH":
            local, pose = np.empty(3 * len(thing.data.vertices), np.float32), np.array(thing.matrix_world)
            thing.data.vertices.foreach_get("co", local)
            corners = local.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]
            entry = found.setdefault(thing.name, {"class": thing.get("pecs_class"), "low": [], "high": []})
            entry["smooth"] = any(p.use_smooth for p in thing.data.polygons)
            entry["normals"] = "custom_normal" in thing.data.attributes
            entry["low"].append(corners.min(axis=0).tolist())
            entry["high"].append(corners.max(axis=0).tolist())
print("@" + json.dumps(found))
"""


def things(root, scene, *sets):
    """Name -> class and boxes at 0 and 0.25 s, of the meshes of a scene."""
    command = [sys.executable, "-c", LIST, root / "scenes" / scene, *sets]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout.split("@", 1)[1])


@pytest.mark.parametrize("scene", CLASSES)
def test_every_object_has_a_class(root, scene):
    found = things(root, scene, *(["movers=3"] if scene == "room" else []))
    assert {entry["class"] for entry in found.values()} == set(CLASSES[scene].split())
    assert not [name for name, entry in found.items() if entry["smooth"] and not entry["normals"]]


def test_the_street_as_its_parameters_say(root):
    few = things(root, "street", "cars=0", "people=0", "trees=0", "parked_cars=0")
    assert not {"car", "person", "tree"} & {entry["class"] for entry in few.values()}
    speeds = "car_speed_m_per_s=10", "walk_speed_m_per_s=1"
    many = things(root, "street", "cars=6", "people=6", "trees=3", "parked_cars=4", "texture_seed=5", *speeds)
    count = [sum(entry["class"] == kind for entry in many.values()) for kind in ("car", "person", "tree")]
    assert count == [10, 6, 3]
    for name, entry in many.items():
        low, high = np.array(entry["low"]), np.array(entry["high"])
        moved = ((low + high)[1] - (low + high)[0]) / 2
        if name.startswith("car"):  # 10 m/s away, 12 m/s towards; as long as a car, on the road
            assert abs(moved[1]) == pytest.approx(2.5 if moved[1] > 0 else 3.0, abs=1e-4)
            assert 4.2 < high[0, 1] - low[0, 1] < 4.5 and low[0, 2] == pytest.approx(-1.5, abs=0.01)
        elif name.startswith("person"):
            assert 0.15 < np.hypot(moved[0], moved[1]) < 0.35 and 1.65 < (high - low)[0, 2] < 1.85
        else:
            assert np.abs(moved).max() == 0, name
    other = things(root, "street", "texture_seed=6")
    assert many["house left 00"]["high"] != other["house left 00"]["high"]


def render(root, scene, folder, *args):
    small = ("--bands", 3, "--samples", 2, "--lens", "none", "--focal", 6, "--film-width", 6, "--fps", 20)
    small += ("--frames", 2, "--width", 64, "--height", 36, "--layers", "depth,motion")
    pecs_blender("render", root / "scenes" / scene, "-o", folder, *small, *args)
    return pecs.StackReader(folder)


@pytest.mark.parametrize("scene", CLASSES)
def test_same_bits_in_every_run(root, scene, tmp_path):
    a, b = (render(root, scene, tmp_path / str(k), "--threads", k) for k in (1, 2))
    for i in range(2):
        assert np.array_equal(a.read_frame(i), b.read_frame(i)) and a.read_frame(i).mean() > 0
        assert np.array_equal(a.read_layer("depth", i), b.read_layer("depth", i))
    motion = a.read_layer("motion", 0)
    assert np.array_equal(motion, b.read_layer("motion", 0), equal_nan=True)
    seen = np.isfinite(a.read_layer("depth", 0)[1])
    moves = np.hypot(motion[6], motion[7]) > 0.1
    assert not np.isnan(motion[:8, seen]).any() and 0.005 < moves.mean() < 0.6  # people walk and deform: known
