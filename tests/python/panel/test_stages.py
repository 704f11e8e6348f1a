"""Biases, digital stages, published settings and fitted chips of the panel become the options of `pecs sense`."""

from support import ROOT, in_bpy

BODY = """
import json, sys
from pathlib import Path
from types import SimpleNamespace
import bpy
import pecs
from pecs_blender import ui
from pecs_blender.ui import checks, library, menus, presets, settings
from support.panel_acts import Layout

ui.register()
sensor = bpy.context.scene.pecs.sensor

def words():
    found = settings.sensor_arguments(bpy.context.scene)
    return " ".join(found[found.index("--readout") + 2 :])

assert words() == ""
sensor.diff_on, sensor.diff_off = 35, -10
assert words() == "--bias diff_on=35,diff_off=-10"
sensor.diff_on = sensor.diff_off = 0
sensor.afk, sensor.trail, sensor.trail_ms, sensor.erc_mhz, sensor.mask = "stop", "stc-keep", 2.5, 20, "/tmp/m.txt"
assert words() == "--afk 50:520 --stc-keep 2.5ms --erc 20MHz --mask /tmp/m.txt"
sensor.afk, sensor.afk_low_hz, sensor.afk_high_hz, sensor.trail = "pass", 90, 110, "trail"
assert words() == "--afk-pass 90:110 --trail 2.5ms --erc 20MHz --mask /tmp/m.txt"

def model_words():
    found = settings.sensor_arguments(bpy.context.scene)
    return " ".join(found[2:])

sensor.afk, sensor.trail, sensor.erc_mhz, sensor.mask = "none", "none", 0, ""
bpy.ops.pecs.use_preset(name="v2e_noisy")
assert sensor.model == "v2e" and model_words() == "--preset v2e_noisy"
sensor.model = "esim"  # which the setting does not use
assert sensor.preset == "" and model_words() == "--model esim --readout chip"
bpy.ops.pecs.use_preset(name="v2e_noisy")
sensor.model = "v2e"
assert sensor.preset == "v2e_noisy"
bpy.ops.pecs.use_preset()
assert model_words() == "--model v2e --readout chip"
texts = []
menus.PECS_MT_preset.draw(SimpleNamespace(layout=Layout(texts)), bpy.context)
assert any("ESIM for the training data of Stoffregen" in text for text in texts), texts

# A profile that `pecs fit` wrote into the folder of own chips
own = Path(sys.argv[1])
fitted = json.loads((pecs.data_dir("sensor/chips") / "davis346.json").read_text())
(own / "my_camera.json").write_text(json.dumps(fitted | {"description": "My DAVIS, fitted"}))
library.own_folder = lambda kind: own
(own / "singlet.zmx").write_bytes((Path(sys.argv[2]) / "tests/lens/lenses/singlet.zmx").read_bytes())
assert "singlet.zmx" in dict(library.names("lens"))
assert 0 < library.lens_info("singlet.zmx", film_width_mm=4.0)["hfov_deg"] < 90
texts = []
menus.PECS_MT_chip.draw(SimpleNamespace(layout=Layout(texts)), bpy.context)
assert "My DAVIS" in texts and texts[-1] == "Fit My Camera", texts
scene = bpy.context.scene
scene.pecs.chip = "my_camera"
bpy.ops.pecs.chip_resolution()
assert settings.size(scene) == (346, 260) and not checks.sensor_problems(scene)
# Its frames: in an AEDAT4 file, else in a new folder; not of a chip that takes none
assert not settings.frames_arguments(scene, own / "e.raw")
auto = sensor.overrides.add()
auto.name, auto.value = "frame_auto_mean", "0.5"
assert "no effect without chip_frames" in checks.sensor_problems(scene)[0].text
sensor.chip_frames = True
assert not checks.sensor_problems(scene) and "frame_auto_mean=0.5" in settings.sensor_arguments(scene)
sensor.overrides.clear()
assert settings.frames_arguments(scene, own / "e.aedat4") == ["--frames", str(own / "e.aedat4")]
assert settings.frames_arguments(scene, own / "e.raw") == ["--frames", str(own / "e_frames")]
sensor.output, scene.pecs.sensor.format = str(own / "e.raw"), "auto"
assert not checks.sensor_problems(scene)
(own / "e_frames").mkdir()
library.disk.forget()
assert "e_frames: exists" in checks.sensor_problems(scene)[0].text
scene.pecs.chip = "imx636"
assert not settings.frames_arguments(scene, own / "e.raw") and not checks.sensor_problems(scene)
scene.pecs.chip = "my_camera"
words = settings.render_arguments(scene)
assert words[words.index("--chip") + 1] == str(own / "my_camera.json")
assert menus._page("fit_camera").name == "fit_camera.md" and menus._page("fit_camera").is_file()

assert all(hasattr(sensor, key) for key in presets._SENSOR_KEYS)
"""


def test_the_panel_gives_options_of_the_program(tmp_path):
    in_bpy(BODY, tmp_path, ROOT)
