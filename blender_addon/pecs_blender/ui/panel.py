# SPDX-License-Identifier: GPL-3.0-or-later
"""Render properties > PECS, with its sub-panels in the order in which Blender draws them."""

from __future__ import annotations

import contextlib
import re

import bpy
from pecs._errors import PecsError

from ..job.options import SAMPLES
from ..job.resources import readable
from . import checks, event_operators, event_view, frustum, library, light_probe, operators, paths, settings
from .background import state
from .interface import auto, duration, labelled, problem, progress, props, wrapped
from .presets import PECS_PT_presets

ROW = 28  # characters of a row at the default width of the editor


class _RenderTab:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class SubPanel(_RenderTab):
    bl_parent_id = "PECS_PT_render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context) -> None:
        self.layout.use_property_split, self.layout.use_property_decorate = True, False
        with contextlib.suppress(PecsError):  # an invalid chip or lens, which checks.py reports above
            self.fill(self.layout, context.scene, context.scene.pecs)


class PECS_PT_render(_RenderTab, bpy.types.Panel):
    bl_label = "PECS: Event Camera"

    def draw_header_preset(self, _context) -> None:
        PECS_PT_presets.draw_panel_header(self.layout)

    def draw(self, context) -> None:
        layout = self.layout
        row = layout.row()
        row.scale_y = 1.4
        if job := state.job:
            progress(row, job)
        else:
            row.operator("pecs.run", icon="RENDER_ANIMATION")
        if len(bpy.data.cameras) > 1:
            layout.operator("pecs.run_cameras", icon="OUTLINER_OB_CAMERA")
        row = layout.row()  # always one line, so that no button moves when a job starts or ends
        row.alert = bool(not state.job and state.is_error)
        message = "" if state.job else state.message.replace(f"{paths.events(context.scene).parent}/", "")
        engine = {"cycles": "Cycles", "eevee": "EEVEE"}[context.scene.pecs.engine]
        width, height = settings.size(context.scene)
        if len(message) > ROW and not state.is_error:  # Blender cuts the middle
            message = re.sub(r"^\S+\.\w+: ", "", message)
        text = message or f"{width} x {height}, {engine}, {_samples(context.scene)} samples"
        row.label(text=text, icon="NONE" if not message else "ERROR" if state.is_error else "INFO")
        row.operator("pecs.message", text="", icon="HELP" if not message else "TEXT", emboss=False)
        if state.offer_exists:
            layout.prop(context.scene.pecs, "exists")
        for one in checks.run_problems(context.scene):
            problem(layout, one)


def _samples(scene) -> int | str:
    if settings.words(scene, "noise_events"):
        return "automatic"
    return scene.pecs.samples or SAMPLES[scene.pecs.time]


class PECS_PT_sidebar(bpy.types.Panel):
    """The button, its message and the events in the sidebar of the 3-D viewport."""

    bl_label = "Event Camera"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PECS"

    def draw(self, context) -> None:
        PECS_PT_render.draw(self, context)
        _events_shown(self.layout)


def _events_shown(layout) -> None:
    shown = event_view.state.view is not None
    column = layout.column(align=True)
    column.operator("pecs.show_events", icon="HIDE_OFF" if shown else "HIDE_ON", depress=shown)
    column.operator("pecs.show_events", text="Image of Current Frame", icon="IMAGE").in_editor = True


