# SPDX-License-Identifier: GPL-3.0-or-later
"""The live view: a timer renders frames of a 3-D viewport in linear light, the sensor (live_sensor.py) simulates their
events, and a draw handler shows them. It requires a window, for its GPU context.

Solid, material preview and EEVEE views are drawn a second time, at the chip's resolution, into an offscreen buffer
without colour management and overlays. Other engines (Cycles) cannot draw there. For them, the view is read from the
viewport's framebuffer, which still has the last redraw in linear light when the next one begins.
"""

from __future__ import annotations

import math
import time
from collections import deque
from pathlib import Path

import blf
import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector

from . import library, live_sensor
from .interface import redraw

MANY_PX = 640 * 480  # sensor size from which on it uses two threads, since Blender waits for it
BUSY_S, REST_S = 1 / 120, 0.1  # timer interval while the view changes, and at rest
FADED = 4  # decay times after which events are invisible
MIN_AFTER_S = 0.1  # lets the sensor finish its last interval
DRAWS_OFFSCREEN = ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT", "BLENDER_WORKBENCH")
MOST_FRAMES = 4  # longest step that subframes divide
INSET = 0.35  # share of the viewport's width, if it does not look through the camera
MARGIN_PX = 12
WORDS = "PECS live preview: relative light, no spectra, no lens"
STOPPED = "Live view stopped: {reason}"
WHITE, RED = (0.9, 0.92, 0.93, 1), (1, 0.35, 0.3, 1)


