"""The panel as a person uses it, in bpy and without a window: main(ACT, FOLDER). A timer's work is
called by hand; layouts check what is drawn into them."""

import json
import os
import re
import signal
import subprocess
import time
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
from pecs_blender import ui
from pecs_blender.ui import background, checks, event_operators, event_view, frustum, panel, paths, settings
from pecs_blender.ui.interface import AUTO
from pecs_lab.blend import ball, floor, lamp, material, start

from support.panel_widths import cut

WIDTH, HEIGHT = 32, 18
PRESETS = Path(ui.__file__).parent / "presets/pecs"


class Layout:
    """Collects texts; asserts that properties and operators exist."""

    def __init__(self, texts):
        self.__dict__.update(texts=texts, alert=False)

    def __setattr__(self, name, value):
        pass

    def prop(self, data, name, **words):
        assert name in data.bl_rna.properties, (data, name)

    def operator(self, name, text="", **words):
        module, _, verb = name.partition(".")
        rna = getattr(getattr(bpy.ops, module), verb).get_rna_type()
        self.texts.append(text or rna.name)
        return SimpleNamespace()

    def menu(self, name, text="", **words):
        assert hasattr(bpy.types, name)
        self.texts.append(text)

    def label(self, text="", **words):
        self.texts.append(text)

    def progress(self, factor, text):
        assert 0 <= factor <= 1
        self.texts.append(text)

    def separator(self, **words):
        pass

    def row(self, **words):
        return Layout(self.texts)

    box = column = split = row


def drawn(context=None, kinds=bpy.types.Panel | bpy.types.Menu):
    """All texts of all panels and menus, or of these kinds."""
    texts = []
    for module in ui.modules():
        for cls in ui.classes(module):
            own_context = context or bpy.context
            if not issubclass(cls, kinds) or "preset" in cls.__name__.lower():
                continue
            if getattr(cls, "bl_context", "render") not in ("render",):
                continue
            fake = SimpleNamespace(layout=Layout(texts))
            fake.fill = lambda *words, cls=cls, fake=fake: cls.fill(fake, *words)
            cls.draw(fake, own_context)
    return texts


def ended():
    while background.poll() is not None:
        time.sleep(0.02)
    return background.state.message, background.state.is_error


def pressed(name, **words):
    """Presses a button; the message of its job."""
    assert getattr(bpy.ops.pecs, name)(**words) == {"FINISHED"}, name
    message, is_error = ended()
    assert not is_error, (name, message)
    return message


def refused(name, **words):
    """The error of a button that cannot run."""
    try:
        getattr(bpy.ops.pecs, name)(**words)
    except RuntimeError as e:
        return str(e)
    raise AssertionError(f"{name} ran")


def scene_file(folder):
    """A ball that moves; the panel's settings are small ones."""
    scene = start()
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    lamp("AREA", energy=400)
    floor(material("grey", ("ShaderNodeBsdfDiffuse", {"Color": (0.5, 0.5, 0.5, 1)}))[0])
    thing = ball(material("red", ("ShaderNodeBsdfDiffuse", {"Color": (0.9, 0.9, 0.9, 1)}))[0])
    for frame, x in ((1, -1.0), (3, 1.0)):
        thing.location.x = x
        thing.keyframe_insert("location", frame=frame)
    s = scene.pecs
    s.bands, s.samples, s.fps, s.frames, s.whole_range = 1, 1, 100.0, 8, False
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    return scene


def line(folder):
    """From the scene to scores, by the buttons."""
    scene = scene_file(folder)
    drawn()
    assert "render the stack first" in refused("sense")
    assert "simulate the events first" in refused("view") and "simulate the events first" in refused("compare")
    _runs(scene, folder)
    _renders_what_is_in_memory(scene, folder)
    _views(scene, folder)
    _compares(scene, folder / "scene_events/scene.raw")
    scene.pecs.sensor.format = "npz"
    assert paths.events(scene) == folder / "scene_events/scene.npz"
    _renders_a_new_version(scene, folder)


