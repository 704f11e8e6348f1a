# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that run the program `pecs`: simulate, view, reconstruct, report, compare."""

import json
import re
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty

from ..job.programs import pecs as program
from . import background, checks, disk, event_view, library, operators, paths, settings
from .background import BackgroundJob, Next
from .interface import Action, areas
from .preferences import preferences

KINDS = {  # outputs of `pecs view`: label and description
    "png": ("Image Sheet", "Draw the events as images and show them in the image editor"),
    "mp4": ("Video", "Write a slow-motion video and open it in the system's player"),
    "html": ("3-D Page", "Write a page with the events in space and time and open it in the browser"),
}
MUCH_NOISE = 0.1  # share of events from render noise, above which it counts if it is also above the camera's own
VIDEO_S, PLAYBACK_FPS = 10, 25  # default length and frame rate of a reconstructed video


def _command(*words: object) -> list[str]:
    return [program(), *map(str, words)]


def show_events(job: BackgroundJob) -> str:
    """Draws the new events over the viewport, unless a file with another folder has been opened since."""
    if paths.events(bpy.context.scene).parent == job.output.parent:
        event_view.show(job.output)
    text = job.answer[-1] if job.answer else f"{job.output}: simulated"
    results = json.loads(Path(f"{job.output}.run.json").read_text(encoding="utf-8"))["results"]
    share, own = (results.get(of, {}).get("share") or 0 for of in ("render_noise", "camera_noise"))
    if share > max(MUCH_NOISE, own):
        text = f"Render noise causes {share:.0%} of the events. Use more samples. {text}"
    return re.sub(r"(?<= )\d+(?= events)", lambda number: f"{int(number[0]):,}", text)


class PECS_OT_sense(operators.InBackground, bpy.types.Operator):
    """Simulate the events of the rendered stack"""

    bl_label = "Simulate Events"

    @classmethod
    def why_not(cls, context) -> str:
        if busy := super().why_not(context):
            return busy
        stack = paths.rendered(context.scene)
        if not disk.is_file(stack / "stack.json"):
            return f"{stack}: does not exist; render the stack first"
        return next((one.text for one in checks.sensor_problems(context.scene)), "")

    @staticmethod
    def job(context) -> BackgroundJob:
        scene, events = context.scene, paths.events(context.scene)
        words = ["--chip", library.find("chip", scene.pecs.chip), *settings.sensor_arguments(scene)]
        words += settings.frames_arguments(scene, events)
        words += ["--threads", scene.pecs.threads or preferences().threads]
        command = _command("sense", paths.rendered(scene), "-o", events, *words)
        return BackgroundJob("Simulate Events", command, events, show_events)


class _Runs(operators.Renders):
    """Renders and simulates."""

    problems = staticmethod(checks.run_problems)


class PECS_OT_run(_Runs, bpy.types.Operator):
    """Render the EXR stack, then simulate its events. A stopped render resumes"""

    bl_label = "Render and Simulate"

    @staticmethod
    def job(context) -> BackgroundJob:
        return _run_of(context.scene, paths.stack(context.scene), paths.events(context.scene)).make()


def _run_of(scene, stack: Path, events: Path, label: str = "Render and Simulate", is_shown: bool = True) -> Next:
    """Renders and simulates the scene as it is now. is_shown: its events are drawn over the viewport."""
    name = scene.name

    def done(job: BackgroundJob) -> str:
        if not is_shown:
            return job.answer[-1]
        operators.remember_stack(name, job.folder if job.folder != events else stack)
        return show_events(job)

    width, height = map(str, settings.size(scene))  # by default it would be the chip's
    words = ["--stack", str(stack), "--width", width, "--height", height]
    words += [*operators.frame_words(scene), *settings.exists_words(scene)]
    sense = [*settings.sensor_arguments(scene), *settings.frames_arguments(scene, events)]
    command = operators.blender(scene, "run", events, *words, "--sense", *sense)
    how = {"continues": True, "tasks": operators.TASKS, "render_s": operators.planned_s(scene)}
    return Next(command, lambda: BackgroundJob(label, command, events, done, **how))


def _by_file_name(cameras: list[bpy.types.Object]) -> dict[str, bpy.types.Object]:
    """By a part of a file's name that no other has, whatever the system makes of capital letters."""
    out: dict[str, bpy.types.Object] = {}
    for camera in sorted(cameras, key=lambda one: one.name):
        clean = bpy.path.clean_name(camera.name)
        while clean.lower() in map(str.lower, out):
            clean += "_"
        out[clean] = camera
    return out


class PECS_OT_run_cameras(_Runs, bpy.types.Operator):
    """Render and simulate all cameras of the scene, one after the other. Their names are in those of the files"""

    bl_label = "Run All Cameras"

    def act(self, context) -> None:
        scene = context.scene
        self.check_files(scene)
        chosen, runs = scene.camera, []
        markers = [(marker, marker.camera) for marker in scene.timeline_markers if marker.camera]
        try:
            for marker, _ in markers:  # it would switch the camera
                marker.camera = None
            for name, one in _by_file_name([thing for thing in scene.objects if thing.type == "CAMERA"]).items():
                scene.camera = one
                stack, events = (
                    path.with_stem(f"{path.stem}_{name}") for path in (paths.stack(scene), paths.events(scene))
                )
                runs.append(_run_of(scene, stack, events, self.bl_label, is_shown=one == chosen))
        finally:
            scene.camera = chosen
            for marker, camera in markers:
                marker.camera = camera
        background.start(runs[0].make(), runs[1:])


