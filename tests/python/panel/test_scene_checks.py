"""*Before the render*, in bpy: each remark on a scene that deserves it, none on one that does not, and what mends."""

import pytest
from support import in_bpy

pytest.importorskip("bpy")

BLENDER = """
import math, sys
import bpy
from pecs_lab.blend import GREY, ball, curves, floor, lamp, material, start
from pecs_blender import ui
from pecs_blender.ui import background, scene_checks

ui.register()
scene = start()
scene.frame_end, scene.render.fps = 100, 25
s = scene.pecs
s.fps, s.whole_range = 1000, True
bulb = lamp()
bulb["pecs_spectrum"] = "d65"
thing = ball(material("grey", ("ShaderNodeBsdfDiffuse", {"Color": GREY}))[0])
floor(material("floor", ("ShaderNodeBsdfDiffuse", {"Color": GREY}))[0])
remarks = lambda: [one.text for one in scene_checks.check(scene, bpy.context.view_layer)]
assert remarks() == [], remarks()

def only(start):
    found = remarks()
    assert len(found) == 1 and found[0].startswith(start), found
    return found[0]

# A lamp without a spectrum; with a temperature it has one.
del bulb["pecs_spectrum"]
assert only("Lamps without a spectrum, rendered as d65: lamp")
bulb["pecs_spectrum"] = "d65"

# Motion: 2 units in 4 frames of 40 ms at about 4.5 units: 48 px wide, 50 mm on 36 mm.
thing.location.x = -1
thing.keyframe_insert("location", index=0, frame=1)
thing.location.x = 1
thing.keyframe_insert("location", index=0, frame=5)
for curve in curves(thing):
    for point in curve.keyframe_points:
        point.interpolation = "LINEAR"
scene.frame_set(3, subframe=0.25)
assert remarks() == []  # at 1000 frames per second
s.time = "uniform"
s.fps = 25
words = only("Objects move up to ")
moved = float(words.split()[4])
distance = 3.4  # of the ball's near side from the camera, at least
assert 0.5 * 48 * 50 / 36 / 4.2 < moved < 0.5 * 48 * 50 / 36 / distance, moved
assert (scene.frame_current, round(scene.frame_subframe, 3)) == (3, 0.25)
bpy.ops.pecs.check_scene()
assert len(background.state.problems[scene.name]) == 1
bpy.ops.pecs.use_adaptive()
assert s.time == "adaptive" and background.state.problems[scene.name] == []
s.time = "uniform"
thing.animation_data_clear()

# The camera turns: still objects also move.
camera = scene.camera
camera.rotation_euler.z = 0
camera.keyframe_insert("rotation_euler", index=2, frame=1)
camera.rotation_euler.z = 1
camera.keyframe_insert("rotation_euler", index=2, frame=50)
assert only("Objects move up to ")
camera.animation_data_clear()
camera.rotation_euler.z = 0
bpy.context.view_layer.update()
assert remarks() == []

# Beyond the clip range; a lens has none.
camera.data.clip_end = 3
assert only("The camera's clip end is 3, but objects extend to ")
s.lens = "pecs_lab_15mm"
assert not [words for words in remarks() if "clip end" in words]
s.lens = "none"
bpy.ops.pecs.extend_clip_end()
assert remarks() == [] and camera.data.clip_end > 3

# What has no spectrum, also inside a group.
glass, tree, _ = material("soap", ("ShaderNodeBsdfPrincipled", {"Thin Film Thickness": 300.0}))
thing.data.materials[0] = glass
assert only("Approximated: soap: Principled BSDF: thin film")
tree.nodes["Principled BSDF"].inputs["Thin Film Thickness"].default_value = 0
assert remarks() == []

# Noise, as a probe measured it.
background.state.light[scene.name] = {"noise_thresholds": 0.5, "samples": 4}
s.samples = 4
assert "Use at least 12 samples" in only("Render noise of about 0.5 contrast thresholds")
s.samples = 16
assert remarks() == []
s.samples = 4
bpy.ops.pecs.set_noise_events()
assert abs(s.noise_events - 0.1) < 1e-6 and remarks() == []
background.state.light.clear()

# Files and scripts.
image = bpy.data.images.new("gone", 4, 4)
image.source, image.filepath, image.use_fake_user = "FILE", "/no/such/picture.png", True
assert "image 'gone'" in only("Missing files: ")
bpy.data.images.remove(image)
driver = thing.driver_add("location", 0).driver
driver.expression = "__import__('os').getpid()"
assert "thin" not in only("Python scripts to run: ")
bpy.ops.pecs.allow_scripts()
assert s.allow_scripts and remarks() == []
assert len(scene_checks._list("Lamps", [str(i) for i in range(9)]).split(", ")) == 6

bpy.ops.wm.read_factory_settings()
assert not background.state.problems
ui.unregister()
"""


def test_remarks_and_what_mends_them():
    in_bpy(BLENDER)
