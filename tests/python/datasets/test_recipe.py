"""Recipes: what is drawn of them, and what is refused in one line."""

import re

import numpy as np
import pecs
import pytest
from pecs.datasets import recipe, recipe_check
from pecs.datasets.plan import Plan
from pecs.datasets.table import Table
from support import ROOT

RECIPE = """
name = "t"
seed = 3
sequences = 4
duration_s = [0.1, 0.2]
[split]
train = 0.75
test = 0.25
[[scene]]
path = "ROOT/scenes/rotating_disk"
[scene.set]
rpm = {log = [10, 1000]}
wall_reflectance = {choice = [0.1, 0.2]}
lamp_spectrum = {choice = ["led_b1", "led_b3"]}
[scene.trajectory]
kind = "still"
[[rig.camera]]
name = "left"
kind = "events"
chip = "davis346"
lens = "cmount_8mm_f2p8"
fnumber = [4, 8]
[rig.camera.set]
contrast_threshold_on = {normal = [0.2, 0.05], range = [0.1, 0.3]}
[[rig.camera]]
name = "film"
kind = "rgb"
pixels_of = "left"
exposure_ms = [1, 2]
"""


@pytest.fixture
def load(tmp_path):
    def run(text=RECIPE, **changes):
        for old, new in changes.get("replace", {}).items():
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "r.toml"
        path.write_text(text.replace("ROOT", str(ROOT)))
        return recipe.load(path)

    return run


def draws(found, count=50):
    return [Plan(found).sequence(i).drawn for i in range(count)]


def test_each_value_has_a_generator_of_its_own(load):
    before = draws(load())
    assert before == draws(load())
    longer = load(replace={"sequences = 4": "sequences = 999", "exposure_ms = [1, 2]": "exposure_ms = [3, 4]"})
    for a, b in zip(before, draws(longer), strict=True):
        assert a["parameters"] == b["parameters"] and a["cameras"]["left"] == b["cameras"]["left"]
        assert a["cameras"]["film"]["exposure_ms"] < 2.5 < b["cameras"]["film"]["exposure_ms"]
    other = load(replace={"seed = 3": "seed = 4"})
    assert draws(other, 1)[0]["parameters"] != before[0]["parameters"]


def test_rules_cover_their_ranges(load):
    found = draws(load(), 400)
    rpm = np.log([d["parameters"]["rpm"] for d in found])
    share = np.histogram(rpm, bins=4, range=np.log((10, 1000)))[0]
    assert share.sum() == 400 and share.min() > 70
    on = np.array([d["cameras"]["left"]["overrides"]["contrast_threshold_on"] for d in found])
    assert (0.1 <= on).all() and (on <= 0.3).all() and abs(on.mean() - 0.2) < 0.01 and 0.03 < on.std() < 0.05
    assert {d["parameters"]["lamp_spectrum"] for d in found} == {"led_b1", "led_b3"}
    assert {d["parameters"]["wall_reflectance"] for d in found} == {0.1, 0.2}


@pytest.mark.parametrize("count", [4, 8, 100])
def test_splits_are_even_for_any_number(load, count):
    splits = [drawn["split"] for drawn in draws(load(), count)]
    assert abs(splits.count("train") - 0.75 * count) <= 1.5 and splits.count("val") == 0


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("seed = 3", "sed = 3", "sed: got an unknown key, wanted one of"),
        ("seed = 3", "seed = -1", "seed: got -1, wanted a whole number >= 0"),
        ("duration_s = [0.1, 0.2]", "duration_s = [0.2, 0.1]", "duration_s: got [0.2, 0.1], wanted a number"),
        ("rpm = {log = [10, 1000]}", "rpm = {log = [0, 1000]}", "low above 0"),
        ("rpm = {log = [10, 1000]}", "rpm = {lug = [1, 1000]}", 'scene[0].set.rpm: got {"lug": [1, 1000]}, wanted'),
        ("rpm = {log = [10, 1000]}", "rpm = nan", "rpm: got NaN, wanted"),
        ("scenes/rotating_disk", "scenes/no_such", "a .blend file or a scene folder that is there"),
        ('name = "film"', 'name = "left"', "the name 'left' twice"),
        ('name = "film"', 'name = "../x"', "wanted letters, digits, _ and -"),
        ('pixels_of = "left"', 'pixels_of = "lift"', "got lift, wanted the name of another camera of the rig"),
        ('kind = "rgb"\npixels_of = "left"', 'kind = "rgb"', "pixel_pitch_um: got nothing, wanted"),
        ('pixels_of = "left"', 'pixels_of = "left"\nwidth = 64', "rig.camera[1].width: got an unknown key"),
        ('pixels_of = "left"', 'pixels_of = "left"\nposition_m = [1, 0, 0]', "position_m: got an unknown key"),
        ("exposure_ms = [1, 2]", "exposure_ms = [1, 2]\n[rig.camera.set]\na = 1", "rig.camera[1].set: got an unknown"),
        ("exposure_ms = [1, 2]", 'exposure_ms = [1, 2]\npreset = "v2e_noisy"', "preset: got an unknown key"),
        ('kind = "still"', "", "trajectory: got nothing, wanted a table with kind"),
        ("train = 0.75", "train = 0.75\nholdout = 1", "split.holdout: got an unknown key"),
        ("[split]\ntrain = 0.75\ntest = 0.25", "[split]\ntrain = 0", "no share above 0"),
        ("[[rig.camera]]", "[rig.camera]", "wanted"),
        ("name = ", "name : ", "wanted valid TOML"),
    ],
)
def test_what_is_wrong_is_one_line(load, old, new, line):
    with pytest.raises(pecs.PecsInputError) as error:
        load(replace={old: new})
    assert line in str(error.value) and "r.toml" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("key", ["wall_reflectance", "lamp_spectrum", "rpm"])