class Cost:
    """Smoothed cost of each step in ms."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    def add(self, name: str, since_s: float) -> float:
        """Adds the time since `since_s`; returns the current time in s."""
        now_s = time.perf_counter()
        spent = 1e3 * (now_s - since_s)
        self.ms[name] = spent if name not in self.ms else 0.9 * self.ms[name] + 0.1 * spent
        return now_s

    def one_frame_s(self) -> float:
        return sum(self.ms.values()) / 1e3


class LiveView:
    """Runs from its construction to `stop`. Raises PecsError for an invalid chip or size."""

    def __init__(self, context) -> None:
        self._space = context.space_data.as_pointer()
        self.cost = Cost()
        self._subframes = 1
        self._frame_times_s: deque[tuple] = deque(maxlen=30)  # of the last frames: wall clock and scene, s
        self._changed, self._taking = True, False
        self._seen: tuple | None = None  # view and shading of the last frame
        self._changed_s = time.perf_counter()
        self._drawn: tuple | None = None  # clock and rectangle of the viewport's last redraw
        self._is_coarse = False  # whether that redraw was too coarse to be used
        self._gpu: _GpuResources | None = None
        self.sensor: live_sensor.LiveSensor | None = None
        self.settings(context.scene)
        add = bpy.types.SpaceView3D.draw_handler_add
        self._handles = [add(self._before_view, (), "WINDOW", "PRE_VIEW"), add(self._draw, (), "WINDOW", "POST_PIXEL")]
        for handlers in _changes():
            handlers.append(self._note_change)
        self._timer = self._tick  # one bound method: Blender identifies timers by object
        bpy.app.timers.register(self._timer, first_interval=0)

    def settings(self, scene) -> None:
        """Creates the sensor from the scene's settings; ends a recording."""
        s = scene.pecs_live
        chip, threshold = (
            (live_sensor.QUICK, s.threshold) if s.pixel == "QUICK" else (library.find("chip", scene.pecs.chip), None)
        )
        threads = 2 if s.width * s.height >= MANY_PX else 1
        sensor = live_sensor.LiveSensor(s.width, s.height, chip, threshold, threads=threads)
        if self.sensor:
            self.sensor.close()
        self.sensor, self.clock, self._light = sensor, live_sensor.Clock(), None
        if self._gpu:
            self._gpu.free()
        self._gpu, self._changed = None, True

    def stop(self) -> None:
        """Removes handlers and timer; works after the viewport or its file was closed."""
        for handle in self._handles:
            bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        for handlers in _changes():
            handlers.remove(self._note_change)
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        if self._gpu:
            self._gpu.free()
        self.sensor.close()
        redraw("VIEW_3D")

    def is_in(self, space) -> bool:
        """Whether it draws into this viewport."""
        return self._space == space.as_pointer()

    # Detection of changes.

    def _note_change(self, *_) -> None:
        self._changed = self._changed or not self._taking

    def _find(self):
        """Window, area, region and space: looked up each time, since a maximised viewport has another area."""
        for window in bpy.context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D" and area.spaces.active.as_pointer() == self._space:
                    region = next(r for r in area.regions if r.type == "WINDOW")
                    return window, area, region, area.spaces.active
        return None

    def _tick(self) -> float | None:
        try:
            viewport = self._find()
            if not viewport:
                end(self, STOPPED.format(reason="its viewport was closed"))
                return None
            return self._step(*viewport)
        except Exception as e:
            end(self, STOPPED.format(reason=e))
            raise

    def _step(self, window, area, region, space) -> float:
        """Simulates the changes since the last call; returns seconds until the next one."""
        scene, playing = window.scene, window.screen.is_animation_playing
        looked_at = _view(space)
        changed = self._changed or looked_at != self._seen or playing
        self._changed, self._seen = False, looked_at
        now_s = time.perf_counter()
        if changed:
            self._changed_s = now_s
        if now_s - self._changed_s > FADED * scene.pecs_live.decay_ms / 1e3 + MIN_AFTER_S:
            self.clock.step(*_clock(scene, playing))
            return REST_S
        if not draws_offscreen(scene, space):
            area.tag_redraw()  # _before_view reads it
            return BUSY_S
        step = self.clock.step(*_clock(scene, playing))
        if self._light is not None and step.dt_s * 1e6 < 2:
            return BUSY_S  # same scene frame
        if not changed and self._light is not None:
            self._push(self._light, step.dt_s)
        else:
            self._push_frames(window, region, space, step, playing)
        area.tag_redraw()
        return BUSY_S

    def _push_frames(self, window, region, space, step: live_sensor.Step, playing: bool) -> None:
        scene, count = window.scene, 1
        if playing and step.forward and step.frames <= MOST_FRAMES:
            frame_s = scene.render.fps_base / scene.render.fps
            count = live_sensor.subframes_that_fit(scene.pecs_live.subframes, self.cost.one_frame_s(), frame_s)
        self._subframes = count
        frame, subframe = scene.frame_current, scene.frame_subframe
        self._taking = True
        try:
            for left in range(count - 1, -1, -1):
                at = frame + subframe - step.frames * left / count
                if left:
                    scene.frame_set(int(at // 1), subframe=at % 1)
                elif count > 1:
                    scene.frame_set(frame, subframe=subframe)  # exact frame, from which playback continues
                self._push(self._draw_frame(window, region, space), step.dt_s / count, playing and step.backward)
        finally:
            self._taking = False
        self._frame_times_s.append((time.perf_counter(), self.sensor.now_s))

    # Frames.

    def _draw_frame(self, window, region, space) -> np.ndarray:
        """Draws the view at the chip's resolution; [height, width] linear light."""
        height, width = self.sensor.last_s.shape
        self._gpu = self._gpu or _GpuResources(self.sensor.last_s)
        view, projection, _ = self._matrices(window, region, space)
        start_s = time.perf_counter()
        overlay = space.overlay
        shown, overlay.show_overlays = overlay.show_overlays, False
        try:
            self._gpu.offscreen.draw_view3d(
                window.scene,
                window.view_layer,
                space,
                region,
                view,
                projection,
                do_color_management=False,
                draw_background=True,
            )
        finally:
            overlay.show_overlays = shown
        drawn_s = self.cost.add("draw", start_s)
        with self._gpu.offscreen.bind():
            framebuffer = gpu.state.active_framebuffer_get()
            framebuffer.read_color(0, 0, width, height, 4, 0, "FLOAT", data=self._gpu.rgba)
        light = self.sensor.light(self._gpu.rgba_array)
        self.cost.add("read", drawn_s)
        return light

    def _matrices(self, window, region, space):
        """View matrix, projection matrix, and rectangle of their image in the region."""
        height, width = self.sensor.last_s.shape
        scene, region_3d = window.scene, space.region_3d
        if scene.pecs_live.source == "VIEW" or not scene.camera:
            rectangle = centred(width, height, region)
            projection = part_of_view(region_3d.window_matrix, rectangle, region)
            return region_3d.view_matrix.copy(), projection, rectangle
        depsgraph = window.view_layer.depsgraph
        camera = scene.camera.evaluated_get(depsgraph)
        matrix = camera.matrix_world.normalized()
        projection = camera.calc_matrix_camera(depsgraph, x=width, y=height)
        rectangle = None
        if region_3d.view_perspective == "CAMERA" and (space.camera or scene.camera) == scene.camera:
            rectangle = of_camera(matrix, projection, region, region_3d)
        return matrix.inverted(), projection, rectangle or inset(width, height, region)

    def _push(self, light: np.ndarray, dt_s: float, jump: bool = False) -> None:
        start_s, self._light = time.perf_counter(), light
        self.sensor.push(light, dt_s, jump)
        self.cost.add("sensor", start_s)
        if self._gpu:
            self._gpu.texture = None

    def _before_view(self) -> None:
        """Reads the last redraw from the viewport's framebuffer, for engines that draw only there."""
        context = bpy.context
        drawn, self._drawn = self._drawn, None
        if self._taking or drawn is None or context.space_data.as_pointer() != self._space:
            return
        clock, rectangle = drawn
        start_s = time.perf_counter()
        x, y, wide, high = (round(n) for n in rectangle)
        region = context.region
        left, low = max(x, 0), max(y, 0)
        right, top = min(x + wide, region.width), min(y + high, region.height)
        if left >= right or low >= top:
            return
        framebuffer = gpu.state.active_framebuffer_get()
        corner = gpu.state.viewport_get()[:2]
        shared, read = _shared(top - low, right - left, 4)
        framebuffer.read_color(corner[0] + left, corner[1] + low, right - left, top - low, 4, 0, "FLOAT", data=shared)
        seen = np.zeros((high, wide), np.float32)  # dark outside the viewport
        seen[low - y : top - y, left - x : right - x] = shown = self.sensor.light(read)
        self._is_coarse = live_sensor.is_coarse(shown)
        if self._is_coarse:
            return
        step = self.clock.step(*clock)
        if self._light is not None and step.dt_s * 1e6 < 2:
            return
        light = live_sensor.shrink(seen, *self.sensor.last_s.shape)
        self.cost.ms.pop("draw", None)  # the viewport itself draws
        self.cost.add("read", start_s)
        self._push(light, step.dt_s, step.backward)
        self._frame_times_s.append((time.perf_counter(), self.sensor.now_s))

    # Drawing.

    def _draw(self) -> None:
        context = bpy.context
        if self._taking or context.space_data.as_pointer() != self._space:
            return
        scene, space, region = context.scene, context.space_data, context.region
        rectangle = self._matrices(context.window, region, space)[2]
        if not draws_offscreen(scene, space):
            through_camera = space.region_3d.view_perspective == "CAMERA" and scene.pecs_live.source == "CAMERA"
            height, width = self.sensor.last_s.shape
            rectangle = rectangle if through_camera else centred(width, height, region)
            self._drawn = (_clock(scene, context.screen.is_animation_playing), rectangle)
        s = scene.pecs_live
        self._gpu = self._gpu or _GpuResources(self.sensor.last_s)
        self._gpu.draw(rectangle, self.sensor.known_s, s.decay_ms / 1e3, 1.0 if s.alone else 0.0)
        _write(self._lines(), context.area)

    def _lines(self) -> list[tuple[str, tuple]]:
        height, width = self.sensor.last_s.shape
        spent = ", ".join(f"{name} {ms:.1f}" for name, ms in self.cost.ms.items())
        frames, share = self.speed()
        first = f"{width} x {height}, {rate_text(self.sensor.rate_hz)}, subframes: {self._subframes}"
        speed = f"{frames:.1f} frames/s, {share:.0%} of real time"
        cost = f"{speed}, dropped frames: {self.clock.dropped}, ms: {spent}"
        lines = [(WORDS, WHITE), (first, WHITE), (cost, WHITE)]
        if self._drawn and self._is_coarse:
            lines.append(("Waiting for the viewport's first full sample", WHITE))
        if recording := self.sensor.recording:
            lines.append((f"REC {recording.path.name}: {recording.count:,} events", RED))
        return lines

    def speed(self) -> tuple[float, float]:
        """Frames per second, and scene time per time, of the last frames."""
        times = self._frame_times_s
        if len(times) < 2:
            return 0.0, 0.0
        (wall_s, scene_s), (now_s, scene_now_s) = times[0], times[-1]
        return (len(times) - 1) / (now_s - wall_s), (scene_now_s - scene_s) / (now_s - wall_s)


def _shared(*shape: int) -> tuple[gpu.types.Buffer, np.ndarray]:
    """A buffer and an array over its memory. Flat: Blender up to 5.0 reports wrong strides for more dimensions."""
    buffer = gpu.types.Buffer("FLOAT", math.prod(shape))
    return buffer, np.asarray(buffer).reshape(shape)


def draws_offscreen(scene, space) -> bool:
    return space.shading.type != "RENDERED" or scene.render.engine in DRAWS_OFFSCREEN


def rate_text(rate_hz: float) -> str:
    if rate_hz >= 1e6:
        return f"{rate_hz / 1e6:.2f} Mevents/s"
    return f"{rate_hz / 1e3:.1f} kevents/s"


def _clock(scene, playing: bool) -> tuple:
    """Arguments of live_sensor.Clock.step."""
    first, last = scene.frame_start, scene.frame_end
    if scene.use_preview_range:
        first, last = scene.frame_preview_start, scene.frame_preview_end
    fps = scene.render.fps / scene.render.fps_base
    return scene.frame_current_final, time.perf_counter(), playing, fps, last - first + 1


def _view(space) -> tuple:
    shading = space.shading
    return space.region_3d.perspective_matrix.copy(), shading.type, shading.light, shading.color_type


def _changes() -> tuple[list, list]:
    return bpy.app.handlers.depsgraph_update_post, bpy.app.handlers.frame_change_post


_VERTEX = """
void main() {
  uv = pos;
  gl_Position = ModelViewProjectionMatrix * vec4(corner + pos * size, 0.0, 1.0);
}
"""
# Colours of pecs view on a dark background: sky blue for ON, orange for OFF; linear, since the framebuffer is sRGB.
_FRAGMENT = """
void main() {
  float t_s = texture(last_s, uv).r;
  float strength = t_s == 0.0 ? 0.0 : exp((abs(t_s) - now_s) / decay_s);
  vec3 hue = t_s > 0.0 ? vec3(0.093, 0.456, 0.815) : vec3(0.871, 0.262, 0.021);
  vec3 paper = vec3(0.007, 0.0086, 0.011);
  colour = vec4(mix(paper, hue, max(strength, 1.0 - paper_alpha)), max(strength, paper_alpha));
}
"""


class _GpuResources:
    """Offscreen buffer; shader and texture of the signed event times `live_sensor.LiveSensor.last_s`; the memory shared
    with NumPy."""

    def __init__(self, last_s: np.ndarray) -> None:
        height, width = last_s.shape
        self.offscreen = gpu.types.GPUOffScreen(width, height, format="RGBA16F")
        self.rgba, self.rgba_array = _shared(height, width, 4)
        self._last_s = gpu.types.Buffer("FLOAT", last_s.size, last_s.reshape(-1))
        self._size = width, height
        self.texture = None  # of last_s; None if it is outdated
        info = gpu.types.GPUShaderCreateInfo()
        passed = gpu.types.GPUStageInterfaceInfo("pecs_live_passed")
        passed.smooth("VEC2", "uv")
        info.push_constant("MAT4", "ModelViewProjectionMatrix")
        for kind, names in (("VEC2", ("corner", "size")), ("FLOAT", ("now_s", "decay_s", "paper_alpha"))):
            for name in names:
                info.push_constant(kind, name)
        info.sampler(0, "FLOAT_2D", "last_s")
        info.vertex_in(0, "VEC2", "pos")
        info.vertex_out(passed)
        info.fragment_out(0, "VEC4", "colour")
        info.vertex_source(_VERTEX)
        info.fragment_source(_FRAGMENT)
        self._shader = gpu.shader.create_from_info(info)
        self._batch = batch_for_shader(self._shader, "TRI_FAN", {"pos": ((0, 0), (1, 0), (1, 1), (0, 1))})

    def draw(self, rectangle: Rectangle, now_s: float, decay_s: float, paper_alpha: float) -> None:
        self.texture = self.texture or gpu.types.GPUTexture(self._size, format="R32F", data=self._last_s)
        shader, (x, y, width, height) = self._shader, rectangle
        shader.bind()
        shader.uniform_sampler("last_s", self.texture)
        values = {"corner": (x, y), "size": (width, height), "now_s": now_s, "decay_s": decay_s}
        for name, value in (values | {"paper_alpha": paper_alpha}).items():
            shader.uniform_float(name, value)
        gpu.state.blend_set("ALPHA")
        self._batch.draw(shader)
        gpu.state.blend_set("NONE")

    def free(self) -> None:
        self.offscreen.free()


Rectangle = tuple[float, float, float, float]  # x, y of the lower left corner, width, height in the region's pixels


def centred(width: float, height: float, region) -> Rectangle:
    """The largest centred rectangle of this aspect ratio."""
    scale = min(region.width / width, region.height / height)
    width, height = width * scale, height * scale
    return (region.width - width) / 2, (region.height - height) / 2, width, height


def inset(width: float, height: float, region) -> Rectangle:
    shown = region.width * INSET
    return MARGIN_PX, MARGIN_PX, shown, shown * height / width


def of_camera(camera_matrix: Matrix, projection: Matrix, region, region_3d) -> Rectangle | None:
    """Rectangle of the camera's image in a viewport that looks through the camera."""
    from_clip = camera_matrix @ projection.inverted()
    corners = []
    for x, y in ((-1, -1), (1, 1)):
        point = from_clip @ Vector((x, y, 0, 1))
        corners.append(location_3d_to_region_2d(region, region_3d, point.xyz / point.w))
    if None in corners:
        return None
    low, high = corners
    return low.x, low.y, high.x - low.x, high.y - low.y


def part_of_view(projection: Matrix, rectangle: Rectangle, region) -> Matrix:
    """The viewport's projection, cropped to a centred rectangle."""
    return Matrix.Diagonal((region.width / rectangle[2], region.height / rectangle[3], 1, 1)) @ projection


def _write(lines: list[tuple[str, tuple]], area) -> None:
    """Draws lines of text in the lower left corner, next to the toolbar."""
    scale = bpy.context.preferences.system.ui_scale
    left = sum(r.width for r in area.regions if r.type == "TOOLS") + MARGIN_PX
    blf.size(0, 12 * scale)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 5, 0, 0, 0, 0.9)
    for i, (text, colour) in enumerate(reversed(lines)):
        blf.color(0, *colour)
        blf.position(0, left, MARGIN_PX + 18 * scale * i, 0)
        blf.draw(0, text)
    blf.disable(0, blf.SHADOW)


class _State:
    view: LiveView | None = None
    message = ""  # why the last view stopped


state = _State()


def end(view: LiveView | None, message: str = "") -> None:
    """Stops the view if it is the running one."""
    if not view or state.view is not view:
        return
    state.view, state.message = None, message
    view.stop()


def record(view: LiveView, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    view.sensor.record(path)
