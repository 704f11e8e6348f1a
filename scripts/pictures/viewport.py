"""Pictures of the 3-D viewport for the docs: docs/start/live_view.png and live_view.mp4 (the live view over a playing
animation), docs/reference/field_of_view.png (a lens's field and its plane in focus).

blender --factory-startup --python scripts/pictures/viewport.py -- FOLDER  (the extension installed, ImageMagick, X)

Every frame is waited for, then the screen's picture taken, so it needs no fast computer; the video plays at the
scene's speed. It ends Blender. The video, from the pictures in FOLDER:

ffmpeg -framerate 24 -i FOLDER/live_%04d.png -vf scale=trunc(iw*.4)*2:-2 -crf 26 -preset veryslow live_view.mp4
"""

import math
import sys
from pathlib import Path

import bpy
from pecs_blender import ui
from pecs_blender.ui import checks, live_sensor, live_view

sys.path.append(str(Path(__file__).parent))
from screen import area, grab, over, window

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
FRAMES, FIRST, PICTURE = 60, 4, 30
TEXT_PX = 72  # at the viewport's bottom: the live view's rates, which are not those of a computer with a GPU


def build() -> None:
    """Six heads in a ring around a cube that turns and wanders, over a floor."""
    scene, cube = bpy.context.scene, bpy.data.objects["Cube"]
    scene.frame_end = 96
    for frame, x, turn in ((1, -1.6, 0), (49, 1.6, 1), (97, -1.6, 2)):
        cube.location.x, cube.rotation_euler.z = x, turn * math.pi / 2
        cube.keyframe_insert("location", frame=frame)
        cube.keyframe_insert("rotation_euler", frame=frame)
    bpy.ops.mesh.primitive_plane_add(size=30, location=(0, 0, -1))
    for i in range(6):
        angle = i * math.pi / 3
        at = 2.8 * math.cos(angle), 2.8 * math.sin(angle), -0.4
        bpy.ops.mesh.primitive_monkey_add(size=1, location=at)
        head = bpy.context.object
        for frame, turn in ((1, 0), (97, 2 * math.pi)):
            head.rotation_euler.z = angle + turn * (1 if i % 2 else -1)
            head.keyframe_insert("rotation_euler", frame=frame)
    bpy.ops.object.select_all(action="DESELECT")


def viewport():
    return area("VIEW_3D")


def take_picture(name: str) -> None:
    bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    one = viewport()
    size = f"{one.width & ~1}x{one.height - TEXT_PX & ~1}"
    grab(FOLDER / name, f"{size}+{one.x}+{window().height - one.y - one.height}")


def start() -> None:
    if not hasattr(bpy.types.Scene, "pecs_live"):
        ui.register()
    build()
    bpy.context.preferences.system.viewport_aa = "FXAA"
    scene, space = bpy.context.scene, viewport().spaces.active
    space.overlay.show_floor, space.shading.color_type = False, "RANDOM"
    scene.camera.select_set(True)
    bpy.context.view_layer.objects.active = scene.camera
    with over(viewport()):
        bpy.ops.pecs.setup_camera(lens="cmount_12p5mm_f2p8", chip="imx636", focus=8.0)
    viewport().tag_redraw()  # asks for the field
    bpy.app.timers.register(field, first_interval=5)


def field() -> None:
    take_picture("field_of_view.png")
    scene, space = bpy.context.scene, viewport().spaces.active
    with over(viewport()):
        bpy.ops.pecs.restore_camera()
        scene.render.resolution_x, scene.render.resolution_y = 1280, 720  # the chip's
        if not checks._has_denoiser():
            bpy.ops.pecs.keep_noise()
        bpy.ops.object.select_all(action="DESELECT")
        scene.pecs_camera.show_field = False
        bpy.ops.view3d.view_camera()
        space.region_3d.view_camera_zoom, space.region_3d.view_camera_offset = 16, (0.09, 0.0)
        space.show_region_ui = True
        scene.pecs_live.decay_ms, scene.pecs_live.subframes = 60, 4
        live_sensor.subframes_that_fit = lambda most, *_: most  # as many as a GPU would have time for
        bpy.ops.pecs.live()
        bpy.ops.screen.animation_play()
    bpy.app.timers.register(next_frame, first_interval=1)


seen = []


def next_frame() -> float | None:
    view = live_view.state.view
    tab = next(r for r in viewport().regions if r.type == "UI")
    if tab.active_panel_category != "PECS":
        tab.active_panel_category = "PECS"
    if len(seen) < FRAMES + FIRST:
        if view and view.sensor.known_s not in seen:
            seen.append(view.sensor.known_s)
            if len(seen) > FIRST:
                take_picture(f"live_{len(seen) - FIRST:04d}.png")
        return 0.001
    live_view.end(view)
    (FOLDER / "live_view.png").write_bytes((FOLDER / f"live_{PICTURE:04d}.png").read_bytes())
    bpy.ops.wm.quit_blender()
    return None


FOLDER.mkdir(parents=True, exist_ok=True)
bpy.context.preferences.view.show_splash = bpy.context.preferences.view.show_playback_fps = False
bpy.app.timers.register(start, first_interval=2)