def _runs(scene, folder):
    """Render and simulate with an override, then simulate without it, with another seed."""
    sensor, events = scene.pecs.sensor, folder / "scene_events/scene.raw"
    bpy.ops.pecs.override_add(name="contrast_threshold_on")
    sensor.overrides[0].value = "0.2"
    message = pressed("run")
    assert f"{events}: " in message and " events, 32x18" in message, message
    record = json.loads((folder / "scene_events/scene.raw.run.json").read_text())
    assert record["config"]["chip"]["values"]["contrast_threshold_on"]["value"] == 0.2
    assert abs(record["config"]["fnumber"] - scene.camera.data.dof.aperture_fstop) < 1e-6  # from the stack
    first = events.read_bytes()
    bpy.ops.pecs.override_remove(index=0)
    assert len(sensor.overrides) == 0
    sensor.seed = 2
    pressed("sense")
    assert events.read_bytes() != first
    bpy.ops.pecs.use_preset(name="v2e_noisy")
    pressed("sense")
    assert json.loads((folder / "scene_events/scene.raw.run.json").read_text())["config"]["preset"] == "v2e_noisy"
    sensor.model = "pecs"
    assert not sensor.preset


def _views(scene, folder):
    """Images, page, video, strip, reconstruction and report."""
    assert "image editor" in pressed("view", kind="png") and bpy.data.images["scene.png"].size[0] > 100
    pressed("view", kind="html")
    assert (folder / "scene_events/scene.html").stat().st_size > 1000
    assert str(folder / "scene_events/scene.mp4") in pressed("view", kind="mp4")
    event_operators.sequencer_scene = lambda context: context.scene  # as if a sequencer were open
    assert "channel 1" in pressed("view", kind="mp4", to_sequencer=True) and not scene.render.use_sequencer
    assert str(folder / "scene_events/scene.light.mp4") in pressed("reconstruct")
    assert scene.sequence_editor.strips[0].frame_final_duration > 10
    pressed("report")
    assert (folder / "scene_events/scene.report.html").stat().st_size > 1000


def _compares(scene, events):
    """With the events themselves as the recording."""
    scene.pecs.sensor.recording = str(events)
    pressed("compare")
    rows = {row[0]: row[1:] for row in event_operators.score_rows(background.state.scores)}
    assert rows["Events"][0] == rows["Events"][1] and rows["Events"][2:] == ("1.00", True), rows
    assert rows["Chamfer"][1:] == ("0", "0.00", True) and rows["Map Corr."][2:] == ("1", True), rows
    assert {"scene.raw", rows["Events"][0]} <= {text.partition(",")[0] for text in drawn()}
    bpy.ops.pecs.close_scores()
    assert "Rec." not in drawn()
    nothing = {"events": 1, "rate_hz": None, "on_fraction": 1.0, "interval_median_us": None}
    few = {key: None for key in ("chamfer", "gaussian", "rate_correlation", "map_correlation")}
    few |= {"real": nothing, "sim": nothing | {"events": 12_345}, "split_half": {"chamfer": None, "gaussian": None}}
    rows = event_operators.score_rows(few)
    assert ("Rate (Hz)", "none", "none", "", False) in rows, rows
    assert ("Events", "1", "12k", "12345.00", False) in rows, rows
    numbers = (0, 0.488, 2.917, 10.53, 1653, 342_100, 2_331_000, 45e6)
    texts = ["0", "0.49", "2.92", "10.5", "1653", "342k", "2.3M", "45M"]
    assert [event_operators._number(number) for number in numbers] == texts


