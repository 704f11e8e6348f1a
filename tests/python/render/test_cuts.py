"""Cameras bound to timeline markers: light, layers, lens, motion and probe follow the camera of Blender itself."""

import json

import numpy as np
import pecs
import pytest
from support import in_bpy, pecs_blender

MAKE = """
import sys
import bpy
from pecs_lab.blend import floor, material, put, save, start
folder = sys.argv[1]
scene = start((24, 16))
bpy.data.objects.remove(scene.camera)
scene.render.engine, scene.render.fps = "CYCLES", 10
put(bpy.data.lights.new("sun", "SUN"))
for name, x, grey in (("A", 0, 0.8), ("B", 20, 0.05)):
    grey = material(name, ("ShaderNodeBsdfDiffuse", {"Color": (grey, grey, grey, 1)}))[0]
    floor(grey, 10, (x, 0, 0)).name = "under " + name
    put(bpy.data.cameras.new(name), (x, 0, 8))
for name in "AB":
    scene.camera = bpy.data.objects[name]
    save(folder, name)
for name, frame in (("A", 1), ("B", 5)):
    scene.timeline_markers.new(name, frame=frame).camera = bpy.data.objects[name]
save(folder, "cut")
scene.render.frame_map_old = 200  # twice as fast: the cut is at frame 3
save(folder, "remapped")
"""
LENSES = {"own": (), "lens": ("--lens", "cmount_8mm_f2p8", "--focus", 8)}
COMMON = ("--fps", 10, "--frames", "all", "--bands", 1, "--samples", 4)
FIRST = {"cut": 4, "remapped": 2}  # index of the first frame of camera B
CASES = [("cut", "own"), ("cut", "lens"), ("remapped", "own")]


@pytest.fixture(scope="module")
def blends(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cuts")
    in_bpy(MAKE, folder)
    return folder


@pytest.fixture(scope="module")
def rendered(blends):
    """A stack of each file, made once."""

    def make(name, lens, time):
        stack = blends / f"{name}_{lens}_{time}"
        if not stack.is_dir():
            words = ("--time", time, "--layers", "motion,objects", *LENSES[lens])
            pecs_blender("render", blends / f"{name}.blend", "-o", stack, *COMMON, *words)
        return stack

    return make


def frames(stack):
    """By time [ms]."""
    with pecs.StackReader(stack) as reader:
        return {t // 1_000_000: reader.read_frame(i) for i, t in enumerate(reader.info["times_ns"])}


@pytest.mark.parametrize(("name", "lens"), CASES)
def test_the_light_is_that_of_the_markers_camera(rendered, name, lens):
    """Bit for bit that of each camera alone."""
    cut, a, b = (frames(rendered(of, lens, "uniform")) for of in (name, "A", "B"))
    assert len(cut) == 10 and a[0].mean() > 4 * b[0].mean()
    for t_ms, light in cut.items():
        assert np.array_equal(light, (b if t_ms >= 100 * FIRST[name] else a)[t_ms]), t_ms


@pytest.mark.parametrize(("name", "lens"), CASES)
def test_adaptive_steps_are_not_warped_across_a_cut(rendered, name, lens):
    """A cut lies between two neighbouring instants, and each side has the light of its camera alone."""
    cut, a, b = (frames(rendered(of, lens, "adaptive")) for of in (name, "A", "B"))
    first = 100 * FIRST[name]
    assert list(cut) == [0, first - 100, first, 900]
    for t_ms, light in cut.items():
        assert np.array_equal(light, (b if t_ms >= first else a)[0]), t_ms
    with pecs.StackReader(rendered(name, lens, "adaptive")) as reader:
        motion = [reader.read_layer("motion", i) for i in range(3)]
    moves = [name.removeprefix("back_") not in ("z", "z_end") for name in pecs.motion.CHANNELS]
    assert np.isnan(motion[1][moves]).all() and not motion[0][moves].any() and not motion[2][moves].any()


@pytest.mark.parametrize("time", ["uniform", "adaptive"])
def test_layers_follow_the_light(rendered, time):
    stack = rendered("cut", "own", time)
    content = json.loads((stack / "objects.json").read_text())
    names = {thing["id"]: thing["name"] for thing in content["objects"]}
    for instant in content["instants"]:
        seen = [names[thing["id"]] for thing in instant["objects"] if thing["visible_px"]]
        assert seen == ["under B" if instant["t_ns"] >= 400_000_000 else "under A"], instant["t_ns"]


@pytest.mark.parametrize("lens", LENSES)
def test_events_of_a_cut_to_the_dark_are_off(rendered, tmp_path, lens):
    words = {"chip": "ideal", "format": "npz"} | ({} if lens == "lens" else {"fnumber": 2.8})
    counts = []
    for time in ("uniform", "adaptive"):
        pecs.sense(rendered("cut", lens, time), tmp_path / f"{time}.npz", noise=False, **words)
        events = pecs.read(tmp_path / f"{time}.npz")
        assert len(events) and not events["p"].any() and 300_000 <= events["t"].min() <= events["t"].max() <= 400_000
        counts.append(len(events))
    assert counts[0] == pytest.approx(counts[1], rel=1e-3)  # the rest is the denoiser's


def test_the_probe_sees_the_first_frames_camera(blends):
    """In a file whose active camera is another one."""
    lux = [
        json.loads(pecs_blender("light", blends / f"{name}.blend", "--json").stdout)["luminance_cd_m2"]["median"]
        for name in ("cut", "A", "B")
    ]
    assert lux[0] == lux[1] > 4 * lux[2]


CAMERAS = """
import sys
from pathlib import Path
import bpy
from pecs_blender.scene.blend import BlendScene
from pecs_blender.spectral.spectra import spectrum

folder = Path(sys.argv[1])
for case in range(6):
    bpy.ops.wm.open_mainfile(filepath=str(folder / "cut.blend"))
    scene, data = bpy.context.scene, bpy.data
    scene.frame_start, scene.frame_end, scene.camera = 0, 30, data.objects["B"]
    scene.render.frame_map_old, scene.render.frame_map_new = ((100, 100), (100, 200), (300, 100))[case % 3]
    hidden = data.objects["A"].copy()
    scene.collection.objects.link(hidden)
    hidden.hide_render = True
    scene.timeline_markers.new("no camera", frame=7)
    scene.timeline_markers.new("hidden", frame=8).camera = hidden
    for name in "AB":  # Blender takes the first of two at one frame
        scene.timeline_markers.new(name, frame=12).camera = data.objects[name]
    if case >= 3:
        scene.timeline_markers.clear()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "case.blend"), copy=True)
    wanted = []
    for frame in range(31):
        scene.frame_set(frame)
        wanted.append(scene.camera.name)
    source = BlendScene(folder / "case.blend", None, spectrum("d65", folder), False)
    times_s = [frame / 10 for frame in range(31)]
    found = [source.camera_at(t_s).name for t_s in times_s]
    for t_s, name in zip(times_s, found, strict=True):
        source.set_time(t_s)
        assert source.own_camera.name == name
    assert found == wanted, (case, found, wanted)
    assert len(set(wanted)) == (1 if case >= 3 else 2)
"""


def test_the_camera_at_a_time_is_blenders_own(blends):
    """With markers before, in and after the range and at one frame, hidden cameras, and remapped time."""
    in_bpy(CAMERAS, blends)