class _OnEvents(operators.InBackground):
    @classmethod
    def why_not(cls, context) -> str:
        events = paths.events(context.scene)
        missing = "" if disk.is_file(events) else f"{events}: does not exist; simulate the events first"
        return super().why_not(context) or missing


class PECS_OT_view(_OnEvents, bpy.types.Operator):
    """View the simulated events"""

    bl_label = "View Events"

    kind: EnumProperty(name="Format", items=[(key, *words) for key, words in KINDS.items()])
    to_sequencer: bpy.props.BoolProperty(name="Add to Sequencer", options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _context, properties) -> str:
        return "Add the video as a strip to the sequencer" if properties.to_sequencer else KINDS[properties.kind][1]

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
        return f"{job.output}: no sequencer is open"
    editor = scene.sequence_editor or scene.sequence_editor_create()
    strips = editor.strips
    if not strips:
        scene.render.use_sequencer = False  # otherwise Blender renders the strip instead of the camera
    channel = 1 + max((strip.channel for strip in strips), default=0)
    if not getattr(bpy.context.workspace, "sequencer_scene", scene):  # Blender 5: otherwise the sequencer is empty
        bpy.context.workspace.sequencer_scene = scene
    strip = strips.new_movie(job.output.stem, str(job.output), channel, scene.frame_start, fit_method="FIT")
    return f"{strip.name}: added to channel {channel} of the sequencer"


class PECS_OT_reconstruct(_OnEvents, bpy.types.Operator):
    """Reconstruct a video from the simulated events with a filter and open it in the system's player"""

    bl_label = "Reconstruct Video"

    to_sequencer: bpy.props.BoolProperty(name="Add to Sequencer", options={"SKIP_SAVE"})

    def job(self, context) -> BackgroundJob:
        scene, events = context.scene, paths.events(context.scene)
        s, output = scene.pecs, events.with_suffix(".light.mp4")
        slower = s.sensor.slow_motion or VIDEO_S * s.fps / settings.frame_count(scene)
        rates = ["--fps", f"{PLAYBACK_FPS * max(1, slower):.6g}", "--playback-fps", str(PLAYBACK_FPS)]
        words = ["-o", output, *rates, "--method", "filter", "--cutoff", f"{s.sensor.cutoff_hz:.6g}"]
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
            raise RuntimeError("Choose a recording (an event file)")
        window = sensor.compare_ms
        words = ["--window", f"{window:.6g}ms"] if window else []
        command = _command("compare", *_recording(context.scene), events, *words, "--json")
        return BackgroundJob("Compare", command, events, _keep_scores)


def _keep_scores(job: BackgroundJob) -> str:
    scores = json.loads("\n".join(job.answer))
    background.state.scores = scores | {"recording": Path(job.command[2]).name}
    return "; ".join(scores["warnings"]) or f"Compared with {Path(job.command[2]).name}"


ALIKE, CORRELATED = 0.1, 0.9  # deviation up to which two values count as alike; correlation from which on they do


def score_rows(scores: dict) -> list[tuple[str, str, str, str, bool]]:
    """From the JSON of `pecs compare`: label, value of the recording, value of the simulation, ratio or correlation,
    and whether they are alike. The first value of a distance is that of the recording's two halves."""
    rows = []
    for label, key in (("Chamfer", "chamfer"), ("Gaussian", "gaussian")):
        floor, score = scores["split_half"][key], scores[key]
        rows.append((label, *map(_number, (floor, score)), *_ratio(floor, score, one_sided=True)))
    for label, key in (
        ("Events", "events"),
        ("Rate (Hz)", "rate_hz"),
        ("ON Share", "on_fraction"),
        ("Interval (µs)", "interval_median_us"),
    ):
        real, sim = (scores[which][key] for which in ("real", "sim"))
        rows.append((label, _number(real), _number(sim), *_ratio(real, sim)))
    for label, key in (("Rate Corr.", "rate_correlation"), ("Map Corr.", "map_correlation")):
        value = scores[key]
        rows.append((label, "", "", _number(value), value is not None and value >= CORRELATED))
    return rows


def _ratio(real: float | None, sim: float | None, one_sided: bool = False) -> tuple[str, bool]:
    """Text of simulation / recording, and whether they are alike. one_sided: less is better."""
    if real is None or sim is None or not real:
        return "", False
    ratio = sim / real
    return f"{ratio:.2f}", ratio <= 1 + ALIKE and (one_sided or ratio >= 1 - ALIKE)


def _number(value: float | None) -> str:
    """Four characters, which fit the table's columns; null where there are too few events."""
    if value is None:
        return "none"
    size, unit = next(((s, u) for s, u in ((1e9, "G"), (1e6, "M"), (1e4, "k")) if abs(value) >= s), (1, ""))
    value /= 1e3 if unit == "k" else size
    if abs(value) >= 100 or (unit and abs(value) >= 10):
        return f"{value:.0f}{unit}"
    text = f"{value:.{1 if unit or abs(value) >= 10 else 2}f}"
    return text.rstrip("0").rstrip(".") + unit


class PECS_OT_close_scores(Action, bpy.types.Operator):
    """Remove the scores from the panel"""

    bl_label = "Close"
    bl_options = {"INTERNAL"}

    def act(self, _context) -> None:
        background.state.scores = {}


class PECS_OT_open_folder(Action, bpy.types.Operator):
    """Open the folder of the stack and events in the system's file manager"""

    bl_label = "Open Output Folder"

    @classmethod
    def poll(cls, context) -> bool:
        return disk.is_folder(paths.events(context.scene).parent)

    def act(self, context) -> str:
        return paths.open_outside(paths.events(context.scene).parent)
