"""pecs.fit: chips that it does not know, and recordings that it refuses."""

import json
import re
from functools import partial

import numpy as np
import pecs
import pytest
from pecs.fit import Flash, Steps, Still, Stimulus, fit, readout, stimulus_page
from pecs.fit.recordings import load_steps, load_still, load_stimulus
from pecs.fit.statistics import thresholds
from pecs.fit.stimulus import SECTIONS, timeline
from support import ROOT, load_script, run_module

hidden = load_script(ROOT / "scripts/studies/fit_hidden.py")
run = partial(run_module, "pecs.fit", check=False)
SIDE, LEVELS, LENGTH_US, CYCLES = 32, (1.0, 0.1), 20e3, 6
CHIP = {"contrast_threshold_on": 0.2, "contrast_threshold_off": 0.25, "threshold_mismatch": 0.1, "leak_rate_hz": 0.0}
HOT = [(9, 2, 30.0), (3, 5, 40.0)]  # column, row, Hz


def light_of(levels, length_us=LENGTH_US, cycles=CYCLES):
    """Light and times of its frames [us]."""
    count = len(levels)
    behind = np.concatenate([[0, 1], np.arange(101, length_us - 1, 100)])
    light = [
        np.r_[levels[c % count - 1], np.full(len(behind) - 1, levels[c % count])] for c in range(count * cycles + 1)
    ]
    t_us = [5e3 + c * length_us + behind for c in range(count * cycles + 1)]
    return np.concatenate([[levels[-1]], *light]), np.concatenate([[0.0], *t_us])


def film(t_us, light, pattern=None, **options):
    """Events of a film: light [T], or times pattern(t_us) [T, SIDE, SIDE]."""
    frames = np.asarray(light, np.float32)[:, None, None] * np.ones((1, SIDE, SIDE), np.float32)
    if pattern is not None:
        frames *= np.stack([pattern(t) for t in t_us]).astype(np.float32)
    options = {"overrides": CHIP, "photocurrent_a": 1e-12, "seed": 5} | options
    return pecs.simulate(frames, t_us, time_unit="us", **options)


def saved(path, events):
    pecs.write(path, events, width=SIDE, height=SIDE)
    return path


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    light, t_us = light_of(LEVELS)
    return saved(tmp_path_factory.mktemp("steps") / "steps.raw", film(t_us, light))


def test_steps_are_found(steps):
    for levels in (LEVELS, LEVELS[::-1]):
        found = load_steps(Steps(steps, levels))
        switches = 5e3 + LENGTH_US * np.arange(2 * CYCLES + 1)
        first = np.argmin(np.abs(switches - found.edges_us[0]))
        behind = switches[first : first + len(found.edges_us)] - found.edges_us
        assert (first % 2 == 0) == (levels == LEVELS) and ((behind >= 0) & (behind < 2500)).all()
        np.testing.assert_allclose(found.lengths_us, LENGTH_US, atol=600)


def grating(speed_px_s):
    x = np.arange(SIDE)[None, :] * np.ones((SIDE, 1))
    return lambda t_us: 1 + 0.8 * np.sin(2 * np.pi * (x - speed_px_s * t_us * 1e-6) / 8)


def flicker(hz, depth):
    return lambda t_us: np.full((SIDE, SIDE), 1 + depth * np.sin(2 * np.pi * hz * t_us * 1e-6))


def brighter(at_us, by):
    return lambda t_us: np.full((SIDE, SIDE), 1 + by * (t_us > at_us))


@pytest.mark.parametrize(
    ("levels", "shown", "pattern", "words"),
    [
        ((1, 0.1, 0.5), LEVELS, None, "switches"),
        (LEVELS, (1, 0.3, 0.1), None, "switches"),
        (LEVELS, (1, 0.1, 1, 0.01), None, "events per pixel"),
        ((1, 0.5, 1, 0.02), (1, 0.1, 1, 0.05), None, "in proportion"),
        (LEVELS, LEVELS, grating(800), "direction|switches|events per pixel"),
        (LEVELS, LEVELS, flicker(500, 0.6), "direction|switches|events per pixel"),
        (LEVELS, (1, 0.95), None, "0 switches|1 switches"),
    ],
)
def test_wrong_steps_are_refused(tmp_path, levels, shown, pattern, words):
    light, t_us = light_of(shown)
    path = saved(tmp_path / "steps.raw", film(t_us, light, pattern))
    with pytest.raises(pecs.PecsInputError, match=words) as refused:
        load_steps(Steps(path, levels))
    assert str(refused.value).startswith(f"{path}: got ") and "\n" not in str(refused.value)