def _renders_a_new_version(scene, folder):
    """Other settings are an error if the panel keeps what is there; or they are a new version."""
    scene.pecs.samples, scene.pecs.exists = 16, "continue"
    assert not background.state.offer_exists
    bpy.ops.pecs.render()
    message, is_error = ended()
    assert is_error and background.state.offer_exists and "differs in 'render.samples'" in message, message
    scene.pecs.exists = "new"
    again = folder / "scene_events/scene_002.stack"
    scene.pecs.layers = {"depth", "normal", "motion", "objects"}
    assert pressed("render") == f"{again}: rendered"
    assert (folder / "scene_events/scene.stack/stack.json").is_file() and paths.rendered(scene) == again
    assert "Show Depth" in drawn()
    for name in scene.pecs.layers:
        bpy.ops.pecs.show_layer(layer=name)
        image = bpy.data.images[f"PECS {name}"]
        pixels = np.reshape(image.pixels, (-1, 4))
        assert pixels.min() >= 0 and pixels.max() <= 1 and pixels[..., :3].std() > 0.02, name
        assert not image.is_dirty  # Blender does not ask whether to save it
    for threads in (AUTO["threads"][1], 0):
        bpy.ops.pecs.auto(owner="pecs", name="threads")
        assert scene.pecs.threads == threads
    pressed("sense")
    assert "scene_002.stack" in json.dumps(json.loads((folder / "scene_events/scene.npz.run.json").read_text()))


def _renders_what_is_in_memory(scene, folder):
    """Size and settings of the panel, unsaved; the file on the disk and the scene stay as they are."""
    before = Path(bpy.data.filepath).read_bytes()
    scene.pecs.exists, scene.render.resolution_x = "overwrite", WIDTH // 2
    bpy.ops.pecs.render()
    started = background.state.job.command
    assert any(background.COPIES in word and Path(word).exists() for word in started)
    assert not ended()[1], background.state.message
    assert json.loads((folder / "scene_events/scene.stack/stack.json").read_text())["width"] == WIDTH // 2
    assert Path(bpy.data.filepath).read_bytes() == before
    assert not any(background.COPIES in word and Path(word).exists() for word in started)
    scene.render.resolution_x, scene.pecs.samples = WIDTH, 2
    assert pressed("plan").startswith("Plan: ")
    assert {"Rendered", "Disk", "Memory"} <= set(drawn()) and "Measured with other settings" not in drawn()
    scene.pecs.samples = 3
    assert "Measured with other settings" in drawn()
    scene.pecs.samples = 2
    pressed("run")
    scene.pecs.exists = "continue"


def cube(folder):
    """From Blender's default cube, animated, to events over the viewport: three clicks, or four with the camera's view
    (support/window_acts.py)."""
    bpy.ops.wm.read_factory_settings()
    unsaved = paths.events(bpy.context.scene)
    assert unsaved == paths.events(bpy.context.scene) and any("is not saved" in text for text in drawn())
    bpy.ops.wm.read_factory_settings()  # File > New
    assert paths.events(bpy.context.scene) != unsaved  # none of the former file
    thing, scene = bpy.data.objects["Cube"], bpy.context.scene
    for frame, x in ((1, -0.7), (24, 0.7)):
        thing.location.x = x
        thing.keyframe_insert("location", frame=frame)
    scene.frame_end = 24
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "cube.blend"))
    bpy.ops.pecs.preset(filepath=str(PRESETS / "Quick_Look.py"))  # two
    assert not checks.problems(scene), checks.problems(scene)
    own = r"[\d.]+ % of them from the noise of the renderer \(camera's own noise: [\d.]+ %\)"  # which is larger
    assert re.search(own, pressed("run")) and "causes" not in background.state.message, background.state.message
    view = event_view.state.view
    covered = []
    for frame in (6, 12, 18):
        scene.frame_set(frame)
        events = view.picture(scene)[..., 3].sum(axis=0)
        above_noise = np.clip(events - np.median(events), 0, None) ** 2
        assert np.count_nonzero(above_noise) > 20, frame
        covered.append(np.average(np.arange(len(events)), weights=above_noise))
    assert covered == sorted(covered), covered  # as the cube moves
    image = bpy.data.images.new(event_view.IMAGE, 3, 2)  # of events of another size
    scene.frame_set(7)
    assert tuple(image.size) == (view.events.width, view.events.height) and not image.is_dirty
    bpy.ops.pecs.override_add("INVOKE_DEFAULT", name="contrast_threshold_on")  # a button of the panel Events
    assert [one.name for one in scene.pecs.sensor.overrides] == ["contrast_threshold_on"]
    assert "ON Threshold" in drawn() and "OFF Threshold" in drawn()


