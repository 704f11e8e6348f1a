"""All cameras of a scene, rendered and simulated one after the other, in bpy."""

from support import in_bpy

BODY = """
import sys
from pathlib import Path
import bpy
import pecs
from pecs_blender import ui
from pecs_blender.ui import background, event_view
from support.panel_acts import drawn, ended, pressed, scene_file

ui.register()
folder = Path(sys.argv[1])
scene = scene_file(folder)
assert "Run All Cameras" not in drawn(kinds=bpy.types.Panel)
first = scene.camera
first.name = "Side 2"
second = first.copy()
second.data = first.data.copy()
second.name = "Side/2"
second.location.x += 1
scene.collection.objects.link(second)
marker = scene.timeline_markers.new("cut", frame=1)  # each camera is rendered alone all the same
marker.camera = first
assert "Run All Cameras" in drawn(kinds=bpy.types.Panel)

def copies():
    commands = [background.state.job.command, *(one.command for one in background.state.queue)]
    return [Path(word) for command in commands for word in command if background.COPIES in word]

bpy.ops.pecs.run_cameras()
assert scene.camera == first and marker.camera == first and len(background.state.queue) == 1
made = copies()
assert len(made) == 2 and all(copy.is_file() for copy in made)
message, is_error = ended()
assert not is_error and "32x18" in message, message
assert not any(copy.exists() for copy in made)
found = sorted(path.name for path in (folder / "scene_events").glob("*.raw"))
assert found == ["scene_Side_2.raw", "scene_Side_2_.raw"], found  # whose names differ by what no file name has
one, two = (pecs.events.read(folder / "scene_events" / name) for name in found)
assert len(one) and len(two) and len(one) != len(two)
assert event_view.state.view.path.name == "scene_Side_2.raw"  # that of the scene's camera

# Stopped, the ones that follow do not start, and their copies are removed.
bpy.ops.pecs.run_cameras()
made = copies()
bpy.ops.pecs.stop()
message, is_error = ended()
assert message.endswith("Press Run All Cameras to resume") and not background.state.queue, message
assert not any(copy.exists() for copy in made)
"""


def test_all_cameras_of_a_scene(tmp_path):
    in_bpy(BODY, tmp_path)