def test_switches_of_another_clock_are_refused(steps, tmp_path):
    edges_us = 5e3 + LENGTH_US * np.arange(2 * CYCLES + 1)
    assert load_steps(Steps(steps, LEVELS, edges_us)).exact
    for wrong, words in (
        (1e-3 * edges_us, "switches .--edges. from 5 to 245 us, wanted times within the recording's"),
        (edges_us + 1e7, "wanted times within the recording's"),
        (edges_us + 6 * LENGTH_US, "switches to level 1 with 0.0 to "),
    ):
        with pytest.raises(pecs.PecsInputError, match=words):
            load_steps(Steps(steps, LEVELS, wrong))
    events = pecs.read(steps)
    dark = saved(tmp_path / "dark.raw", events[events["x"] < SIDE // 2])
    with pytest.raises(pecs.PecsInputError, match="got 0 events in the region 20,0,12,12, wanted 2 or more"):
        load_steps(Steps(dark, LEVELS), (20, 0, 12, 12))


def test_a_saturated_readout_is_refused(tmp_path):
    light, t_us = light_of(LEVELS)
    slow = CHIP | {"readout_row_s": 2e-5}
    path = saved(tmp_path / "steps.raw", film(t_us, light, overrides=slow, photocurrent_a=1e-11))
    with pytest.raises(pecs.PecsInputError, match="readout is saturated"):
        load_steps(Steps(path, LEVELS))


@pytest.mark.parametrize("pattern", [grating(100), flicker(20, 0.8), brighter(1e6, 1)])
def test_light_that_is_not_still_is_refused(tmp_path, pattern):
    t_us = np.arange(0, 2e6, 2000)
    path = saved(tmp_path / "still.raw", film(t_us, np.ones(len(t_us)), pattern))
    with pytest.raises(pecs.PecsInputError, match="wanted .*still light"):
        load_still(Still(path, 1.0))


def test_still_light_is_counted(tmp_path):
    t_us = np.arange(0, 4e6, 2000)
    chip = CHIP | {"noise_std": 0.0, "background_on_hz": 0.5, "background_off_hz": 0.2}
    path = saved(tmp_path / "still.raw", film(t_us, np.ones(len(t_us)), overrides=chip))
    found = load_still(Still(path, 0.0))
    assert found.on.mean() / found.seconds == pytest.approx(0.5, rel=0.08)
    assert found.off.mean() / found.seconds == pytest.approx(0.2, rel=0.12)
    events = pecs.read(path)  # in another order, the first and the last one are not the recording's ends
    events = events[np.lexsort((events["t"], events["x"], events["y"]))]
    np.savez(tmp_path / "by_pixel.npz", **{k: events[k] for k in "txyp"}, width=events.width, height=events.height)
    again = load_still(Still(tmp_path / "by_pixel.npz", 0.0))
    assert again.seconds == found.seconds and (again.on == found.on).all() and (again.off == found.off).all()


SLOW = {"readout_row_s": 2e-6, "readout_rate_hz": 2e7, "readout_vector_px": 4}


@pytest.fixture(scope="module")
def flashes(tmp_path_factory):
    """Before a readout that sends more slowly than the pixels fire."""
    light, t_us = light_of((1, 0.02), cycles=8)
    events = film(t_us, light, overrides=CHIP | SLOW, photocurrent_a=1e-11)
    return saved(tmp_path_factory.mktemp("flashes") / "flash.raw", events)


def test_the_readout_is_measured(flashes):
    found = readout.measure(Flash(flashes), SLOW | {"readout_rate_hz": 1e9})
    for key in ("readout_row_s", "readout_rate_hz"):
        value, sd = found[key]
        assert value == pytest.approx(SLOW[key], rel=0.03) and abs(value - SLOW[key]) < 2 * sd < 0.3 * value, key


def test_rows_that_are_alike_keep_the_rate(flashes):
    """Vectors as wide as the sensor: each row has one."""
    found = readout.measure(Flash(flashes), SLOW | {"readout_vector_px": 1024, "readout_rate_hz": 1e10})
    assert set(found) == {"readout_row_s"} and found["readout_row_s"][0] > SLOW["readout_row_s"]


def test_a_readout_that_is_never_busy_is_refused(tmp_path):
    light, t_us = light_of((1, 0.02))
    path = saved(tmp_path / "dim.raw", film(t_us, light, photocurrent_a=1e-15))
    empty = saved(tmp_path / "empty.raw", pecs.read(path)[:0])
    with pytest.raises(pecs.PecsInputError, match="empty.raw: got no events, wanted a recording"):
        readout.measure(Flash(empty), SLOW)
    with pytest.raises(pecs.PecsInputError, match="without a pause.*brighter"):
        readout.measure(Flash(path), SLOW)


def mapped(folder, values, side, hot):
    """A chip whose thresholds are known pixel by pixel: its file, and ON and OFF, relative [pixel]."""
    relative = 1 + values["threshold_mismatch"] * np.random.default_rng(4).standard_normal((2, side * side))
    of = {"pecs_pixel_map": 1, "source": "drawn", "region": [0, 0, side, side], "hot_pixels": hot}
    of |= dict(zip(("threshold_on", "threshold_off"), relative.clip(0.1, 10).tolist(), strict=True))
    (folder / "pixels.json").write_text(json.dumps(of))
    chip = json.loads((ROOT / "sensor/chips/imx636.json").read_text()) | {"pixel_map": "pixels.json"}
    (folder / "chip.json").write_text(json.dumps(chip))
    return str(folder / "chip.json"), relative


def check_map(found, relative, hot):
    """Thresholds are known far better than their spread, as well as stated; hot pixels are found."""
    of = found.pixel_map
    assert [h[:2] for h in of.hot_pixels] == [h[:2] for h in hot]
    side = of.region[2]
    cold = np.ones((side, side), bool)
    for (x, y, hz), (*_, true) in zip(of.hot_pixels, hot, strict=True):
        cold[y, x] = False
        assert hz == pytest.approx(true, rel=0.25)
    for estimate, true, deviation in zip((of.threshold_on, of.threshold_off), relative, of.deviation, strict=True):
        error = (estimate / estimate[cold].mean() - true.reshape(side, side))[cold]
        assert np.std(error) < 0.4 * true.std() and np.std(error) < 1.2 * deviation < 0.5 * true.std()


@pytest.fixture(scope="module")
def screen(tmp_path_factory):
    """A hidden chip, its recording of a screen and one with the cap on, and the thresholds of its pixels."""
    values, light_a = hidden.draw(11)
    folder = tmp_path_factory.mktemp("screen")
    chip, relative = mapped(folder, values, 24, [])
    values["threshold_mismatch"] = float(relative.std())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hidden, "STILLS", {0.0: 20.0})
        patch.setattr(hidden, "SIDE", 24)
        patch.setattr(hidden, "CHIP", chip)
        return values, hidden.record_screen(folder, values, light_a, 11), relative


def test_a_screens_sections_are_found(screen):
    ramps, found = load_stimulus(screen[1][0])
    assert found.refresh_hz == pytest.approx(hidden.REFRESH_HZ, abs=0.1)
    assert 5e-3 < found.change_s < 17e-3
    assert 3e-3 < found.across_s[1] < 7e-3 and abs(found.across_s[0]) < 1e-3  # rows are written downwards
    # A section begins with the first refresh after its time; what is found is at most a few bins early.
    before_s = np.cumsum([0] + [seconds for *_, seconds in timeline()])
    assert -0.005 < ramps.edges_us[0] * 1e-6 - before_s[2 + 2 * min(SECTIONS) + 1] < 0.03
    assert ramps.levels == (1, 1 / 16, 1, 1 / 4)
    sizes = np.histogram(ramps.t_us, ramps.edges_us)[0].reshape(-1, 4)[1:] / ramps.pixels
    assert (sizes.std(axis=0) < 0.02 * sizes.mean(axis=0)).all()
    for key, value in thresholds(ramps).items():  # by counting
        assert value == pytest.approx(screen[0][key], rel=0.15), key


def test_a_chip_is_fitted_to_a_screen(screen):
    values, recordings, relative = screen
    found = fit(recordings, pixels=128, pixel_map=True, seed=2)
    check_map(found, relative, [])
    for key, within in (("contrast_threshold_on", 0.05), ("contrast_threshold_off", 0.05), ("threshold_mismatch", 0.2)):
        of = found.values[key]
        assert of.value == pytest.approx(values[key], rel=within), key
        assert of.interval[0] < values[key] < of.interval[1] and np.log(of.interval[1] / of.interval[0]) < 0.6
    for key in ("noise_std", "amplifier_cutoff_hz", "refractory_period_s"):
        low, high = found.values[key].interval
        assert low < values[key] < high, key
    assert not found.corner_hz.fitted and found.screens[str(recordings[0].file)].refresh_hz
    assert found.misfit < 2


def test_a_pulsed_screen_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(hidden, "SIDE", 10)
    monkeypatch.setattr(hidden, "STILLS", {0.0: 2.0})
    values, light_a = hidden.draw(11)
    recordings = hidden.record_screen(tmp_path, values, light_a, 11, pwm=0.2)
    with pytest.raises(pecs.PecsInputError, match=r"240\.\d Hz.*full brightness"):
        load_stimulus(recordings[0])


def test_a_part_of_a_screens_recording_is_refused(screen, tmp_path):
    events = pecs.read(screen[1][0].file)
    path = saved(tmp_path / "part.raw", events[events["t"] > 4e6])
    with pytest.raises(pecs.PecsInputError, match="1 of 2 sections"):
        load_stimulus(Stimulus(path))


def test_the_page_stands_alone(tmp_path):
    page = tmp_path / "stimulus.html"
    done = run_module("pecs.fit.page", "-o", page)
    assert page.read_text() == stimulus_page() and f"{sum(s for *_, s in timeline()):.0f} s" in done.stdout
    assert json.dumps(timeline()) in stimulus_page()
    assert not re.search(r"(src|href|url)\s*[=(]", stimulus_page())
    levels = {round(256 * level, 9) for part in timeline() for level in part[:2]}
    assert all(level.is_integer() for level in levels)  # of 16x16 squares


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--steps", "{steps}=1,0.3,0.1"], 4, "switches"),
        (["--steps", "{steps}=1"], 4, "at least two levels"),
        (["--steps", "missing.raw=1,0.1"], 3, "missing.raw"),
        (["--steps", "{steps}"], 2, "wanted FILE=LEVEL"),
        (["--still", "{steps}=1,2"], 2, "wanted one"),
        (["--still", "{steps}=1"], 4, "at least 1 s"),
        ([], 2, "wanted --stimulus, --steps, --disk, --still or --davis"),
        (["--stimulus", "{steps}"], 4, "events that come with"),
        (["--steps", "{steps}=1,0.1", "--irradiance", "1"], 2, "wanted both"),
        (["--steps", "{steps}=1,0.1", "--region", "0,0,99,99"], 4, "region"),
        (["--steps", "{steps}=1,0.1", "--pixels", "64"], 2, "pixels: got 64"),
    ],
)
def test_a_wrong_command_is_one_line(steps, tmp_path, words, code, said):
    done = run(*(w.format(steps=steps) for w in words), "-o", tmp_path / "chip.json")
    assert done.returncode == code and said in done.stderr, done.stderr
    assert done.stderr.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_hidden_chip_is_found(tmp_path, monkeypatch):
    seed = 12
    monkeypatch.setattr(hidden, "STILLS", {0.0: 20.0})
    monkeypatch.setattr(hidden, "SIDE", 32)
    values, light_a = hidden.draw(seed)
    chip, relative = mapped(tmp_path, values, 32, HOT)
    monkeypatch.setattr(hidden, "CHIP", chip)
    recordings = hidden.record(tmp_path, values, light_a, seed, "aedat4")
    found = fit(recordings, pixels=128, pixel_map=True)
    check_map(found, relative, HOT)
    for key in ("contrast_threshold_on", "contrast_threshold_off", "threshold_mismatch"):
        assert found.values[key].value == pytest.approx(values[key], rel=0.1), key
        low, high = found.values[key].interval
        assert low < found.values[key].value < high and np.log(high / low) < 0.5
    assert found.corner_hz.value == pytest.approx(light_a * values["corner_hz_per_a"], rel=0.1)
    kept = found.values["corner_hz_per_a"]
    assert not kept.fitted and kept.value == pecs.Chip().corner_hz_per_a and "light" in kept.why
    assert found.values["background_off_hz"].value == pytest.approx(values["background_off_hz"], rel=0.4)


