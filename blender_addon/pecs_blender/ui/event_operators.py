# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that run the program `pecs`: simulate, view, reconstruct, report, compare."""

import json
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty

from ..render.programs import pecs as program
from . import background, checks, library, operators, paths, settings
from .background import BackgroundJob
from .interface import Action, areas, say
from .preferences import preferences

KINDS = {  # outputs of `pecs view`: label and description
    "png": ("Image Sheet", "Draw the events as images and show them in the image editor"),
    "mp4": ("Video", "Write a slow-motion video and open it in the system's player"),
    "html": ("3-D Page", "Write a page with the events in space and time and open it in the browser"),
}
VIDEO_S, PLAYBACK_FPS = 10, 25  # default length and frame rate of a reconstructed video


def _command(*words: object) -> list[str]:
    return [program(), *map(str, words)]


class PECS_OT_sense(operators.InBackground, bpy.types.Operator):
    """Simulate the events of the rendered stack"""

    bl_label = "Simulate Events"

    @classmethod
    def why_not(cls, context) -> str:
        if busy := super().why_not(context):
            return busy
        stack = paths.rendered(context.scene)
        if not (stack / "stack.json").is_file():
            return say("{path}: does not exist; render the stack first", path=stack)
        return next((one.text for one in checks.sensor_problems(context.scene)), "")

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, events = context.scene, paths.events(context.scene)
        words = ["--chip", library.find("chip", scene.pecs.chip), *settings.sensor_arguments(scene)]
        words += ["--threads", scene.pecs.threads or preferences().threads]
        command = _command("sense", paths.rendered(scene), "-o", events, *words)
        return BackgroundJob("Simulate Events", command, events, lambda job: job.answer[-1])


class _OnEvents(operators.InBackground):
    @classmethod
    def why_not(cls, context) -> str:
        events = paths.events(context.scene)
        missing = "" if events.is_file() else say("{path}: does not exist; simulate the events first", path=events)
        return super().why_not(context) or missing


class PECS_OT_view(_OnEvents, bpy.types.Operator):
    """View the simulated events"""

    bl_label = "View Events"

    kind: EnumProperty(name="Format", items=[(key, *words) for key, words in KINDS.items()])
    to_sequencer: bpy.props.BoolProperty(name="Add to Sequencer", options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _context, properties) -> str:
        return say(
            "Add the video as a strip to the sequencer" if properties.to_sequencer else KINDS[properties.kind][1]
        )

    def job(self, context) -> BackgroundJob:
        sensor, events = context.scene.pecs.sensor, paths.events(context.scene)
        output = events.with_suffix("." + self.kind)
        words = ["--window", f"{sensor.window_ms:.6g}ms"] if sensor.window_ms and self.kind != "html" else []
        words += ["--slow-motion", f"{sensor.slow_motion:.6g}"] if sensor.slow_motion > 1 and self.kind == "mp4" else []
        done = {"png": _show_sheet, "mp4": _add_strip if self.to_sequencer else _open, "html": _open}[self.kind]
        return BackgroundJob(KINDS[self.kind][0], _command("view", events, "-o", output, *words), output, done)


def _open(job: BackgroundJob) -> str:
    return paths.open_outside(job.output)


def _show_sheet(job: BackgroundJob) -> str:
    image = bpy.data.images.load(str(job.output), check_existing=True)
    image.reload()
    return operators.show_image(image)


def sequencer_scene(context) -> bpy.types.Scene | None:
    """Scene of the open sequencer; None if no sequencer is open."""
    if not any(areas("SEQUENCE_EDITOR")):
        return None
    return getattr(context.workspace, "sequencer_scene", None) or context.scene  # Blender 5; 4.5


def _add_strip(job: BackgroundJob) -> str:
    scene = sequencer_scene(bpy.context)
    if not scene:
        return say("{path}: no sequencer is open", path=job.output)
    editor = scene.sequence_editor or scene.sequence_editor_create()
    strips = editor.strips
    if not strips:
        scene.render.use_sequencer = False  # otherwise Blender renders the strip instead of the camera
    channel = 1 + max((strip.channel for strip in strips), default=0)
    if not getattr(bpy.context.workspace, "sequencer_scene", scene):  # Blender 5: otherwise the sequencer is empty
        bpy.context.workspace.sequencer_scene = scene
    strip = strips.new_movie(job.output.stem, str(job.output), channel, scene.frame_start, fit_method="FIT")
    return say("{strip}: added to channel {channel} of the sequencer", strip=strip.name, channel=channel)


