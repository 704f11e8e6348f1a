"""The panel's settings and background job, in bpy: no window, so a timer's work is called by hand."""

import json

from support import in_bpy, make_blends

PANEL = """
import sys, time
import bpy
from pecs_blender import ui
from pecs_blender.cli import _parser
from pecs_blender.job.options import LAYERS, Options
from pecs_blender.ui import background, operators, settings

def ended():
    while background.poll() is not None:
        time.sleep(0.05)
    return background.state.message, background.state.is_error

ui.register()
blend, output = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=blend)
scene = bpy.context.scene
args = vars(_parser().parse_args(["render", "-o", "x", *settings.render_arguments(scene)]))
options = Options(**{k: v for k, v in args.items() if k in Options.__dataclass_fields__})
assert options == Options(lens="none", time="adaptive"), options  # the panel's defaults are those of `pecs run`
p = scene.pecs
p.layers = {"depth", "motion"}
assert p.bands == 0 and p.channels == 3 + 2 + 20, p.channels
p.lens, p.focus_m = "pecs_lab_15mm", 150.0
arguments = settings.render_arguments(scene)
assert arguments[arguments.index("--focus") + 1] == "1.5"  # the file is in centimetres
p.lens, p.layers, p.frames, p.samples, p.bands, p.output = "none", {"depth"}, 40, 1, 1, output
p.time, p.whole_range = "uniform", False
bpy.ops.wm.save_mainfile()
assert bpy.ops.pecs.render() == {"FINISHED"}
job = background.state.job
bpy.ops.wm.read_factory_settings(use_empty=True)  # another file is opened
assert background.state.job is job and background.poll() == background.POLL_S
while job.progress == 0:
    time.sleep(0.05)
bpy.ops.pecs.stop()
message, is_error = ended()
assert message.startswith("Stopped at") and not is_error, message
bpy.ops.wm.open_mainfile(filepath=blend)
bpy.context.scene.pecs.frames, bpy.context.scene.pecs.exists = 2, "continue"
bpy.ops.pecs.render()
message, is_error = ended()
assert "exists and differs in 'times_ns" in message and is_error, message
bpy.context.scene.pecs.exists = "overwrite"
bpy.ops.pecs.render()
assert ended() == (output + ": rendered", False), background.state.message
bpy.ops.pecs.plan()
message, is_error = ended()
assert message.startswith("Plan: 2 of 2 frames, 0:") and not is_error, message
found = background.state.plan[bpy.context.scene.name]
assert found["disk_bytes"] == 2 * 3 * 48 * 32 * 4 and found["memory_bytes"] > 1e8, found
rows = dict(operators.plan_rows(found))
assert rows["Time"].startswith("0:") and list(rows) == ["Rendered", "Time", "Disk", "Memory"], rows
for name, value in (("samples", 2), ("samples", 1)):  # grey with other settings
    is_same = found["settings"] == operators.planned_with(bpy.context.scene)
    setattr(bpy.context.scene.pecs, name, value)
    assert is_same == (value == 2)
bpy.context.scene.frame_end += 1
assert found["settings"] != operators.planned_with(bpy.context.scene)
bpy.context.scene.frame_end -= 1
bpy.ops.pecs.preview()
bpy.ops.wm.open_mainfile(filepath=blend)  # its preview is in vain
assert ended()[0].startswith("Stopped") and not background.state.plan, background.state.message
bpy.ops.pecs.preview()
assert ended()[0].startswith("PECS preview: open an image editor"), background.state.message
assert bpy.data.images["PECS preview"].size[0] == 48
ui.unregister()
"""


