"""docs/start/panel_*.png: from the zip to events, in Blender's own window, by the buttons.

    blender --factory-startup --enable-event-simulate --python scripts/pictures/panel.py -- ZIP FOLDER
                                                                                    (X, ImageMagick's `import`)

It installs the zip by Blender's own operator, works in FOLDER, waits for every job, and ends Blender. On its way it
tries what only a window has: the live view's pictures, Esc, a strip in the sequencer. What it does
not find as it should be is an error on stderr, and exit code 1.
"""

import math
import os
import sys
import traceback
from pathlib import Path

import bpy
import numpy as np

sys.path.append(str(Path(__file__).parent))
from screen import area, grab, over, window

ZIP, FOLDER = map(Path, sys.argv[sys.argv.index("--") + 1 :][:2])
MODULE = "bl_ext.user_default.pecs_blender"
REDRAWN_S = 5  # a window on a busy computer
OPEN_LATER = ("PECS_PT_view", "PECS_PT_compare")  # groups that the last pictures show open


def press(name: str, **words) -> None:
    with over(area("PROPERTIES")):
        done = getattr(bpy.ops.pecs, name)(**words)
    assert done == {"FINISHED"}, (name, done)


def picture(name: str, crop: str = "", colours: int = 0) -> None:
    path = FOLDER / f"panel_{name}.png"
    grab(path, crop, colours)
    assert path.stat().st_size < 200_000, path


def scene() -> None:
    """The cube passes before a floor and turns."""
    cube, one = bpy.data.objects["Cube"], bpy.context.scene
    for frame, x, turn in ((1, -2.0, 0.0), (5, 2.0, math.pi / 4)):
        cube.location.x, cube.rotation_euler.z = x, turn
        cube.keyframe_insert("location", frame=frame)
        cube.keyframe_insert("rotation_euler", frame=frame)
    bpy.ops.mesh.primitive_plane_add(size=30, location=(0, 0, -1))
    one.frame_end = 5
    one.frame_set(3)


def arrange() -> None:
    """Blender's own layout: the properties editor at its default width, as tall as it can be, next to a plain view."""
    one = area("PROPERTIES")
    move_top(one, 700)
    one.spaces.active.context = "RENDER"
    view = area("VIEW_3D")
    view.spaces.active.overlay.show_overlays = False
    bpy.context.preferences.themes[0].view_3d.space.gradients.background_type = "SINGLE_COLOR"
    with over(view):
        bpy.ops.view3d.view_camera()


def move_top(one, delta: int) -> None:
    with bpy.context.temp_override(window=window(), area=one):
        bpy.ops.screen.area_move(x=one.x + one.width // 2, y=one.y + one.height, delta=delta)


def open_groups():
    """In a new properties editor, since an old one keeps what is open."""
    panel = sys.modules[type(state()).__module__.replace("background", "panel")]
    classes = [cls for cls in vars(panel).values() if isinstance(cls, type) and issubclass(cls, bpy.types.Panel)]
    classes = [cls for cls in classes if cls.__module__ == panel.__name__ and cls.is_registered]
    for cls in reversed(classes):
        bpy.utils.unregister_class(cls)
    for cls in classes:
        options = {"DEFAULT_CLOSED"} if cls is not panel.PECS_PT_render else set()
        cls.bl_options = set() if cls.__name__ in OPEN_LATER else options
        bpy.utils.register_class(cls)
    old, new = area("PROPERTIES"), area("OUTLINER")
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=old.x + old.width // 2, y=old.y + old.height)
    yield 1  # areas move where the mouse is over no region
    move_top(old, -700)
    old.type, new.type = "OUTLINER", "PROPERTIES"
    new.spaces.active.context = "RENDER"


def state(module: str = "background"):
    """The extension's, wherever it is installed."""
    (found,) = (m for name, m in sys.modules.items() if name.endswith(f"pecs_blender.ui.{module}"))
    return found.state


def esc() -> None:
    """Over the properties editor."""
    one = area("PROPERTIES")
    at = {"x": one.x + one.width // 2, "y": one.y + one.height // 2}
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("ESC", "PRESS"), ("ESC", "RELEASE")):
        window().event_simulate(type=kind, value=value, **at)


def job_ended():
    """None while a job runs."""
    if state().job:
        return None
    assert not state().is_error, state().message
    return True


def steps():
    """Yields a test that must be true before it goes on, or seconds."""
    yield from to_a_set_up_camera()
    yield from live()
    yield from to_events()
    yield from look_and_compare()


def to_a_set_up_camera():
    done = bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=str(ZIP), enable_on_install=True, overwrite=True
    )
    assert done == {"FINISHED"} and hasattr(bpy.types.Scene, "pecs")
    bpy.context.window_manager.addon_search = "PECS"
    bpy.ops.screen.userpref_show(section="ADDONS")
    bpy.ops.preferences.addon_expand(module=MODULE)
    yield REDRAWN_S
    picture("1_install", "694x162+278+284")  # the preferences, without the path above them
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
        bpy.ops.wm.window_close()
    scene()
    arrange()
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "cube.blend"))
    yield REDRAWN_S
    scroll(100)  # past those of the render engine
    yield REDRAWN_S
    picture("2_checks")  # the default scene is larger than the chip
    press("setup_camera")
    size = bpy.context.scene.render
    assert (size.resolution_x, size.resolution_y) == (1280, 720)
    s = bpy.context.scene.pecs
    preset = next(p for p in map(Path, bpy.utils.preset_paths("pecs")) if (p / "Quick_Look.py").is_file())
    with over(area("PROPERTIES")):
        bpy.ops.pecs.preset(filepath=str(preset / "Quick_Look.py"))
    s.fps, s.frames, s.whole_range, s.no_denoise = 400.0, 60, False, True  # not every Blender has a denoiser
    yield REDRAWN_S
    picture("3_ready")


