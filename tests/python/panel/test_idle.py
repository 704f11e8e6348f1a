"""What the extension does when nothing runs, in bpy: redraws ask the file system nothing and parse nothing."""

from support import in_bpy

BODY = """
import json, os, sys
from pathlib import Path
from types import SimpleNamespace
import bpy
from pecs_blender import ui
from pecs_blender.ui import background, disk, frustum
from support import panel_acts

ui.register()
scene = panel_acts.scene_file(Path(sys.argv[1]))
disk.bpy = SimpleNamespace(app=SimpleNamespace(background=False))  # as with windows
now = [0.0]
disk.time = SimpleNamespace(monotonic=lambda: now[0])

def redraw():
    "All panels, and whether their buttons are enabled."
    panel_acts.drawn(kinds=bpy.types.Panel)
    for name in dir(bpy.ops.pecs):
        getattr(bpy.ops.pecs, name).poll()

asked = []
def counted(module, name):
    ask = getattr(module, name)
    setattr(module, name, lambda *words, **more: asked.append((name, words)) or ask(*words, **more))

for module, name in ((os, "stat"), (os, "access"), (os, "statvfs"), (os, "scandir"), (os, "listdir"), (json, "loads")):
    counted(module, name)
sys.addaudithook(lambda event, words: event == "open" and asked.append((event, words)))
for lens in ("none", "pecs_lab_15mm"):
    scene.pecs.lens = lens
    redraw()
    while frustum.fields.computing():
        pass
    redraw()
    asked.clear()
    redraw()
    assert not asked, asked
now[0] = 2 * disk.KEPT_S
redraw()
assert {"stat", "access", "statvfs"} <= {name for name, _ in asked}, asked
asked.clear()
disk.forget()  # as after a job
redraw()
assert asked
for timer in (background.poll, frustum._show):
    if bpy.app.timers.is_registered(timer):
        assert timer() is None
assert not bpy.app.timers.is_registered(background.poll)
"""


def test_redraws_read_no_files(tmp_path):
    in_bpy(BODY, tmp_path)
