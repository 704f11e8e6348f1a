"""Setting up an event camera, in bpy: what the operators make, that they can be taken back, and the lens's field."""

import numpy as np
import pecs
import pytest
from pecs_blender.ui import field
from support import in_bpy

LAB = field.Setting("pecs_lab_15mm", 0, 1.5, None, 6.2208, 1280, 720)


def test_the_field_is_that_of_the_lens():
    found = field.field(LAB)
    with pecs.Lens("pecs_lab_15mm") as lens:
        info = lens.info(focus_m=1.5, film_width_mm=6.2208, film_height_mm=3.4992)
        ends = lens.directions([[1280, 360], [640, 720]], width=1280, height=720, focus_m=1.5)
    assert found.angles_deg[0] == pytest.approx(info["hfov_deg"], rel=0.02)  # first-order
    assert found.angles_deg[1] == pytest.approx(info["vfov_deg"], rel=0.02)
    half = np.degrees(np.arctan(np.abs(ends[[0, 1], [0, 1]]) / ends[:, 2]))
    np.testing.assert_allclose(found.angles_deg, 2 * half, rtol=1e-3)
    assert found.width_per_distance == pytest.approx(2 * np.tan(np.radians(half[0])), rel=1e-3)
    assert found.fnumber == found.widest == pytest.approx(4.15, abs=0.01)
    corner = found.border[0]
    assert corner[0] < 0 and corner[1] < 0  # the upper left pixel sees up and left, y is down
    assert found.words() == "15.02 mm f/4.15, 23.5° x 13.3°"


def test_a_stop_that_the_lens_has_not_is_refused_in_words():
    with pytest.raises(pecs.PecsError, match="f-number: got 2"):
        field.field(field.Setting("pecs_lab_15mm", 0, 1.5, 2.0, 6.2208, 1280, 720))


BLENDER = """
import json, math, time
import bpy
import numpy as np
from mathutils import Vector
from pecs_blender import ui
from pecs_blender.ui import field
from pecs_blender.ui import camera_setup, frustum, settings

ui.register()
scene = bpy.context.scene
camera, s = scene.camera, scene.pecs
camera.data.lens, scene.render.resolution_x, s.chip = 35, 1920, "davis346"
before = camera_setup.snapshot(scene, camera.data)

# Set up: the picture is the chip's, the frame is the lens's.
assert bpy.ops.pecs.setup_camera(lens="pecs_lab_15mm", focus=1.5, fnumber=4.0) == {"FINISHED"}
assert (scene.render.resolution_x, scene.render.resolution_y) == (346, 260)
assert s.lens == "pecs_lab_15mm" and s.fnumber == 0  # not wider than the lens is: wide open
assert abs(camera.data.dof.aperture_fstop - 4.15) < 0.01
film_mm = 346 * 18.5e-3
assert abs(camera.data.sensor_width - film_mm) < 1e-4, camera.data.sensor_width
found = field.field(frustum.setting(scene))
frame = [v.xyz / -v.z for v in camera.data.view_frame(scene=scene)]
across = max(v.x for v in frame) - min(v.x for v in frame)
assert abs(across - found.width_per_distance) < 1e-4 * across, (across, found.width_per_distance)
down = max(v.y for v in frame) - min(v.y for v in frame)
assert abs(down / across - 260 / 346) < 1e-4
assert camera.data.dof.use_dof and abs(camera.data.dof.focus_distance - 1.5) < 1e-6

# Again with another lens, then back: as at the very first.
assert bpy.ops.pecs.setup_camera(lens="dgauss_50mm_tronnier", chip="imx636", fnumber=0.0) == {"FINISHED"}
assert (scene.render.resolution_x, scene.render.resolution_y) == (1280, 720) and camera.data.lens > 45
assert bpy.ops.pecs.restore_camera() == {"FINISHED"}
assert camera_setup.snapshot(scene, camera.data) == before, (camera_setup.snapshot(scene, camera.data), before)
assert camera_setup.BEFORE not in camera.data and not bpy.ops.pecs.restore_camera.poll()

# Without a lens: the chip's film and pixels, and as wide as before.
def across():
    frame = [v.x / -v.z for v in camera.data.view_frame(scene=scene)]
    return max(frame) - min(frame)

wide = across()
assert bpy.ops.pecs.setup_camera(lens="none", chip="davis346") == {"FINISHED"}
assert abs(camera.data.sensor_width - film_mm) < 1e-4 and abs(across() - wide) < 1e-5, (across(), wide)
assert bpy.ops.pecs.restore_camera() == {"FINISHED"}
assert camera_setup.snapshot(scene, camera.data) == before

# What cannot be: words, and nothing has changed.
for wrong in ({"chip": "no_such_chip"}, {"lens": "pecs_lab_15mm", "chip": "no_such_chip"}):
    try:
        bpy.ops.pecs.setup_camera(**wrong)
        raise SystemExit("was taken")
    except RuntimeError as e:
        assert "no_such_chip" in str(e), e
    assert camera_setup.snapshot(scene, camera.data) == before, wrong

# Add > Camera > Event Camera.
count = len(bpy.data.objects)
assert bpy.ops.pecs.add_camera(lens="pecs_lab_15mm", chip="imx636") == {"FINISHED"}
assert scene.camera is bpy.context.object and scene.camera is not camera and len(bpy.data.objects) == count + 1
assert scene.render.resolution_x == 1280

# Focus on an object: the plane through it, in the scene's units.
added, cube = scene.camera, bpy.data.objects["Cube"]
added.location, added.rotation_euler = (1, -5, 0), (math.pi / 2, 0, 0)  # looks along +y
bpy.context.view_layer.update()
scene.pecs_camera.focus_object = cube
assert abs(s.focus_m - 5) < 1e-5, s.focus_m
scene.unit_settings.scale_length = 0.01
assert abs(frustum.setting(scene).focus_m - 0.05) < 1e-6
added.location.y = 5
bpy.context.view_layer.update()
scene.pecs_camera.focus_object = cube  # behind the camera
assert abs(s.focus_m - 5) < 1e-5
scene.unit_settings.scale_length = 1

# Another object may be what the scene is seen from; it is no camera.
scene.camera = cube
assert not bpy.ops.pecs.setup_camera.poll() and not bpy.ops.pecs.restore_camera.poll()
scene.camera = added

# The frustum: the thread finds it, its border lies at the distance asked for.
wanted = frustum.setting(scene)
assert frustum.fields.ask(wanted) == (None, "")
while frustum.fields.computing():
    time.sleep(0.01)
found, wrong = frustum.fields.ask(wanted)
assert found and not wrong
segments, triangles = frustum.lines(found, 5.0)
assert len(segments) == 2 * (4 * field.SIDE + 4) and len(triangles) == 3 * 4 * field.SIDE
assert set(np.round(segments[:, 2], 5)) == {0.0, -5.0}
assert abs((segments[:, 0].max() - segments[:, 0].min()) / 5 / found.width_per_distance - 1) < 0.02
s.lens = "no_such_lens"
wanted = frustum.setting(scene)
frustum.fields.ask(wanted)
while frustum.fields.computing():
    time.sleep(0.01)
found, wrong = frustum.fields.ask(wanted)
assert found is None and "no_such_lens" in wrong
ui.unregister()
"""


def test_set_up_and_back():
    pytest.importorskip("bpy")
    in_bpy(BLENDER)
