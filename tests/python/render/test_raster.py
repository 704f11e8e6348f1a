"""The raster engine compared with Cycles: a red ball above a plane, in the light of a sun and a lamp. Settings of
EEVEE alone and a stamp change nothing."""

import json

import numpy as np
import pecs
import pytest
from support import in_bpy, pecs_blender

SCENE = """
import bpy, sys
from pecs_lab.blend import ball, floor, material, start

scene = start((64, 48), (0, -3, 2), 60)
grey, red = (material("paint", ("ShaderNodeBsdfDiffuse", {"Color": (*c, 1)}))[0]
             for c in ((0.5, 0.5, 0.5), (0.6, 0.1, 0.05)))
floor(grey)
ball(red, (0, 0, 0.5), 0.5, segments=96)
bpy.ops.object.light_add(type="SUN", rotation=(0.5, 0.3, 0))
bpy.context.object.data.energy = 2e4
bpy.ops.object.light_add(type="POINT", location=(1.5, -1, 2))
point = bpy.context.object.data
point.energy = 6e5  # so bright that the file's or a fixed reach has no shadows
point.diffuse_factor, point.use_custom_distance, point.cutoff_distance = 0.3, True, 1.5
for thing, paint in zip(bpy.data.meshes, (grey, red)):
    thing.flip_normals()
    paint.use_backface_culling = paint.use_backface_culling_shadow = scene.render.use_stamp = True
floor(material("glow", ("ShaderNodeBsdfPrincipled", {"Emission Strength": 0.1}))[0], 0.1, (0, 0, -9))
scene.cycles.max_bounces = 0
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""
LAYERS = ("depth", "normal")
ARGS = ("--frames", 2, "--bands", 3, "--lens", "none", "--samples", 2, "--layers", ",".join(LAYERS))


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("raster")
    in_bpy(SCENE, root / "ball.blend")
    for engine in ("cycles", "eevee"):
        pecs_blender("render", root / "ball.blend", "-o", root / engine, "--engine", engine, *ARGS)
    return root


def test_light_has_the_values_of_a_path_tracer(root):
    stacks = [pecs.StackReader(root / engine) for engine in ("cycles", "eevee")]
    traced, drawn = (stack.read_frame(1) for stack in stacks)
    lit = traced.min(0) > 0.1 * np.median(traced)
    ratio = np.log(drawn[:, lit] / traced[:, lit])
    assert ratio.shape[1] > 2000
    medians = np.median(ratio, axis=1)
    assert np.abs(medians).max() < 0.03 and np.ptp(medians) < 0.005, medians
    assert np.percentile(np.abs(ratio), 90) < 0.1
    for name in LAYERS:  # traced for both
        assert np.array_equal(*(stack.read_layer(name, 1) for stack in stacks), equal_nan=True)
    assert np.array_equal(drawn, stacks[1].read_frame(0))  # still light makes no events


def test_the_stack_says_what_is_missing(root):
    of = {engine: json.loads((root / engine / "stack.json").read_text())["render"] for engine in ("cycles", "eevee")}
    assert of["eevee"]["approximated"][0].endswith("emit light nothing: glow") and not of["cycles"]["approximated"]


def test_keyframes_follow_a_lamp_that_dims(tmp_path):
    """EEVEE draws the light of all lamps in one picture."""
    dim = """
lamp = bpy.data.objects["Point"].data
for frame, watts in ((1, 6e5), (4, 6e4)):
    lamp.energy = watts
    lamp.keyframe_insert("energy", frame=frame)
bpy.ops.wm.save"""
    in_bpy(SCENE.replace("bpy.ops.wm.save", dim), tmp_path / "dim.blend")
    dimmed = []
    for engine, time in (("cycles", "uniform"), ("eevee", "adaptive")):
        args = ("--engine", engine, "--time", time, "--frames", 4, "--fps", 24, "--bands", 3, "--lens", "none")
        pecs_blender("render", tmp_path / "dim.blend", "-o", tmp_path / time, *args, "--samples", 2, "--width", 16,
                     "--height", 12)  # fmt: skip
        stack = pecs.StackReader(tmp_path / time)
        dimmed.append(stack.read_frame(stack.info["frames"] - 1).mean() / stack.read_frame(0).mean())
    assert dimmed[0] < 0.9 and dimmed[1] == pytest.approx(dimmed[0], rel=0.03), dimmed


@pytest.mark.parametrize(
    ("option", "wanted"),
    [
        (("--seed", 2), "--engine cycles"),
        (("--device", "CUDA"), "--engine cycles"),
        (("--no-denoise", "--time", "adaptive"), "--engine cycles"),
        (("--lens", "cmount_8mm_f2p8", "--focus", 4), "--lens none"),
    ],
)
def test_what_it_lacks_is_refused(root, tmp_path, option, wanted):
    args = (*ARGS, "--engine", "eevee", *option)
    result = pecs_blender("render", root / "ball.blend", "-o", tmp_path / "s", *args, check=False)
    assert result.returncode == 2 and option[0] in result.stderr and wanted in result.stderr, result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_other_cameras_are_refused(tmp_path):
    """EEVEE draws them in perspective."""
    in_bpy(SCENE.replace("bpy.ops.wm.save", 'scene.camera.data.type = "PANO"\nbpy.ops.wm.save'), tmp_path / "p.blend")
    result = pecs_blender("render", tmp_path / "p.blend", "-o", tmp_path / "s", "--engine", "eevee", *ARGS, check=False)
    assert result.returncode == 6 and "got PANO, wanted PERSP or ORTHO" in result.stderr, result.stderr
