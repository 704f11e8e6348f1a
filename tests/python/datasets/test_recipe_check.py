"""What is known when a recipe is read is known then: `--plan` of a recipe that cannot be made fails."""

import re
import shutil
from functools import partial

import pecs
import pytest
from pecs.datasets import blender, recipe, recipe_check
from pecs.datasets.plan import Plan
from support import ROOT, run_module
from support.faults import refused

dataset = partial(run_module, "pecs.datasets", check=False)
RECIPE = f"""
name = "t"
duration_s = [0.1, 0.2]
export = ["dsec", "radiance"]
[[scene]]
path = "{ROOT}/scenes/rotating_disk"
[scene.set]
rpm = {{log = [100, 1000]}}
[scene.options]
bands = 3
[scene.trajectory]
kind = "hand_held"
speed_m_per_s = [0.2, 1.0]
volume = [[-0.2, -3.3, -0.1], [0.2, -2.9, 0.1]]
[rig.imu]
part = "ideal"
[[rig.camera]]
name = "left"
kind = "events"
chip = "imx636"
width = 128
height = 96
lens = "cmount_8mm_f2p8"
fnumber = [4, 8]
focus_m = [1, 3]
partner = "right"
[rig.camera.set]
threshold_mismatch = [0.02, 0.03]
[rig.camera.bias]
diff_on = [0, 20]
[rig.camera.stages]
stc_us = 1000
roi = [[0, 0, 100, 90]]
[[rig.camera]]
name = "right"
kind = "events"
chip = "davis346"
lens = "cmount_8mm_f2p8"
fnumber = 4
focus_m = 2
position_m = [0.1, 0, 0]
partner = "left"
[[rig.camera]]
name = "film"
kind = "rgb"
pixels_of = "left"
[render]
samples = 4
fps = 200
time = "uniform"
[truth]
fps = 20
layers = ["depth"]
"""


def write(tmp_path, old="", new="", text=RECIPE):
    assert old in text
    path = tmp_path / "r.toml"
    path.write_text(text.replace(old, new, 1) if old else text)
    return path


def test_a_good_recipe(tmp_path):
    recipe_check.check(Plan(recipe.load(write(tmp_path))))
    done = dataset(write(tmp_path), "-o", tmp_path / "set", "--plan")
    assert done.returncode == 0 and "1 sequence, " in done.stdout, done.stderr
    assert not (tmp_path / "set").exists()


def test_the_plan_of_a_million_sequences(tmp_path):
    """It draws evenly spaced ones; the numbers are those of all, within a percent of a thousand times a thousand."""
    path, counts = write(tmp_path), []
    for number in (999, 1_000_000):
        done = dataset(path, "-o", tmp_path / "set", "--plan", "--sequences", number, timeout=60)
        assert done.returncode == 0 and f"… and {number - 20} more" in done.stdout, done.stderr
        said = re.search(
            rf"{number} sequences, .* at (about )?(\d+) instants, light at all of (about )?(\d+)", done.stdout
        )
        assert bool(said[1]) == bool(said[3]) == (number > 1000)
        counts.append([int(said[2]) / number, int(said[4]) / number])
    assert counts[0] == pytest.approx(counts[1], rel=0.01)


