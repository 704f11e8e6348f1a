"""What would end a job after its render is told before it, in bpy: settings of the sensor, size, files and scripts."""

from support import in_bpy

BODY = """
import sys
import bpy
from pecs_blender import ui
from pecs_blender.ui import background, checks, event_operators, operators, settings

ui.register()
scene = bpy.context.scene
s, render = scene.pecs, scene.render
s.no_denoise = True
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1] + "/scene.blend")
texts = lambda: [one.text for one in checks.run_problems(scene) if one.is_error]

# The chip's size is that of a picture which does not fit on it.
assert settings.size(scene) == (1920, 1080) and texts()[0].startswith("1920 x 1080 pixels exceed"), texts()
s.chip = "davis346"
assert settings.size(scene) == (346, 260) and not texts(), texts()
s.chip = "imx636"
assert settings.size(scene) == (346, 260)  # it fits
settings.set_size(render, 64, 36)
s.chip = "davis346"
assert settings.size(scene) == (64, 36)
command = event_operators._run_of(scene, *map(operators.Path, ("a.stack", "a.raw"))).command
assert [command[command.index(word) + 1] for word in ("--width", "--height")] == ["64", "36"], command
background.remove_copy(command)

# Of the sensor: each disables the button and names the reason; the stack alone may still be rendered.
def refused(part):
    assert any(part in text for text in texts()), (part, texts())
    assert part in event_operators.PECS_OT_run.why_not(bpy.context)
    assert part in event_operators.PECS_OT_run_cameras.why_not(bpy.context)
    assert not operators.PECS_OT_render.why_not(bpy.context)
    try:
        bpy.ops.pecs.run()
        raise AssertionError("it started")
    except RuntimeError:
        assert not background.state.job

s.sensor.diff_on = 20
refused("no effect of a bias is published for davis346")
s.chip = "imx636"
assert not texts(), texts()
s.sensor.diff_on = 0
one = s.sensor.overrides.add()
one.name, one.value = "contrast_threshold_on", "5"
refused("contrast_threshold_on: got '5'")
one.value = "0.3"
assert not texts(), texts()
s.sensor.mask = sys.argv[1] + "/no_such_mask"
refused("no_such_mask")
s.sensor.mask = ""
s.sensor.afk, s.sensor.afk_low_hz, s.sensor.afk_high_hz = "stop", 300, 100
refused("afk")
s.sensor.afk = "none"
assert not texts(), texts()

# Files and scripts: when the button is pressed.
def stopped(part):
    for name in ("run", "render", "plan", "preview"):
        try:
            getattr(bpy.ops.pecs, name)()
            raise AssertionError("it started")
        except RuntimeError as e:
            assert part in str(e) and not background.state.job, e

font = bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT"))
scene.collection.objects.link(font)
volume = bpy.data.volumes.new("smoke")
volume.filepath = "//no_such.vdb"
scene.collection.objects.link(bpy.data.objects.new("smoke", volume))
stopped("no_such.vdb")
volume.filepath = ""
driver = scene.objects["Cube"].driver_add("location", 0).driver
driver.expression = "__import__('os').getpid()"
stopped("Python scripts to run")
s.allow_scripts = True
assert not texts() and not list(operators.scene_checks.files(scene))
ui.unregister()
"""


def test_problems_are_told_before_the_render(tmp_path):
    in_bpy(BODY, tmp_path)
