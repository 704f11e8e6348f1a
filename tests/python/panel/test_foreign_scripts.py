"""Python of a foreign .blend runs in no job of the panel, whatever Blender's preferences, unless the user allows it
there."""

import pytest
from support import in_bpy, pecs_blender

WORDS = """
import bpy
from pecs_blender import ui
from pecs_blender.ui import operators

ui.register()
bpy.app.binary_path = "/usr/bin/blender"
bpy.context.preferences.filepaths.use_scripts_auto_execute = True
scene = bpy.context.scene
for allowed, word in ((False, "--disable-autoexec"), (True, "--enable-autoexec")):
    scene.pecs.allow_scripts = allowed
    command = operators.blender(scene, "run", None)
    file = next(i for i, one in enumerate(command) if one.endswith(".blend"))
    assert word in command[:file], command  # Blender reads its arguments in order
    assert ("--allow-scripts" in command) == allowed
    assert sum(one.endswith("-autoexec") for one in command) == 1
"""
FOREIGN = """
import sys
import bpy
bpy.ops.wm.read_factory_settings()
for kind, name in (("text", "registered.py"), ("driver", "")):
    bpy.ops.wm.read_factory_settings()
    code = f"open({sys.argv[1]!r} + '/ran_{kind}', 'w').close()"
    if kind == "text":
        text = bpy.data.texts.new(name)
        text.write(code)
        text.use_module = True
    else:
        driver = bpy.data.objects["Cube"].driver_add("location", 0).driver
        driver.expression = f"({code}, 0)[1]"
    bpy.ops.wm.save_as_mainfile(filepath=f"{sys.argv[1]}/{kind}.blend", copy=True)
"""


def test_the_child_is_told_before_the_file():
    in_bpy(WORDS)


@pytest.mark.parametrize(("kind", "code"), [("text", 0), ("driver", 6)])
def test_a_job_runs_no_foreign_script(tmp_path, kind, code):
    in_bpy(FOREIGN, tmp_path)
    (tmp_path / "ran_driver").unlink(missing_ok=True)  # the file that was just made ran its own
    words = ("--bands", 1, "--samples", 1, "--frames", 1, "--width", 16)
    result = pecs_blender("render", tmp_path / f"{kind}.blend", "-o", tmp_path / "s", *words, check=False)
    assert result.returncode == code, result.stderr
    assert not list(tmp_path.glob("ran_*"))
    allowed = pecs_blender("render", tmp_path / f"{kind}.blend", "-o", tmp_path / "s", *words, "--allow-scripts")
    assert (tmp_path / f"ran_{kind}").exists(), allowed.stderr