def test_the_command_writes_a_profile_and_a_page(tmp_path, monkeypatch, flashes):
    monkeypatch.setattr(hidden, "STILLS", {0.0: 20.0})
    monkeypatch.setattr(hidden, "SIDE", 24)
    values, light_a = hidden.draw(13)
    files = [r.file for r in hidden.record(tmp_path, values, light_a, 13)]
    chip, page, numbers = (tmp_path / name for name in ("mine.json", "fit.html", "fit.json"))
    levels = ",".join(map(str, hidden.LEVELS))
    words = ["--steps", f"{files[0]}={levels}", "--still", f"{files[1]}=0", "--photocurrent", f"{light_a:g}A"]
    vector = {"value": SLOW["readout_vector_px"], "unit": "px", "range": [1, 8192], "source": "drawn"}
    base = {"pecs_chip": 1, "based_on": "imx636", "name": "base", "values": {"readout_vector_px": vector}}
    (tmp_path / "base.json").write_text(json.dumps(base))
    words += ["--flash", flashes, "--chip", tmp_path / "base.json"]
    done = run(*words, "--pixels", 128, "-o", chip, "--report", page, "--numbers", numbers, "--pixel-map")
    assert done.returncode == 0, done.stderr
    found, wrote = pecs.Chip(str(chip)), json.loads(numbers.read_text())
    assert "thresholds of 24x24 pixels from 0,0, within" in done.stdout and found.info["pixel_map"].endswith(
        "mine_pixels.json"
    )
    assert page.read_text().count("data:image/png") == 2
    for key in ("contrast_threshold_on", "corner_hz_per_a"):  # the light is known
        assert wrote["values"][key]["fitted"] and getattr(found, key) == pytest.approx(values[key], rel=0.15)
    assert found.readout_row_s == pytest.approx(SLOW["readout_row_s"], rel=0.03)
    entry = json.loads(chip.read_text())["values"]["contrast_threshold_on"]
    assert "pecs fit" in entry["source"] and entry["interval"][0] < entry["value"] < entry["interval"][1]
    assert page.read_text().count("<svg") >= 3 * len(hidden.LEVELS) and "steps.raw" in page.read_text()
    assert set(wrote["values"]["contrast_threshold_on"]["interval_grows_without"]) == {"steps.raw", "still_0.raw"}