WRONG = [
    ("width = 128", "width = 4000", "rig.camera left: "),
    ('partner = "left"\n', "", "rig.camera left.partner: got right, wanted a camera of the same kind whose partner"),
    ('kind = "events"\nchip = "davis346"\nlens = "cmount_8mm_f2p8"\nfnumber = 4\n',
     'kind = "rgb"\npixel_pitch_um = 5\nwidth = 64\nheight = 48\nlens = "cmount_8mm_f2p8"\nfnumber = 4\n',
     "rig.camera left.partner: got right, wanted a camera of the same kind"),
    ("position_m = [0.1, 0, 0]\n", "", "left.partner: got right, wanted a camera at another position_m"),
    ("position_m = [0.1, 0, 0]\n", "position_m = [0, 0, 0.1]\n",
     "left.partner: got a view 90 degrees from the perpendicular to the baseline, wanted at most 60"),
    ("position_m = [0.1, 0, 0]\n", "position_m = [0.1, 0, 0]\nrotation_deg = [0, 180, 0]\n", "left.partner: got a vie"),
    ('chip = "imx636"', 'chip = "nosuch"', "rig.camera left: nosuch"),
    ("threshold_mismatch = [0.02, 0.03]", "threshold_mismatch = [0.02, 300]", "threshold_mismatch"),
    ("threshold_mismatch = [0.02, 0.03]", "nosuch = 1", "rig.camera left: --set nosuch=1.0: got an unknown key"),
    ("diff_on = [0, 20]", "diff_on = [0, 20000]", "rig.camera left: "),
    ('chip = "imx636"', 'chip = "imx636"\nframes = true', "rig.camera left: chip_frames: got chip imx636, wanted one"),
    ("stc_us = 1000", "stc_us = -5", "rig.camera left: "),
    ("roi = [[0, 0, 100, 90]]", "roi = [[0, 0, 0, 0]]", "rig.camera left: "),
    ("stc_us = 1000", 'mask = "nosuch.txt"', "rig.camera left: nosuch.txt"),
    ('lens = "cmount_8mm_f2p8"', 'lens = "nosuch"', "rig.camera left: nosuch"),
    ("fnumber = [4, 8]", "fnumber = [0.6, 8]", "rig.camera left: "),
    ('part = "ideal"', 'part = "nosuch"', "rig.imu: imu: got part 'nosuch'"),
    ('kind = "hand_held"', 'kind = "nosuch"', "scene rotating_disk.trajectory.kind: got nosuch, wanted drone"),
    ('kind = "hand_held"', "kind = 5", "scene rotating_disk.trajectory.kind: got 5"),
    ("volume = [[-0.2, -3.3, -0.1], [0.2, -2.9, 0.1]]", "volume = []", "trajectory: hand_held: volume: got []"),
    ("volume = [[-0.2, -3.3, -0.1], [0.2, -2.9, 0.1]]", "volume = [[nan, 0, 0], [1, 1, 1]]", "hand_held: volume: got"),
    ("volume = [[-0.2, -3.3, -0.1], [0.2, -2.9, 0.1]]", "", "trajectory: hand_held: got neither volume nor waypoints"),
    ("speed_m_per_s = [0.2, 1.0]", "speed_m_per_s = nan", "speed_m_per_s"),
    ("speed_m_per_s = [0.2, 1.0]", "speed_m_per_s = [0.2, 1000]", "hand_held: speed_m_per_s: got 1000"),
    ("speed_m_per_s = [0.2, 1.0]", "sped = 1", "hand_held: sped: got an unknown key"),
    ("duration_s = [0.1, 0.2]", "duration_s = [0.1, nan]", "duration_s"),
    ("samples = 4", "samples = 0", "--samples"),
    ("samples = 4", 'device = "NOSUCH"', "--device"),
    ('time = "uniform"', 'time = "nosuch"', "--time"),
    ("fps = 200", "fps = nan", "--fps"),
    ("fps = 200", 'fps = "1000; x"', "--fps"),
    ("bands = 3", "bands = 0", "--bands"),
    ("samples = 4", "allow_scripts = true", "render.allow_scripts: got a permission in the recipe, wanted the flag"),
    ("bands = 3", "allow_scripts = true", "options.allow_scripts: got a permission in the recipe"),
    ("[rig.camera.bias]", "[rig.camera.options]\nallow_scripts = false\n[rig.camera.bias]",
     "options.allow_scripts: got a permission in the recipe"),
    ('layers = ["depth"]', 'layers = ["nosuch"]', "--layers: got 'nosuch'"),
    ("rpm =", "nosuch =", "--set nosuch="),
    ("{log = [100, 1000]}", "{log = [100, 1e30]}", "rpm"),
    (f'path = "{ROOT}/scenes/rotating_disk"', 'path = "/etc/passwd"', "scene passwd.path: got /etc/passwd"),
    (f'path = "{ROOT}/scenes/rotating_disk"', f'path = "{ROOT}/scenes"', "wanted a .blend file, or a folder"),
    ('pixels_of = "left"', 'pixel_pitch_um = 5\nwidth = 64\nheight = 48\nlens = "cmount_8mm_f2p8"',
     "export: got radiance, wanted an RGB camera whose pixels_of is an event camera"),
    ('name = "right"', 'name = "LEFT"', "the name"),
    ('name = "film"', f'name = "{"n" * 300}"', "at most 100 bytes"),
    ('name = "t"', 'name = "a\\nb"', "name: got"),
    ('name = "t"', 'name = "a\\u0000b"', "name: got"),
    ('kind = "hand_held"', 'kind = "recorded"\nfile = "nosuch.txt"', "nosuch.txt"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line"), WRONG)
def test_what_cannot_be_made_is_known_when_the_recipe_is_read(old, new, line, tmp_path):
    text = RECIPE if "kind = " not in old or "recorded" not in new else re.sub("speed_m.*\nvolume.*\n", "", RECIPE)
    path = write(tmp_path, old, new, text)
    with pytest.raises(pecs.PecsError) as error:
        recipe_check.check(Plan(recipe.load(path)))
    said = str(error.value)
    assert line in said and said.startswith(f"{path}: ") and "\n" not in said and error.value.code in (3, 4, 6), said


def test_plan_of_a_wrong_recipe_fails_and_writes_nothing(tmp_path):
    path = write(tmp_path, "stc_us = 1000", "stc_us = -5")
    for words in ((), ("--plan",), ("--only", 0), ("--repair",)):
        refused(dataset(path, "-o", tmp_path / "set", *words), 4, "r.toml: rig.camera left: ")
    assert [p.name for p in tmp_path.iterdir()] == ["r.toml"]


def test_a_scene_folder_of_others_needs_the_flag(tmp_path):
    """It contains Python; a recipe gives no permission to run it."""
    shutil.copytree(ROOT / "scenes/rotating_disk", tmp_path / "own")
    path = write(tmp_path, f'path = "{ROOT}/scenes/rotating_disk"', 'path = "own"')
    refused(dataset(path, "-o", tmp_path / "set", "--plan"), 6, "own contains Python; --allow-scripts runs it")
    assert dataset(path, "-o", tmp_path / "set", "--plan", "--allow-scripts").returncode == 0


def test_the_flag_reaches_the_renderer(tmp_path):
    import dataclasses

    found = dataclasses.replace(recipe.load(write(tmp_path)), allow_scripts=True)
    sequence = Plan(found).sequence(0)
    assert sequence.light(sequence.cameras[0])["allow_scripts"] is True
    assert not recipe.load(write(tmp_path)).allow_scripts


def test_without_a_renderer_the_rest_is_checked(monkeypatch):
    monkeypatch.setenv("PECS_BLENDER_PYTHON", "/usr/bin/false")
    assert blender.fault_of([["render"]]) == ""