PROGRESS = """
import sys, time
from pathlib import Path
from pecs_blender.ui import background, operators

lines = ['{"progress": "motion", "done": 8, "total": 9}', '{"progress": "sense", "done": 1, "total": 4, "left_s": 3.2}',
    '{"folder": "/s_002"}', "{no JSON", "pecs: stack.json: the error", "Blender quit"]
command = [sys.executable, "-c", f"import sys; print({chr(10).join(lines)!r}, file=sys.stderr)"]
job = background.BackgroundJob("Simulate Events", command, Path("/s"), str, tasks={"sense": "Simulate"})
while job.returncode() is None:
    time.sleep(0.02)
assert (job.progress, job.folder, job.last_line) == (0.25, Path("/s_002"), "stack.json: the error"), vars(job)
assert job.text.startswith("Simulate 25%, 0:03 left"), job.text
for lines, text in (
    ([], "Starting Blender"),
    (['{"progress": "motion", "done": 3, "total": 4}'], "Motion 75%"),
    (['{"progress": "render", "done": 0, "total": 8}'], "Image 1 of 8"),
    (['{"progress": "render", "done": 8, "total": 8}'], "Image 8 of 8"),
):
    command = [sys.executable, "-c", f"import sys; print({chr(10).join(lines)!r}, file=sys.stderr)"]
    job = background.BackgroundJob("Render Stack", command, Path("/s"), str, tasks=operators.TASKS)
    while job.returncode() is None:
        time.sleep(0.02)
    assert job.step == text and job.text.startswith(text + ", 0:0"), job.text
lines = ['{"progress": "render", "done": 0, "total": 8}']  # the plan's time, until the first image
command = [sys.executable, "-c", f"import sys; print({lines[0]!r}, file=sys.stderr)"]
job = background.BackgroundJob("Render Stack", command, Path("/s"), str, render_s=130.0)
while job.returncode() is None:
    time.sleep(0.02)
assert job.text in ("Image 1 of 8, 2:10 left", "Image 1 of 8, 2:09 left"), job.text

# A child that dies is no "Stopped", and its last line is no error.
for number, name in ((11, "Segmentation fault"), (9, "Killed")):
    body = "import os, sys; print('a warning', file=sys.stderr, flush=True)"
    body += f"; os.kill(os.getpid(), {number})"
    background.start(background.BackgroundJob("Render Stack", [sys.executable, "-c", body], Path("/s"), str))
    while background.poll() is not None:
        time.sleep(0.02)
    text = f"Render Stack was ended by signal {number} ({name})"
    assert (background.state.message, background.state.is_error) == (text, True), background.state.message

# A job that cannot be started ends the queue, not the panel.
def broken():
    raise OSError("no such program")
after = [background.Next([], broken), background.Next([], broken)]
job = background.BackgroundJob("Render Stack", [sys.executable, "-c", ""], Path("/s"), str)
background.start(job, after)
while background.poll() is not None:
    time.sleep(0.02)
text = "Render Stack: the next job cannot start: no such program"
assert (background.state.message, background.state.is_error, background.state.queue) == (text, True, [])

# The windows are drawn again when the text of the job changes, and at its end, not at each poll.
drawn, shown = [], ["Render 0%"]
background.redraw_panels = lambda: drawn.append(shown[0])
background.BackgroundJob.text = property(lambda self: shown[0])
background.start(background.BackgroundJob("Render Stack", [sys.executable, "-c", "input()"], Path("/s"), str))
for text in ("Render 0%", "Render 0%", "Render 10%", "Render 10%"):
    shown[0] = text
    background.poll()
background.state.job.stop()
while background.poll() is not None:
    time.sleep(0.02)
assert drawn == ["Render 0%", "Render 10%", "Render 10%"], drawn
"""


def test_progress_is_read_from_json_lines():
    in_bpy(PROGRESS)


def test_a_job_outlives_its_file(root, tmp_path):
    make_blends("files", tmp_path, "centimetres")
    in_bpy(PANEL, tmp_path / "centimetres.blend", tmp_path / "s")
    stack = json.loads((tmp_path / "s/stack.json").read_text())
    assert len(stack["times_ns"]) == 2 and [layer["name"] for layer in stack["layers"]] == ["depth"]