def wrong(folder):
    """The panel reports each mistake, and nothing hangs."""
    scene = scene_file(folder)

    def shown(part, is_error=True):
        texts = [one.text for one in checks.problems(scene) if one.is_error >= is_error]
        assert any(part in text for text in texts), (part, texts)
        assert part.split()[0] in "".join(drawn()), part  # long words are broken
        if is_error:
            assert texts[0].split("\n")[0][:30] in refused("render")

    assert not checks.problems(scene)
    _wrong_size_and_frames(scene, shown)
    _wrong_chip_and_lens(scene, shown, folder / "own.json")
    _wrong_options(scene, shown, folder)
    _wrong_device(scene, shown)
    wrong_parameters(scene)
    drawn()
    scene.camera = None
    shown("no camera")
    assert "no camera" in refused("match_lens")


def _wrong_size_and_frames(scene, shown):
    s = scene.pecs
    scene.render.resolution_x = 2000
    shown("2000 x 18 pixels exceed the chip's 1280 x 720")
    bpy.ops.pecs.chip_resolution()
    assert settings.size(scene) == (1280, 720) and not checks.problems(scene)
    s.frames = 100_000_000
    shown("exceed the maximum of 1,000,000")
    s.frames = 8
    s.whole_range, scene.frame_start, scene.frame_end = True, 5, 5
    scene.frame_start = 9  # Blender moves the end along
    assert scene.frame_end >= scene.frame_start
    s.whole_range = False


def _wrong_chip_and_lens(scene, shown, own):
    """own: a path for files of the user's."""
    import pecs

    s = scene.pecs
    own.write_text((pecs.data_dir("sensor/chips") / "davis346.json").read_text())
    s.chip = str(own)
    bpy.ops.pecs.chip_resolution()
    assert settings.size(scene) == (346, 260)
    own.unlink()
    shown(str(own))
    assert "own.json" in refused("sense") or "render the stack" in refused("sense")
    s.chip = "imx636"
    own.write_text((pecs.data_dir("lens_data/lenses") / "pecs_lab_15mm.json").read_text())
    s.lens = str(own)
    assert not checks.problems(scene)
    drawn()
    while frustum.fields.computing():
        time.sleep(0.01)
    assert any("15.02 mm f/4.15" in text for text in drawn()), drawn()
    found = settings.lenses(s, bpy.context, "Double Gauss")
    assert len(found) >= 2 and all(name and "double" in text.lower() and "° x " in text for name, text in found), found
    own.unlink()
    shown(str(own))
    s.lens, s.fnumber = "pecs_lab_15mm", 4.0
    assert s.fnumber == 0 and not checks.problems(scene)  # wide open


def _wrong_options(scene, shown, folder):
    s = scene.pecs
    s.device, checks._has_device = "CUDA", lambda kind: False
    shown("Cycles finds no CUDA device")
    checks._has_device = lambda kind: True
    shown("A lens requires the device CPU or OPTIX")
    s.device, s.lens, s.engine = "CPU", "none", "eevee"
    assert any(", EEVEE, 1 samples" in text for text in drawn()), drawn()
    s.engine, checks._has_denoiser = "cycles", lambda: False
    shown("This Blender was built without a denoiser")
    bpy.ops.pecs.keep_noise()
    assert s.no_denoise and not checks.problems(scene)
    s.no_denoise, checks._has_denoiser = False, lambda: True
    s.illuminant = "moonlight"
    shown("Lamp spectrum: moonlight: cannot be opened")
    s.illuminant, s.time, s.moving_px = "d65", "uniform", "5"
    shown("Moving region: got 5, wanted X0:Y0:X1:Y1")
    s.moving_px = "0:0:8:8"
    assert not checks.problems(scene) and settings.render_arguments(scene)[-2:] == ["--moving-px", "0:0:8:8"]
    s.time = "adaptive"
    assert "--moving-px" not in settings.render_arguments(scene)
    (folder / "file").write_text("")
    for name in ("file", "file/below"):
        s.output = str(folder / name)
        shown("is a file; choose a folder")
    s.output = "/proc/pecs"  # not writable, even for root
    bpy.ops.pecs.render()
    message, is_error = ended()
    assert is_error and message.startswith("/proc/pecs") and any("/proc/pecs" in text for text in drawn()), message
    s.output = ""