def _camera(layout, scene, s) -> None:
    """The settings of the event camera, also in the camera's own tab."""
    row = layout.row(align=True)
    row.operator("pecs.setup_camera", icon="CAMERA_DATA", text="Set Up")
    row.operator("pecs.restore_camera", icon="LOOP_BACK", text="Restore")
    layout.menu("PECS_MT_chip", text=library.title("chip", s.chip), icon="TEXTURE", translate=False)
    chip = library.chip(s.chip)
    text = "{width} x {height} pixels, {pitch:.4g} µm" if chip.width else "Any size, pixel pitch {pitch:.4g} µm"
    layout.label(text=text.format(width=chip.width, height=chip.height, pitch=chip.pixel_pitch_m * 1e6))
    width, height = settings.size(scene)
    if width <= chip.width and height <= chip.height and (width, height) != (chip.width, chip.height):
        layout.operator("pecs.chip_resolution", icon="FULLSCREEN_ENTER")
    lens = library.title("lens", s.lens).partition(" (")[0] if settings.has_lens(s) else "The scene's camera"
    layout.menu("PECS_MT_lens", text=lens, icon="PROP_ON", translate=False)
    if not settings.has_lens(s):
        return
    auto(layout.column(align=True), s, "focus_m", "fnumber")
    props(layout, scene.pecs_camera, "focus_object", "show_field")
    wanted = frustum.setting(scene)
    view, wrong = frustum.fields.ask(wanted) if wanted else (None, "")
    if wrong:
        wrapped(layout, wrong, "ERROR", alert=True)
    elif view:
        wrapped(layout, f"{view.words()}; maximum aperture f/{view.widest:.3g}")


class PECS_PT_camera(SubPanel, bpy.types.Panel):
    bl_label = "Event Camera"
    bl_options = set()  # open

    def fill(self, layout, scene, s) -> None:
        _camera(layout, scene, s)


class PECS_PT_camera_data(SubPanel, bpy.types.Panel):
    bl_label = "PECS: Event Camera"
    bl_parent_id = ""
    bl_context = "data"
    fill = PECS_PT_camera.fill

    @classmethod
    def poll(cls, context) -> bool:
        return context.camera is not None and context.object == context.scene.camera


def _answer(layout, answer, now: list[str]):
    """A column for an answer, grey if the settings have changed since."""
    column = layout.column(align=True)
    if answer["settings"] != now:
        column.active = False
        column.label(text="Measured with other settings", icon="INFO")
    return column


class PECS_PT_time(SubPanel, bpy.types.Panel):
    bl_label = "Time and Quality"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s, "whole_range")
        if not s.whole_range:
            layout.prop(s, "frames")
        layout.prop(s, "fps")
        if s.engine == "cycles":
            auto(layout, s, "noise_events")
        count, passes = settings.frame_count(scene), s.pass_count
        each = f", {passes} passes each" if passes > 1 else ""
        layout.label(text=f"{duration(count / s.fps)}, sampled {count:,} times{each}")
        row = layout.row(align=True)
        row.operator("pecs.plan", icon="TIME")
        row.operator("pecs.preview", icon="IMAGE_DATA")
        if plan := state.plan.get(scene.name):
            column = _answer(layout, plan, operators.planned_with(scene))
            for label, value in operators.plan_rows(plan):
                labelled(column, label).label(text=value)


class PECS_PT_probe(SubPanel, bpy.types.Panel):
    bl_label = "Brightness"
    bl_parent_id = "PECS_PT_time"

    def fill(self, layout, scene, s) -> None:
        layout.operator("pecs.probe_light", icon="LIGHT_SUN")
        if measured := state.light.get(scene.name):
            scale = s.light_scale / measured["light_scale"]
            column = _answer(layout, measured, light_probe.measured_with(scene))
            for label, value in light_probe.rows(measured, scale):
                labelled(column, label).label(text=value)
            corner = measured["corner_hz"]
            if corner and 0 < corner["median"] * scale < light_probe.DIM_HZ:
                wrapped(layout, "Low light: the photoreceptor is slow and blurs moving edges", "INFO")
        column = layout.column(align=True)
        column.prop(scene.pecs_light, "wanted_lux")
        column.operator("pecs.set_lux")


class PECS_PT_truth(SubPanel, bpy.types.Panel):
    bl_label = "Ground Truth"
    bl_parent_id = "PECS_PT_time"

    def fill(self, layout, scene, s) -> None:
        layout.column(align=True).prop(s, "layers")
        for name in sorted(s.layers):
            layout.operator("pecs.show_layer", text=f"Show {name.capitalize()}", icon="IMAGE_DATA").layer = name