@pytest.mark.parametrize(
    "rule", ["{choice = 5}", '{choice = "x"}', "{choice = []}", '{choice = [1, "x"]}', "{normal = 1, range = [0, 1]}"]
)
def test_a_wrong_rule_is_one_line(load, key, rule):
    with pytest.raises(pecs.PecsInputError, match=f"scene\\[0\\].set.{key}: got "):
        load(re.sub(f"{key} = .*", f"{key} = {rule}", RECIPE))


def test_a_wrong_choice_of_the_trajectory_is_one_line(load):
    with pytest.raises(pecs.PecsInputError, match=r"trajectory.kind: got {\"choice\": 5}"):
        load(replace={'kind = "still"': "kind = {choice = 5}"})


@pytest.mark.parametrize(
    ("mean", "sd", "low", "high"), [(0.5, 1e6, 0, 1), (0, 1, 0, 1), (1, 0, 1, 1), (0.9, 0.3, 0, 1)]
)
def test_a_normal_rule_is_a_truncated_normal_distribution(mean, sd, low, high):
    """With any sd, and without an endless draw."""
    from scipy.stats import kstest, truncnorm

    value = Table({"x": {"normal": [mean, sd], "range": [low, high]}}, "f").value("x")
    draws = [value.draw(np.random.default_rng(i)) for i in range(1000)]
    if sd:
        truth = truncnorm((low - mean) / sd, (high - mean) / sd, mean, sd)
        assert kstest(draws, truth.cdf).pvalue > 1e-3
    assert low <= min(draws) and max(draws) <= high


def test_layers_of_the_truth_are_the_renderer_s(load):
    assert load(RECIPE + '[truth]\nlayers = ["depth", "albedo"]').truth.layers == ["depth", "albedo"]


@pytest.mark.parametrize("fps", [7, 30, 300, 1000, 1500])
def test_the_path_goes_to_the_last_instant(load, fps):
    """The renderer refuses instants that the camera path does not cover. Without truth, the length is as drawn."""
    sequence = Plan(load(RECIPE + f"[render]\nfps = {fps}\n[truth]\nlayers = []")).sequence(0)
    (_, end), *_ = reversed(sequence.ranges(sequence.cameras[0]))
    _, parameters = sequence.path
    covered_s = parameters["duration_s"] - 1 / max(1000, fps)
    assert (end - 1) / fps <= covered_s and (end - 1) / fps >= sequence.duration_s - 1e-9


def test_no_recipe(tmp_path):
    with pytest.raises(pecs.PecsNotFoundError, match="no.toml"):
        recipe.load(tmp_path / "no.toml")
    (tmp_path / "no.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(pecs.PecsInputError, match="UTF-8"):
        recipe.load(tmp_path / "no.toml")


def test_mutants_are_read_or_refused_in_one_line(load):
    """500 of them: no other exception."""
    rng = np.random.default_rng(8)
    words = re.findall(r"[^\s]+|\s+", RECIPE)
    refused = 0
    for _ in range(500):
        mutant = list(words)
        for _ in range(rng.integers(1, 4)):
            i = int(rng.integers(len(mutant)))
            mutant[i] = rng.choice(["", "[]", "{}", "nan", "-1", "1e400", '"x"', "[[1]]", "true", "=", mutant[i] * 2])
        try:
            draws(load("".join(mutant)), 1)
        except pecs.PecsError as e:
            refused += 1
            assert "\n" not in str(e) and e.code in (3, 4), e
    assert refused > 250


def test_biases_are_drawn_and_stages_are_kept(load, tmp_path):
    tables = """[rig.camera.bias]
diff_on = [0, 35]
[rig.camera.stages]
stc_us = 10000
afk_hz = [50, 520]
mask = "bad.txt"
[[rig.camera]]
name = "film\""""
    found = load(replace={'[[rig.camera]]\nname = "film"': tables})
    drawn = [drawn["cameras"]["left"]["biases"]["diff_on"] for drawn in draws(found, 4)]
    assert len(set(drawn)) == 4 and all(0 <= value <= 35 for value in drawn)
    stages = {"stc_us": 10000, "afk_hz": [50, 520], "mask": "bad.txt"}
    assert found.cameras[0].stages == stages and not found.cameras[1].stages
    with pytest.raises(pecs.PecsInputError, match="stc: got an unknown stage"):
        load(replace={'[[rig.camera]]\nname = "film"': tables.replace("stc_us", "stc")})


def test_a_preset_sets_the_model(load):
    chip = 'chip = "davis346"'
    camera = load(replace={chip: chip + '\npreset = "v2e_noisy"'}).cameras[0]
    assert (camera.preset, camera.model) == ("v2e_noisy", "v2e")
    assert (load().cameras[0].preset, load().cameras[0].model) == (None, "pecs")
    for beside, line in (("v2e_dirty", 'preset: got "v2e_dirty"'), ('v2e_noisy"\nmodel = "esim', "model")):
        with pytest.raises(pecs.PecsInputError, match=line):
            load(replace={chip: f'{chip}\npreset = "{beside}"'})


@pytest.mark.parametrize("path", sorted((ROOT / "examples/recipes").glob("*.toml")), ids=lambda path: path.stem)
def test_the_recipes_of_the_examples(path):
    """They can be made."""
    found = recipe.load(path)
    recipe_check.check(Plan(found))
    if path.stem == "dsec_like":
        left, right = found.cameras
        assert right.position_m == [0.6, 0, 0] and found.truth.fps == 10 and found.export == ["dsec"]
        for entry in (left, right):
            with pecs.Chip(entry.chip) as chip:
                assert (entry.width or chip.width, entry.height or chip.height) == (640, 480)
