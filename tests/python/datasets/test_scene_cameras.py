"""A set of a .blend without a recipe: its cameras' motion and optics, the panel's settings, and what is refused."""

import json
from functools import partial

import numpy as np
import pytest
from support import ROOT, in_bpy, run_module
from support.faults import refused

pytest.importorskip("bpy", reason="renders with Cycles")

from pecs.datasets import Sequence, Windows, sequences

dataset = partial(run_module, "pecs.datasets", check=False)
FILES = """
import json, sys
import bpy
from pecs_lab import blend
folder = sys.argv[1]
def start():
    scene = blend.start()
    blend.lamp("SUN", (1, 1, 1), 3)
    grey, red = (blend.material("m", ("ShaderNodeBsdfDiffuse", {"Color": c}))[0] for c in (blend.GREY, blend.RED))
    blend.floor(grey, 20)
    blend.box(red, (0, 0, 0.8), 1)
    camera, scene.frame_end = scene.camera, 4
    camera.data.shift_x = 0.1
    for frame, x, roll in ((1, -0.3, 0.0), (4, 0.1, 0.1)):
        camera.location.x, camera.rotation_euler[1] = x, roll
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_euler", frame=frame)
    return scene, camera
def add(scene, name, location, parent=None):
    thing = blend.put(scene.camera.data.copy(), location, name=name)
    thing.parent = parent
    return thing
def save(name):
    blend.save(folder, name)
scene, camera = start()
right = add(scene, "right.001", (0.1, 0, 0), camera)
right.data.sensor_fit, right.data.shift_y = "VERTICAL", -0.05
add(scene, "elsewhere", (0, -6, 1))
save("good")
places = []
for i in range(4):
    scene.frame_set(1 + i)
    places.append(list(camera.matrix_world.translation))
open(folder + "/places.json", "w").write(json.dumps(places))
scene, camera = start()
camera.data.type = "ORTHO"
save("flat")
scene, camera = start()
for frame, mm in ((1, 35), (4, 50)):
    camera.data.lens = mm
    camera.data.keyframe_insert("lens", frame=frame)
save("zoom")
scene, camera = start()
for curve in blend.curves(camera):
    for point in curve.keyframe_points:
        point.interpolation = "CONSTANT"
save("jump")
scene, camera = start()
for frame, thing in ((1, camera), (3, add(scene, "other", (0, -3, 1)))):
    scene.timeline_markers.new(thing.name, frame=frame).camera = thing
save("cuts")
scene, camera = start()
add(scene, "other", (0.1, 0, 0), camera).scale.x = -1
save("mirror")
scene, camera = start()
scene.frame_end = 1
save("picture")
scene, camera = start()
scene.frame_end = 20_000
save("long")
from pecs_blender import ui
ui.register()
scene, camera = start()
scene.pecs.chip, scene.pecs.samples, scene.pecs.fps, scene.pecs.min_nm = "imx636", 5, 300, 450
scene.pecs.sensor.diff_on = 7
save("panel")
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blends")
    in_bpy(FILES, folder)
    return folder


@pytest.fixture(scope="module")
def printed(files):
    """The recipe of good.blend."""
    done = dataset(files / "good.blend", "-o", files / "set", "--plan")
    assert done.returncode == 0 and not (files / "set").exists(), done.stderr
    return done.stdout.partition("\n\n")[0]


def test_the_rig_is_what_keeps_its_place(printed):
    assert 'name = "camera"' in printed and 'camera = "right.001"\nposition_m = [0.1, 0.0, 0.0]' in printed
    assert '# Not in the rig, since it moves relative to "camera": "elsewhere"' in printed
    assert "duration_s = 0.125  # frames 1 to 4" in printed and printed.count("[[rig.camera]]") == 2


@pytest.fixture(scope="module")
def made(files, printed):
    """Small, by a copy of the printed recipe."""
    text = printed.replace("fps = 1000.0", 'fps = 96\nbands = 1\nsamples = 1\nplacement = "uniform"')
    text = text.replace('time = "adaptive"', 'time = "uniform"').replace('"../', '"')
    text = text.replace('path = "', f'path = "{files}/').replace("position_m", "width = 32\nheight = 24\nposition_m")
    text = text.replace('camera = "camera"', 'camera = "camera"\nwidth = 32\nheight = 24')
    (files / "r.toml").write_text(text)
    done = dataset(files / "r.toml", "-o", files / "small")
    assert done.returncode == 0, done.stderr
    return files / "small"


def test_poses_and_optics_are_those_of_the_blend(files, made):
    """The flow and the depth of the renderer agree with K and the poses of the set, also with shift and fit."""
    sequence = Sequence(made / "sequences/0000")
    poses = sequence.cameras["camera"].poses_at(np.arange(4) * 1e6 / 24)
    assert np.abs(poses[:, :3, 3] - json.loads((files / "places.json").read_text())).max() < 1e-4
    checks = json.loads((made / "sequences/0000/checks.json").read_text())
    for camera in sequence.cameras.values():
        found = checks["cameras"][camera.name]
        assert found["flow"]["count"] > 500 and found["flow"]["rms_px"] < 0.01, found
        assert found["scene_flow"]["rms_m"] < 1e-3 and found["events"]["count"] > 20
        assert len(camera.truth.times_us) == 4
    left, right = sequence.cameras.values()
    assert left.K[0, 2] == pytest.approx(15.5 - 3.2) and right.K[0, 0] == pytest.approx(50 / 24 * 24)


def test_a_loader_reads_it(made):
    data = Windows(sequences(made), window_us=40_000, fields=("flow", "depth"))
    assert len(data) >= 2 and data[0]["depth"].shape[-2:] == (24, 32)


def test_the_panel_decides(files):
    done = dataset(files / "panel.blend", "-o", files / "set", "--plan")
    assert done.returncode == 0, done.stderr
    for line in ('chip = "imx636"', "samples = 5", "fps = 300.0", "diff_on = 7", "no key for: min_nm"):
        assert line in done.stdout, done.stdout


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("flat", "rig.camera camera.lens: camera 'camera': got type ORTHO, wanted a perspective camera"),
        ("zoom", "rig.camera camera.lens: camera 'camera': got a focal length or shift that changes"),
        ("jump", "trajectory: camera 'camera': got a jump of 0.4 m at 0.12 s, wanted a path without jumps"),
        ("mirror", "rig.camera other.lens: camera 'other': got a negative scale, which mirrors it, wanted none"),
        ("cuts", "camera: got markers that switch between 'camera', 'other', wanted one name of them"),
        ("long", "frames: got 1 to 20000, wanted a range of at most 10000"),
        ("picture", "picture.blend: frames: got 1 alone, wanted a range of two or more"),
    ],
)
def test_what_makes_no_rig_is_one_line(files, name, line):
    done = dataset(files / f"{name}.blend", "-o", files / "set", "--plan")
    refused(done, 4, "")
    assert line in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("duration_s = 0.125", "duration_s = 0.2", "trajectory: duration_s: got 0.208333333 s in whole intervals"),
        ('kind = "scene"', 'kind = "scene"\nspeed = 2', "trajectory: scene: speed: got an unknown key"),
        ('kind = "scene"', 'kind = "scene"\ncamera = "x"', "trajectory: camera: got 'x', wanted one of 'camera'"),
        ('camera = "right.001"', 'camera = "x"', "rig.camera right_001.lens: camera: got 'x', wanted one of"),
        ('lens = "none"', 'lens = "none"\nfocus_m = 2', "focus_m: got"),
        ('lens = "none"', 'lens = "cmount_8mm_f2p8"', "camera: got"),
        ('good.blend"', f'{ROOT}/scenes/room"', "lens: got none, which is the camera of a .blend"),
    ],
)
def test_wrong_keys_are_one_line(files, printed, old, new, line):
    text = printed.replace("../", "").replace(old, new, 1)
    (files / "w.toml").write_text(text)
    done = dataset(files / "w.toml", "-o", files / "set", "--plan")
    refused(done, 4, "")
    assert line in done.stderr, done.stderr


def test_the_set_keeps_its_recipe(files, tmp_path):
    (tmp_path / "recipe.toml").write_text("name = 'other'\n")
    refused(dataset(files / "good.blend", "-o", tmp_path, "--plan"), 5, "")