class PECS_PT_checks(SubPanel, bpy.types.Panel):
    bl_label = "Scene Checks"
    bl_parent_id = "PECS_PT_time"

    def fill(self, layout, scene, s) -> None:
        layout.operator("pecs.check_scene", icon="VIEWZOOM")
        problems = state.problems.get(scene.name)
        if problems == []:
            wrapped(layout, "No problems found", "CHECKMARK")
        for one in problems or ():
            problem(layout, one)


class PECS_PT_events(SubPanel, bpy.types.Panel):
    bl_label = "Events"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s.sensor, "output", placeholder=paths.events(scene).name)
        props(layout, s.sensor, "format", "noise", "seed")
        known = settings.parameters(s)
        for key, label in (("contrast_threshold_on", "ON Threshold"), ("contrast_threshold_off", "OFF Threshold")):
            index = s.sensor.overrides.find(key)
            row = labelled(layout, label)
            if index >= 0:
                _override(row, s, index, known, text="")
            else:
                row.operator("pecs.override_add", text=f"{known[key]['value']:g} (chip)", icon="ADD").name = key
        for one in checks.sensor_problems(scene):
            problem(layout, one)
        layout.label(text=f"Input: {paths.rendered(scene).name}")
        layout.operator("pecs.sense", icon="PARTICLES")


class PECS_PT_view(SubPanel, bpy.types.Panel):
    bl_label = "Results"

    def fill(self, layout, scene, s) -> None:
        _events_shown(layout)
        auto(layout, s.sensor, "window_ms", "slow_motion")
        row = layout.column(align=True)  # a row would cut the labels
        for kind, icon in (("png", "IMAGE_DATA"), ("mp4", "FILE_MOVIE"), ("html", "WORLD")):
            row.operator("pecs.view", text=event_operators.KINDS[kind][0], icon=icon).kind = kind
        sequencer = event_operators.sequencer_scene(bpy.context)
        if sequencer:
            strip = layout.operator("pecs.view", text="Video to Sequencer", icon="SEQUENCE")
            strip.kind, strip.to_sequencer = "mp4", True
        layout.prop(s.sensor, "cutoff_hz")
        row = layout.row(align=True)
        row.operator("pecs.reconstruct", icon="RENDER_ANIMATION")
        if sequencer:
            row.operator("pecs.reconstruct", text="", icon="SEQUENCE").to_sequencer = True
        row = layout.row(align=True)
        row.operator("pecs.report", icon="TEXT")
        row.operator("pecs.open_folder", icon="FILE_FOLDER", text="Folder")


class PECS_PT_compare(SubPanel, bpy.types.Panel):
    bl_label = "Compare"
    bl_parent_id = "PECS_PT_view"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s.sensor, "recording")
        auto(layout, s.sensor, "compare_ms")
        layout.operator("pecs.compare", icon="MOD_DATA_TRANSFER")
        if not state.scores:
            return
        box = layout.box()
        row = box.row()
        row.label(text=f"{state.scores['recording']}, {duration(state.scores['window_us'] / 1e6)}")
        row.operator("pecs.close_scores", icon="X", text="", emboss=False)
        column = box.column(align=True)
        column.scale_y = 0.8
        _score(column, "", "Rec.", "Sim.", "Ratio", "BLANK1")
        for label, real, sim, ratio, alike in event_operators.score_rows(state.scores):
            _score(column, label, real, sim, ratio, "CHECKMARK" if alike else "ERROR")
        wrapped(box, "Distances of the recording are between its halves; less is better. Ticks: up to 10 % off")


def _score(layout, label: str, real: str, sim: str, ratio: str, icon: str) -> None:
    split = layout.split(factor=0.47)
    split.label(text=label, icon=icon)
    row = split.row()
    for text in (real, sim, ratio):
        row.label(text=text)


class PECS_PT_advanced(SubPanel, bpy.types.Panel):
    bl_label = "Advanced"

    def fill(self, layout, scene, s) -> None:
        pass