def _wrong_device(scene, shown):
    s = scene.pecs
    cycles = bpy.context.preferences.addons["cycles"].preferences
    cycles.compute_device_type = "CUDA"
    shown("Cycles' preferences select CUDA", is_error=False)
    s.lens = "pecs_lab_15mm"  # which needs OptiX
    assert not checks.problems(scene)
    s.lens = "none"
    bpy.ops.pecs.use_gpu()
    assert s.device == "CUDA" and not checks.problems(scene)
    s.device, cycles.compute_device_type = "CPU", "NONE"


def wrong_parameters(scene):
    s = scene.pecs
    one = s.sensor.overrides.add()
    one.name, one.value = "contrast_threshold_on", "much"
    assert "got 'much', wanted a number in [0.01, 2]" in checks.sensor_problems(scene)[0].text
    one.name, one.value = "log_eps", "0.002"
    assert checks.sensor_problems(scene)
    s.sensor.model = "esim"
    assert not checks.sensor_problems(scene) and settings.sensor_arguments(scene)[-2:] == ["--param", "log_eps=0.002"]


def busy(folder):
    """While a job runs: a second one, the camera gone, the file elsewhere, Blender gone."""
    scene = scene_file(folder)
    scene.pecs.frames, scene.pecs.fps = 500, 1000.0
    bpy.ops.wm.save_mainfile()
    bpy.ops.pecs.render()
    job = background.state.job
    assert "A job is running" in refused("render") and "A job is running" in refused("sense")
    assert any("Starting Blender" in text for text in drawn())
    bpy.data.objects.remove(scene.camera)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "elsewhere.blend"))
    while job.step.startswith(("Starting", "Motion", "Image 1 ")):
        assert background.poll() == background.POLL_S
        time.sleep(0.02)
    assert any(re.match(r"Image \d+ of \d+, [\d:]+ left", text) for text in drawn()), drawn()
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))  # another file: it goes on
    assert background.poll() == background.POLL_S and background.state.job is job
    bpy.ops.pecs.stop()
    assert job.text == "Render Stack: stopping"
    message, is_error = ended()
    assert message.startswith("Stopped at") and not is_error, message
    done = len(list((folder / "scene_events/scene.stack").glob("frame_*.exr")))
    assert 0 < done < 500
    # Blender ends: so does the job
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    bpy.ops.pecs.render()
    process = background.state.job._process
    ui.unregister()
    assert process.wait(60) in background.STOPPED
    ui.register()


def killed(folder):
    """Starts a job, then kills this Blender; the parent process looks at the job."""
    scene = scene_file(folder)
    scene.pecs.frames, scene.pecs.fps = 500, 1000.0
    bpy.ops.wm.save_mainfile()
    popen, options = subprocess.Popen, {}
    background.subprocess.Popen = lambda *words, **given: options.update(given) or popen(*words, **given)
    bpy.ops.pecs.render()
    assert "preexec_fn" not in options  # may deadlock, since Blender has threads
    (folder / "pid").write_text(str(background.state.job._process.pid))
    os.kill(os.getpid(), signal.SIGKILL)


