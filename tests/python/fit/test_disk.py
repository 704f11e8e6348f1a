"""pecs fit --disk: a chip, a disk and its light that it does not know, and recordings that it refuses."""

import json
from functools import partial

import numpy as np
import pecs
import pytest
from pecs.fit import Disk
from pecs.fit.disk import load_disk
from support import run_module

SIZE, CORNER_HZ, CONTRAST, PIXELS = {"width": 150, "height": 120}, 3.0, 15.0, 128
CHIP = {"contrast_threshold_on": 0.2, "contrast_threshold_off": 0.25, "threshold_mismatch": 0.1, "noise_std": 0.04}
CHIP |= {"background_on_hz": 0.5, "background_off_hz": 0.3}


@pytest.fixture
def run(pecs_program, monkeypatch):
    monkeypatch.setenv("PECS_PROGRAM", str(pecs_program("--version").args[0]))
    return partial(run_module, "pecs.fit", check=False)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Six sectors, clockwise, another camera's size."""
    from pecs_lab import computed_disk

    disk = computed_disk.Disk((75.0, 58.0), 50.0, -1800.0, 20.0, sectors=6)
    light = np.full((24, 4), CORNER_HZ), CONTRAST
    path = tmp_path_factory.mktemp("disk") / "disk.raw"
    seen = SIZE | {"duration_us": 400e3, "step_us": 200.0, "margin_px": computed_disk.MARGIN_PX}
    events = computed_disk.simulate("imx636", CHIP, disk, *light, **seen, seed=2)
    pecs.write(path, events, **SIZE)
    return path


def test_a_disk_and_a_chip_are_found(run, recording, tmp_path):
    chip, page, numbers = (tmp_path / name for name in ("mine.json", "fit.html", "fit.json"))
    words = ["--disk", f"{recording}={CONTRAST:g}", "--pixels", PIXELS, "--seed", 1, "-o", chip]
    done = run(*words, "--report", page, "--numbers", numbers)
    assert done.returncode == 0 and "6 sectors, -" in done.stdout, done.stderr
    wrote = json.loads(numbers.read_text())
    values, found = wrote["values"], wrote["disks"][str(recording)]
    # Slow light shows the scale of thresholds, noise and corner together, their ratios better than the scale: seeds 1,
    # 2 and 3 of the fit find corners of 3.0, 2.5 and 3.4 Hz.
    on, off = (values[f"contrast_threshold_{p}"]["value"] for p in ("on", "off"))
    assert on == pytest.approx(CHIP["contrast_threshold_on"], rel=0.2)
    assert off / on == pytest.approx(1.25, rel=0.06)
    for key in CHIP:
        low, high = values[key]["interval_95"]
        assert low / 1.1 < CHIP[key] < 1.1 * high, key
        assert high < 3 * low or key.startswith("background"), key
    assert found["rpm"] == pytest.approx(-300, rel=1e-3)
    assert np.median(found["corner_hz"]) == pytest.approx(CORNER_HZ, rel=0.15)
    assert not values["corner_hz_per_a"]["fitted"] and "steps" in values["corner_hz_per_a"]["why"]
    assert pecs.Chip(str(chip)).contrast_threshold_on == pytest.approx(on, rel=1e-3)
    assert page.read_text().count("<svg") == 2 and wrote["misfit"] < 2


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--disk", "{still}"], 4, "still.raw: disk: got nothing found"),
        (["--disk", "{disk}=1"], 4, "got contrast 1, wanted"),
        (["--disk", "{disk}=black"], 2, "wanted FILE or FILE=CONTRAST"),
        (["--disk", "missing.raw"], 3, "missing.raw"),
        (["--disk", "{ms}"], 4, "ms.npz: got a disk at -3e+05 rpm, wanted 3 to 100000 (times in us?)"),
        (["--disk", "{disk}", "--still", "{still}=1"], 2, "wanted a known photocurrent"),
    ],
)
def test_a_wrong_command_is_one_line(run, recording, tmp_path, words, code, said):
    still = tmp_path / "still.raw"
    pecs.write(
        still, pecs.simulate(np.ones((9, 32, 32)), np.arange(9) * 5e5, time_unit="us", seed=1), width=32, height=32
    )
    events = pecs.read(recording)
    events["t"] //= 1000
    pecs.write(ms := tmp_path / "ms.npz", events, **SIZE)
    done = run(*(w.format(disk=recording, still=still, ms=ms) for w in words), "-o", tmp_path / "chip.json")
    assert done.returncode == code and said in done.stderr, done.stderr
    assert done.stderr.count("\n") == 1 and not (tmp_path / "chip.json").exists()


def test_the_lab_recording_is_described_by_its_profile(shared, pecs_program, monkeypatch):
    """R_360_L: what `imx636` gives in the estimated light."""
    from pecs.fit.disk import disk_shape, measured, per_edge, predicted, predicted_per_edge
    from pecs.fit.model import Model

    recording = shared / "data/real/R_360_L.hdf5"
    if not recording.is_file():
        pytest.skip(f"needs {recording}")
    monkeypatch.setenv("PECS_PROGRAM", str(pecs_program("--version").args[0]))
    of = load_disk(Disk(recording))
    model = Model("imx636", PIXELS)
    model.focus(of, {})
    answers = model.turning(of, {})
    shown = disk_shape(of, answers)
    assert shown.sectors == 4 and shown.rpm == pytest.approx(349.8, abs=0.2)
    assert 4 < np.median(shown.corner_hz) < 6
    assert np.abs(per_edge(of) - predicted_per_edge(of, answers)).sum() < 0.2
    assert np.abs(np.subtract(predicted(of, answers), measured(of))).mean() < 0.1
