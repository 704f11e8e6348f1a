"""Presets: published settings of other simulators."""

import json

import numpy as np
import pecs
import pytest

PRESETS = {preset["name"]: preset for preset in pecs.presets()}
FRAMES = 0.5 + 0.45 * np.sin(0.3 * np.arange(64) + 0.05 * np.arange(48)[:, None] - 0.25 * np.arange(40)[:, None, None])
T_US = 1000.0 * np.arange(len(FRAMES))


def simulate(**options):
    return np.asarray(pecs.simulate(FRAMES, T_US, **options))


def test_the_files_say_where_their_values_are_from():
    folder = pecs.data_dir("sensor/presets")
    assert sorted(PRESETS) == sorted(f.stem for f in folder.iterdir())
    assert {p["model"] for p in PRESETS.values()} == {m["name"] for m in pecs.models()} - {"pecs"}
    for preset in PRESETS.values():
        assert "github.com/" in preset["source"]


@pytest.mark.parametrize("name", PRESETS)
def test_nothing_is_left_to_the_chip(name):
    preset, events = PRESETS[name], simulate(preset=name, chip="imx636")
    assert len(events) > 100
    assert np.array_equal(events, simulate(preset=name, chip="davis346"))
    by_hand = {"model": preset["model"], "parameters": preset["param"], "overrides": preset["set"], "readout": "ideal"}
    assert np.array_equal(events, simulate(**by_hand))


def test_given_values_win():
    own = {"contrast_threshold_on": 0.4}
    few = simulate(preset="v2e_clean", overrides=own)
    by_hand = {**PRESETS["v2e_clean"]["set"], **own}
    parameters = PRESETS["v2e_clean"]["param"]
    assert np.array_equal(few, simulate(model="v2e", parameters=parameters, overrides=by_hand, readout="ideal"))
    assert few["p"].sum() < simulate(preset="v2e_clean")["p"].sum()
    slow = simulate(preset="v2e_clean", parameters={"cutoff_hz": 5})
    assert len(slow) < len(simulate(preset="v2e_clean"))


def test_another_model_is_refused():
    with pytest.raises(pecs.PecsInputError, match="v2e_clean.*of model v2e.*esim"):
        simulate(preset="v2e_clean", model="esim")
    with pytest.raises(pecs.PecsNotFoundError, match="v2e_clean"):
        simulate(preset="v2e_dirty")


def test_a_file_of_the_users(tmp_path):
    own = {"pecs_preset": 1, "name": "own", "description": "d", "source": "s", "model": "esim", "set": {}, "param": {}}
    file = tmp_path / "own.json"
    file.write_text(json.dumps(own | {"set": {"contrast_threshold_on": 0.3}}))
    assert np.array_equal(
        simulate(preset=file), simulate(model="esim", overrides={"contrast_threshold_on": 0.3}, readout="ideal")
    )
    for wrong in ({"set": {"contrast": 0.3}}, {"param": {"tau": 1}}, {"model": "dvs"}, {"unknown": 1}, {"set": 3}):
        file.write_text(json.dumps(own | wrong))
        with pytest.raises(pecs.PecsInputError):
            simulate(preset=file)


def test_command(pecs_program):
    text = pecs_program("presets").stdout
    for preset in PRESETS.values():
        assert preset["description"] in text and preset["source"] in text
    assert json.loads(pecs_program("presets", "--json").stdout) == list(PRESETS.values())