def widths(folder):
    """No text is cut at the default width of Blender's properties."""
    scene = scene_file(folder)
    modules = (import_module(f"{ui.__name__}.{name}") for name in ("panel", "live_panel"))
    panels = [cls for module in modules for cls in ui.classes(module) if issubclass(cls, bpy.types.Panel)]
    panels = [cls for cls in panels if getattr(cls, "bl_context", "render") in ("render", "data")]
    s = scene.pecs
    plan = {"frames": 12_345, "of": 123_456, "each_s": 7.0, "disk_bytes": 123e9, "memory_bytes": 12.3e9}
    background.state.plan[scene.name] = plan | {"settings": []}
    spread = {"median": 1234.0, "p5": 123.4, "p95": 12_345.0}
    light = dict.fromkeys(("lux", "luminance_cd_m2", "corner_hz"), spread) | {"light_scale": 1.0, "events_per_s": 1e7}
    light["events_over_s"] = 0.1
    light |= {"photocurrent_a": {name: value * 5.678e-17 for name, value in spread.items()}, "noise_thresholds": 0.123}
    background.state.light[scene.name] = light | {"settings": []}
    one = {"events": 342_000, "rate_hz": 2.33e6, "on_fraction": 0.488, "interval_median_us": 1653}
    scores = {"real": one, "sim": one, "split_half": {"chamfer": 2.92, "gaussian": 1.72}, "window_us": 146_800}
    rest = {"chamfer": 3.1, "gaussian": 1.9, "rate_correlation": 0.98, "map_correlation": 0.97}
    background.state.scores = scores | rest | {"recording": "cube.raw"}
    for is_set in (False, True):
        s.lens, s.time = ("angenieux_100mm_f1p1", "uniform") if is_set else (s.lens, "adaptive")
        s.sensor.afk, s.sensor.trail = ("stop", "trail") if is_set else ("none", "none")
        for one in (s.sensor, s):
            for name in set(AUTO) & set(one.bl_rna.properties.keys()):
                setattr(one, name, AUTO[name][1] if is_set else 0)
        found = cut(panels, bpy.context)
        assert not found, found


def registered(_folder):
    """Registering a hundred times leaves nothing behind."""

    def there():
        found = set(dir(bpy.types)) | {f"bpy.ops.pecs.{name}" for name in dir(bpy.ops.pecs)}
        for name in dir(bpy.app.handlers):
            handlers = getattr(bpy.app.handlers, name)
            found |= {f"{name}: {h!r}" for h in handlers} if isinstance(handlers, list) else set()
        for kind in (bpy.types.Scene, bpy.types.Material, bpy.types.Light, bpy.types.World, bpy.types.WindowManager):
            found |= {f"{kind.__name__}.{name}" for name in kind.bl_rna.properties.keys()}
        for kind in (bpy.types.TOPBAR_MT_render, bpy.types.STATUSBAR_HT_header):
            found |= {f"{kind.__name__} draws {f!r}" for f in kind._dyn_ui_initialize()}
        for keymap in bpy.context.window_manager.keyconfigs.addon.keymaps:
            found |= {f"{keymap.name}: {item.type}" for item in keymap.keymap_items if item.idname.startswith("pecs.")}
        return found | {f"manual {f!r}" for f in bpy.utils._manual_map} | {*bpy.utils.preset_paths("pecs")}

    with_us = there()
    ui.unregister()
    before = there()
    assert {"Property Editor: ESC", "Screen: F12", "Scene.pecs", "PECS_PT_render"} <= with_us - before
    for _ in range(100):
        ui.register()
        ui.unregister()
    assert there() == before, there() ^ before
    assert not bpy.app.timers.is_registered(background.poll)
    ui.register()
    assert there() == with_us


def saved(folder):
    """A .blend of PECS opens without us as it was, and again with us."""
    scene = scene_file(folder)
    scene.pecs.lens, scene.pecs.sensor.seed = "pecs_lab_15mm", 7
    scene.pecs.sensor.overrides.add().name = "noise_std"
    one, light = bpy.data.materials["red"], bpy.data.lights[0]
    one.pecs_reflectance_field, one.pecs_glass_field, light.pecs_spectrum_field = "macbeth", "55.5", "blackbody:2856"
    assert one["pecs_reflectance"] == "macbeth" and one["pecs_glass"] == 55.5 and one.pecs_glass_field == "55.5"
    one.pecs_emission_field = "a"
    one.pecs_emission_field = ""
    assert "pecs_emission" not in one
    one.pecs_reflectance_field = "colorchecker/red"
    context = SimpleNamespace(material=one, light=light, world=None)
    for cls, kind in ((ui.panel_spectra.PECS_PT_material, "material"), (ui.panel_spectra.PECS_PT_lamp, "data")):
        assert cls.poll(context)
        cls.draw(SimpleNamespace(layout=Layout([]), bl_context=kind), context)
    path = folder / "scene.blend"
    bpy.ops.wm.save_mainfile()
    ui.unregister()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert not hasattr(bpy.context.scene, "pecs") and not hasattr(bpy.data.materials["red"], "pecs_reflectance_field")
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.render.filepath = "CYCLES", 1, str(folder / "plain.png")
    bpy.ops.render.render(write_still=True)  # a plain camera
    assert (folder / "plain.png").stat().st_size > 100
    bpy.ops.wm.open_mainfile(filepath=str(path))
    bpy.ops.wm.save_mainfile()
    ui.register()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    s, one = bpy.context.scene.pecs, bpy.data.materials["red"]
    assert (s.lens, s.sensor.seed, s.frames, s.sensor.overrides[0].name) == ("pecs_lab_15mm", 7, 8, "noise_std")
    assert one.pecs_reflectance_field == "colorchecker/red" and one["pecs_glass"] == 55.5
    assert bpy.data.lights[0].pecs_spectrum_field == "blackbody:2856"
    # copied with the scene, keyframed, undone
    bpy.ops.scene.new(type="FULL_COPY")
    assert bpy.context.scene.pecs.sensor.seed == 7
    assert bpy.context.scene.keyframe_insert("pecs.light_scale", frame=1)