class PECS_PT_sensor(SubPanel, bpy.types.Panel):
    bl_label = "Sensor"
    bl_parent_id = "PECS_PT_advanced"

    def fill(self, layout, scene, s) -> None:
        name = s.sensor.preset or "The chip's values"
        layout.menu("PECS_MT_preset", text=name, icon="PRESET", translate=False)
        props(layout, s.sensor, "model", *(() if s.sensor.preset else ("readout",)))
        if settings.has_frames(s):
            layout.prop(s.sensor, "chip_frames")


def _override(row, s, index: int, known: dict, text: str) -> None:
    """The field of an overridden value, and the button that removes it."""
    one = s.sensor.overrides[index]
    row.alert = bool(settings.override_error(one, known))
    row.prop(one, "value", text=text)
    row.operator("pecs.override_remove", icon="X", text="").index = index


class PECS_PT_parameters(SubPanel, bpy.types.Panel):
    bl_label = "Parameters"
    bl_parent_id = "PECS_PT_sensor"

    def fill(self, layout, scene, s) -> None:
        known = settings.parameters(s)
        for index, one in enumerate(s.sensor.overrides):
            entry = known.get(one.name, {"unit": "?", "range": (0, 0)})
            column = layout.column(align=True)
            _override(column.row(align=True), s, index, known, text=one.name)
            low, high = entry["range"]
            unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
            row = column.row()
            row.alignment = "RIGHT"
            row.label(text=f"{low:g} to {high:g}{unit}")
        layout.operator("pecs.override_add", icon="ADD")


class PECS_PT_stages(SubPanel, bpy.types.Panel):
    bl_label = "Biases and Digital Stages"
    bl_parent_id = "PECS_PT_sensor"

    def fill(self, layout, scene, s) -> None:
        sensor = s.sensor
        props(layout.column(align=True), sensor, "diff_on", "diff_off")
        props(layout, sensor, "mask", "afk")
        if sensor.afk != "none":
            props(layout.column(align=True), sensor, "afk_low_hz", "afk_high_hz")
        props(layout, sensor, "trail")
        if sensor.trail != "none":
            props(layout, sensor, "trail_ms")
        auto(layout, sensor, "erc_mhz")


class PECS_PT_lens(SubPanel, bpy.types.Panel):
    bl_label = "Lens"
    bl_parent_id = "PECS_PT_advanced"

    def fill(self, layout, scene, s) -> None:
        if not settings.has_lens(s):
            layout.label(text="No lens is set")
            return
        auto(layout, s, "film_width_mm")
        layout.prop(s, "film_shift_mm")
        column = layout.column(align=True)
        column.operator("pecs.match_lens", text="Match Camera", icon="CAMERA_DATA")
        column.operator("pecs.draw_lens", icon="VIEW_ORTHO")


class PECS_PT_light(SubPanel, bpy.types.Panel):
    bl_label = "Light and Bands"
    bl_parent_id = "PECS_PT_advanced"

    def fill(self, layout, scene, s) -> None:
        auto(layout, s, "bands", "samples")
        props(layout, s, "placement", "illuminant", "light_scale", "engine")
        if s.engine == "cycles":
            layout.prop(s, "device")


class PECS_PT_light_more(SubPanel, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "PECS_PT_light"

    def fill(self, layout, scene, s) -> None:
        auto(layout, s, "min_nm", "max_nm", "threads")
        layout.prop(s, "bands_per_pass")
        if s.engine == "cycles":
            props(layout, s, "no_denoise", "light_tree", "seed")
        layout.prop(s, "allow_scripts")


class PECS_PT_stack(SubPanel, bpy.types.Panel):
    bl_label = "Stack"
    bl_parent_id = "PECS_PT_advanced"

    def fill(self, layout, scene, s) -> None:
        layout.prop(s, "output", placeholder=paths.stack(scene).name)
        props(layout, s, "exists", "time")
        if s.time == "adaptive" or s.engine == "cycles":
            layout.prop(s, "step_px" if s.time == "adaptive" else "moving_px")
        if s.time == "uniform":
            layout.label(text=f"Up to {readable(settings.stack_bytes(scene))}")
        layout.operator("pecs.render", icon="RENDER_STILL")