def wrong_protocol(seed):
    """What is wrong, light and pattern of a film, options of the sensor, and whether the light should be still."""
    rng, kind = np.random.default_rng(seed), seed % 5
    still, shown, pattern, options = bool(rng.integers(2)), LEVELS, None, {}
    if kind == 0:
        pattern = grating(float(rng.choice((-1, 1)) * np.exp(rng.uniform(*np.log((100, 2000))))))
    elif kind == 1:
        pattern = flicker(float(rng.uniform(40, 400)), float(rng.uniform(0.4, 0.9)))
    elif kind == 2:  # room light
        at_us, by = float(rng.uniform(4e4, 1.5e5)) * (10 if still else 1), float(rng.uniform(1.0, 3.0))
        pattern = brighter(at_us, by)
    elif kind == 3:
        still, shown = False, (1, float(rng.uniform(0.2, 0.4)), float(rng.uniform(0.02, 0.1)))
    else:
        still, slow = False, CHIP | {"readout_row_s": float(rng.uniform(1e-5, 3e-5))}
        options = {"overrides": slow, "photocurrent_a": 1e-11}
    return still, shown, pattern, options


@pytest.mark.parametrize("seed", range(10))  # each kind twice
def test_drawn_wrong_protocols_are_refused(tmp_path, seed):
    still, shown, pattern, options = wrong_protocol(seed)
    t_us = np.arange(0, 2e6, 2000) if still else None
    light, t_us = (np.ones(len(t_us)), t_us) if still else light_of(shown)
    path = saved(tmp_path / "wrong.raw", film(t_us, light, pattern, **options))
    with pytest.raises(pecs.PecsInputError, match="got .*, wanted "):
        load_still(Still(path, 1.0)) if still else load_steps(Steps(path, LEVELS))
