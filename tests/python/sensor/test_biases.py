"""Biases from program, Python and Metavision's files; `pecs chips` and `pecs chip info`."""

import json

import numpy as np
import pecs
import pytest
from support.small_stacks import N, write


@pytest.fixture(scope="module")
def stack(tmp_path_factory):
    return write(tmp_path_factory.mktemp("biases") / "s", level=1e-3, period_ns=N * 1_000_000)


def test_a_bias_is_its_threshold(stack, tmp_path, pecs_program):
    """By option, file and Python, against the thresholds of the published table."""
    (tmp_path / "a.bias").write_text("35 % bias_diff_on\n-9 % bias_diff_off\n0 % bias_hpf\n")
    given = {"options": ["--bias", "diff_on=35,diff_off=-9"], "file": ["--bias-file", tmp_path / "a.bias"]}
    for name, words in given.items():
        done = pecs_program("sense", stack, "-o", tmp_path / f"{name}.npz", *words)
        assert done.returncode == 0 and "warning" not in done.stderr, done.stderr
    with pecs.Chip("imx636") as chip:
        thresholds = {
            "contrast_threshold_on": 1.58 * chip.contrast_threshold_on,
            "contrast_threshold_off": 0.82 * chip.contrast_threshold_off,
        }
    pecs.sense(stack, tmp_path / "set.npz", overrides=thresholds)
    pecs.sense(stack, tmp_path / "python.npz", biases={"diff_on": 35, "bias_diff_off": -9})
    wanted = pecs.read(tmp_path / "set.npz")
    for name in (*given, "python"):
        events = pecs.read(tmp_path / f"{name}.npz")
        assert len(events) == pytest.approx(len(wanted), rel=1e-3)  # the last digit of exp(log) differs
    record = json.loads((tmp_path / "file.npz.run.json").read_text())
    assert record["config"]["chip"]["biases"] == {"diff_on": 35, "diff_off": -9}


def test_doubtful_biases_and_ignored_settings_are_warnings(stack, tmp_path, pecs_program):
    settings = {
        "ll_biases_state": {"bias": [{"name": "bias_diff_on", "value": 100}]},
        "event_trail_filter_state": {"enabled": True, "filtering_type": "STC_CUT_TRAIL", "threshold": 10000},
    }
    (tmp_path / "c.json").write_text(json.dumps(settings))
    done = pecs_program("sense", stack, "-o", tmp_path / "x.npz", "--bias-file", tmp_path / "c.json")
    assert done.returncode == 0 and "doubtful" in done.stderr and "event_trail_filter_state" in done.stderr


def test_chips_are_listed_with_their_cameras(pecs_program):
    listed = {chip["name"]: chip for chip in json.loads(pecs_program("chips", "--json").stdout)}
    assert set(listed) >= {"imx636", "gen3_vga", "davis346", "genx320", "ideal"}
    assert "SilkyEvCam HD" in pecs_program("chips").stdout


def test_the_photocurrent_of_an_illuminance(pecs_program, root):
    """Against Planck's law and V(lambda), integrated here."""
    nm = np.arange(300.5, 1100)
    power = nm**-5 / np.expm1(1.4387769e7 / (nm * 3000))
    v_nm, v = np.loadtxt(root / "lens_data/spectra/photopic.csv", delimiter=",", skiprows=2).T
    watts = power / (683 * np.sum(power * np.interp(nm, v_nm, v, 0, 0)))  # W m^-2 nm^-1 per lux
    with pecs.Chip("imx636") as chip:
        info, qe = chip.info["values"], chip.info["relative_qe"]
        response = chip.peak_qe * np.interp(nm, qe["lambda_nm"], qe["value"], 0, 0)
        area = chip.pixel_pitch_m**2 * chip.fill_factor
    per_lux = area * 1.602176634e-19 / (6.62607015e-34 * 299792458) * np.sum(watts * response * nm * 1e-9)
    done = pecs_program("chip", "info", "imx636", "--lux", "100", "--fnumber", "2", "--json")
    light = json.loads(done.stdout)["light"]
    assert light["lux_at_chip"] == 100 / 16
    assert light["photocurrent_a"] == pytest.approx(100 / 16 * per_lux, rel=2e-3)
    corner = info["corner_hz_per_a"]["value"] * (light["photocurrent_a"] + info["dark_current_a"]["value"])
    assert light["corner_hz"] == pytest.approx(corner)