def live():
    with over(area("VIEW_3D")):
        assert bpy.ops.pecs.live() == {"FINISHED"}
        bpy.ops.screen.animation_play()
    bpy.context.scene.pecs_live.decay_ms = 200
    yield 10
    light = state("live_view").view._light
    assert np.abs(np.diff(light)).mean() < 0.05 * np.ptp(light)  # a picture, not its values in another order
    with over(area("VIEW_3D")):
        bpy.ops.screen.animation_play()
        bpy.ops.pecs.live()
    bpy.context.scene.frame_set(3)
    yield 1


def to_events():
    press("run")
    yield lambda: state().job is None or state().job.step.startswith("Image 2 ")
    yield REDRAWN_S
    assert state().job, state().message
    picture("4_running")
    esc()
    yield job_ended
    assert state().message.startswith("Stopped at "), state().message
    press("run")  # goes on
    yield job_ended
    area("VIEW_3D").spaces.active.overlay.show_overlays = True
    yield REDRAWN_S
    picture("overlay", "740x460+290+240", 64)  # noise compresses badly
    yield from open_groups()


def look_and_compare():
    view = area("VIEW_3D")
    at = {"x": view.x + view.width // 2, "y": view.y + view.height // 2}
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", **at)  # no tooltip over the panel
    view.type = "SEQUENCE_EDITOR"
    press("view", kind="mp4", to_sequencer=True)
    yield job_ended
    assert "channel 1 of the sequencer" in state().message, state().message
    view.type = "IMAGE_EDITOR"
    press("view", kind="png")
    yield job_ended
    scroll(100)
    sheet = view.spaces.active.image
    yield lambda: sheet.size[0] * view.spaces.active.zoom[0] <= view.width  # the whole sheet, at the second redraw
    yield REDRAWN_S
    picture("5_events")
    (FOLDER / "recording.raw").write_bytes((FOLDER / "cube_events/cube.raw").read_bytes())
    sensor = bpy.context.scene.pecs.sensor
    sensor.recording, sensor.seed = "//recording.raw", 2  # as another camera of this kind would record
    press("sense")
    yield job_ended
    press("compare")
    yield job_ended
    yield REDRAWN_S
    scroll(100)
    press("show_events", in_editor=True)
    shown = bpy.data.images["PECS Events"]
    before = np.array(shown.pixels[:])
    bpy.context.scene.frame_set(4)
    assert not np.array_equal(before, shown.pixels[:])  # it follows the timeline
    yield REDRAWN_S
    picture("6_compare")


def scroll(steps: int) -> None:
    """The properties editor."""
    with over(area("PROPERTIES")):
        for _ in range(steps):
            bpy.ops.view2d.scroll_down()


def run(script, waiting=None):
    """A timer's work: goes on when what was waited for is there."""
    try:
        if waiting is None or waiting():
            waiting = next(script)
            if isinstance(waiting, int):
                bpy.app.timers.register(lambda: run(script), first_interval=waiting)
                return None
        bpy.app.timers.register(lambda: run(script, waiting), first_interval=0.2)
    except StopIteration:
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        grab(FOLDER / "failed.png")
        os._exit(1)


bpy.context.preferences.view.show_splash = False
FOLDER.mkdir(parents=True, exist_ok=True)
bpy.app.timers.register(lambda: run(steps()), first_interval=2)