def one_group_is_open():
    """At most 12 controls are in view at first: those of the panel and of its one open group."""
    panels = [cls for cls in ui.classes(panel) if getattr(cls, "bl_parent_id", "") == "PECS_PT_render"]
    assert [cls.__name__ for cls in panels if "DEFAULT_CLOSED" not in getattr(cls, "bl_options", ())] == [
        "PECS_PT_camera"
    ]
    controls = []

    class Counting(Layout):
        def menu(self, name, **words):
            controls.append(name)

        def prop(self, data, name, **words):
            controls.append(name)

        def operator(self, name, text="", **words):
            controls.append(name)
            return SimpleNamespace()

        def row(self, **words):
            return Counting(self.texts)

        box = column = split = row

    fake = SimpleNamespace(layout=Counting([]))
    fake.fill = lambda *words: panel.PECS_PT_camera.fill(fake, *words)
    panel.PECS_PT_camera.draw(fake, bpy.context)
    panel.PECS_PT_render.draw(fake, bpy.context)
    assert "PECS_MT_chip" in controls and "pecs.run" in controls and len(controls) <= 12, controls


def presets(folder):
    """Those that ship do what they say; one's own is kept."""
    scene = scene_file(folder)
    one_group_is_open()
    scene.pecs.lens = "pecs_lab_15mm"
    one_group_is_open()
    assert "UNDO" in ui.presets.PECS_OT_preset.bl_options
    for file in PRESETS.glob("*.py"):
        scene.pecs.sensor.overrides.add()
        bpy.ops.pecs.preset(filepath=str(file))  # as the menu does
        assert (scene.pecs.whole_range, scene.pecs.time, len(scene.pecs.sensor.overrides)) == (True, "adaptive", 0)
        assert not checks.problems(scene), (file, checks.problems(scene))
    s = scene.pecs
    s.lens, s.film_shift_mm, s.layers, s.sensor.model = "pecs_lab_15mm", (0.5, 0.25), {"depth", "motion"}, "esim"
    bpy.ops.pecs.override_add(name="log_eps")
    bpy.ops.pecs.preset_add(name="mine")
    (own,) = (p for p in map(Path, bpy.utils.preset_paths("pecs")) if (p / "mine.py").is_file())
    s.lens, s.film_shift_mm, s.layers, s.sensor.model = "none", (0, 0), set(), "pecs"
    s.sensor.overrides.clear()
    bpy.ops.pecs.preset(filepath=str(own / "mine.py"))
    assert (s.lens, tuple(s.film_shift_mm), s.sensor.model) == ("pecs_lab_15mm", (0.5, 0.25), "esim")
    assert s.layers == {"depth", "motion"} and s.sensor.overrides[0].name == "log_eps"
    # the camera sees as the lens does
    bpy.ops.pecs.match_lens()
    seen = settings.lens_now(scene)["hfov_deg"]
    assert abs(scene.camera.data.angle_x * 180 / 3.141592653589793 - seen) < 0.01


def main(act, folder):
    ui.register()
    assert panel.PECS_PT_render.bl_rna
    globals()[act](Path(folder))