class PECS_OT_reconstruct(_OnEvents, bpy.types.Operator):
    """Reconstruct a video from the simulated events with a filter and open it in the system's player"""

    bl_label = "Reconstruct Video"

    to_sequencer: bpy.props.BoolProperty(name="Add to Sequencer", options={"SKIP_SAVE"})

    def job(self, context) -> BackgroundJob:
        scene, events = context.scene, paths.events(context.scene)
        s, output = scene.pecs, events.with_suffix(".light.mp4")
        slower = s.sensor.slow_motion or VIDEO_S * s.fps / settings.frame_count(scene)
        rates = ["--fps", f"{PLAYBACK_FPS * max(1, slower):.6g}", "--playback-fps", str(PLAYBACK_FPS)]
        words = ["-o", output, *rates, "--cutoff", f"{s.sensor.cutoff_hz:.6g}"]
        command = [*operators.program("reconstruct"), str(events), *map(str, words)]
        done = _add_strip if self.to_sequencer else _open
        return BackgroundJob("Reconstruct Video", command, output, done)


class PECS_OT_report(_OnEvents, bpy.types.Operator):
    """Write a page with the render, lens and events, and the scores if a recording is set"""

    bl_label = "Report"

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, events = context.scene, paths.events(context.scene)
        stack, output = paths.rendered(scene), events.with_suffix(".report.html")
        words = ["--stack", stack] if (stack / "stack.json").is_file() else []
        words += _recording(scene, "--real")
        return BackgroundJob("Report", _command("report", "--sim", events, *words, "-o", output), output, _open)


def _recording(scene, *option: str) -> list[str]:
    text = scene.pecs.sensor.recording
    return [*option, bpy.path.abspath(text)] if text else []


class PECS_OT_compare(_OnEvents, bpy.types.Operator):
    """Compute similarity scores between the simulated events and a recording"""

    bl_label = "Compare with Recording"

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})

    def invoke(self, context, _event):
        if context.scene.pecs.sensor.recording:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def job(self, context) -> BackgroundJob:
        sensor, events = context.scene.pecs.sensor, paths.events(context.scene)
        if self.filepath:
            sensor.recording = self.filepath
        if not sensor.recording:
            raise RuntimeError(say("Choose a recording (an event file)"))
        window = sensor.compare_ms
        words = ["--window", f"{window:.6g}ms"] if window else []
        command = _command("compare", *_recording(context.scene), events, *words, "--json")
        return BackgroundJob("Compare", command, events, _keep_scores)


def _keep_scores(job: BackgroundJob) -> str:
    scores = json.loads("\n".join(job.answer))
    names, ms = (Path(job.command[2]).name, job.output.name), scores["window_us"] / 1e3
    title = say("{recording} / {events}, {ms:.4g} ms", recording=names[0], events=names[1], ms=ms)
    background.state.scores = title, score_rows(scores)
    return "; ".join(scores["warnings"])


def score_rows(scores: dict) -> list[tuple[str, str]]:
    """Rows of label and value from the JSON of `pecs compare`; the recording's value first."""

    def both(key: str, spec: str) -> str:
        real, sim = (_number(scores[which][key], spec) for which in ("real", "sim"))
        return say("{real} / {simulated}", real=real, simulated=sim)

    def with_halves(key: str) -> str:
        score, halves = (_number(of[key], ".4g") for of in (scores, scores["split_half"]))
        return say("{score} (halves of recording: {halves})", score=score, halves=halves)

    return [
        ("Chamfer", with_halves("chamfer")),
        ("Gaussian", with_halves("gaussian")),
        ("Events", both("events", ",")),
        ("Event Rate (Hz)", both("rate_hz", ".4g")),
        ("ON Fraction", both("on_fraction", ".3f")),
        ("Median Interval (µs)", both("interval_median_us", ".4g")),
        ("Rate Correlation", _number(scores["rate_correlation"], ".3f")),
        ("Map Correlation", _number(scores["map_correlation"], ".3f")),
    ]


def _number(value: float | None, spec: str) -> str:
    """null where there are too few events."""
    return say("none") if value is None else format(value, spec)


class PECS_OT_close_scores(Action, bpy.types.Operator):
    """Remove the scores from the panel"""

    bl_label = "Close"
    bl_options = {"INTERNAL"}

    def act(self, _context) -> None:
        background.state.scores = "", []


class PECS_OT_open_folder(Action, bpy.types.Operator):
    """Open the folder of the stack and events in the system's file manager"""

    bl_label = "Open Output Folder"

    @classmethod
    def poll(cls, context) -> bool:
        return paths.events(context.scene).parent.is_dir()

    def act(self, context) -> str:
        return paths.open_outside(paths.events(context.scene).parent)
