"""The chip's digital stages on simulated light, and the same from program, Python and event files."""

import json

import numpy as np
import pecs
import pytest
from support.small_stacks import write

SIZE = 32


def scene(hz, seconds=0.4):
    """A lamp of `hz` on the left half, a dark bar that crosses the right half in 0.3 s."""
    t = np.arange(0, seconds, min(5e-4, 0.05 / hz))
    x = np.arange(SIZE)
    lamp = 1 + 0.8 * np.sin(2 * np.pi * hz * t)[:, None]
    bar = 1 - 0.7 / (1 + ((x - SIZE / 2 - SIZE / 2 * t[:, None] / 0.3) / 1.5) ** 4)
    rows = np.where(x < SIZE // 2, lamp, bar)
    return np.repeat(rows[:, None], SIZE, 1).astype(np.float32), t * 1e6


def counts(events, late_us=150_000):
    late = events[events["t"] >= late_us]
    left = np.count_nonzero(late["x"] < SIZE // 2)
    return left, len(late) - left


def test_anti_flicker_takes_the_lamp_and_leaves_the_bar():
    frames, t_us = scene(100)
    light = {"photocurrent_a": 1e-11, "seed": 2}
    lamp, bar = counts(pecs.simulate(frames, t_us, **light))
    assert lamp > 1000 and bar > 200
    stopped = counts(pecs.simulate(frames, t_us, afk_hz=(50, 520), **light))
    assert stopped[0] < 0.01 * lamp and stopped[1] == bar
    passed = counts(pecs.simulate(frames, t_us, afk_pass_hz=(90, 110), **light))
    assert passed[0] > 0.99 * lamp and passed[1] == 0


def test_anti_flicker_begins_and_ends_after_the_counts_given():
    frames, t_us = scene(100)
    light = {"photocurrent_a": 1e-11, "seed": 2, "afk_hz": (50, 520)}

    def first_dropped_us(*counts):  # the lamp's last event before its block flickers
        events = pecs.simulate(frames, t_us, **light, **({"afk_counts": counts} if counts else {}))
        return int(events["t"][events["x"] < SIZE // 2].max())

    early, default, late = first_dropped_us(2, 1), first_dropped_us(), first_dropped_us(7, 4)
    assert default == first_dropped_us(6, 4)
    assert early + 3e4 < default < late < default + 2.5e4  # periods of 10 ms
    for counts, message in (((4, 6), "stop not above start"), ((8, 4), "8"), ((3.5, 1), "no such counts")):
        with pytest.raises(pecs.PecsError, match=message):
            pecs.Sensor(SIZE, SIZE, afk_hz=(50, 520), afk_counts=counts)
    with pytest.raises(pecs.PecsError, match="counts without a band"):
        pecs.Sensor(SIZE, SIZE, afk_counts=(6, 4))


def test_a_sensor_counts_what_each_stage_drops(tmp_path):
    (tmp_path / "mask.txt").write_text("column 3")
    frames, t_us = scene(100, 0.1)
    stages = {"roi": [(0, 0, 20, 32)], "mask": tmp_path / "mask.txt", "trail_us": 10_000, "erc_hz": 20_000}
    with pecs.Sensor(SIZE, SIZE, labels=True, **stages) as sensor:
        events = np.concatenate([sensor.push(frames, t_us), sensor.finish()])
    assert {key for key, n in sensor.dropped_by_stage.items() if n} == {"roi", "mask", "trail", "erc"}
    assert events["x"].max() < 20 and 3 not in events["x"]
    assert np.unique(events["t"] // 200, return_counts=True)[1].max() <= 4
    late = pecs.simulate(frames, t_us + 77, labels=True, **stages)  # ERC counts from the first frame, as `pecs sense`
    assert abs(len(late) - len(events)) <= 2 and np.unique((late["t"] - 77) // 200, return_counts=True)[1].max() <= 4


STAGES = {
    "trail": (["--trail", "3ms"], {"trail_us": 3000}),
    "stc": (["--stc", "3ms"], {"stc_us": 3000}),
    "stc-keep": (["--stc-keep", "3ms"], {"stc_keep_us": 3000}),
    "afk": (["--afk", "50:520"], {"afk_hz": [50, 520]}),
    "afk-counts": (["--afk", "50:520", "--afk-counts", "2:1"], {"afk_hz": [50, 520], "afk_counts": [2, 1]}),
    "erc": (["--erc", "20kHz"], {"erc_hz": 20000.0}),
}


@pytest.mark.parametrize("name", STAGES)
def test_program_python_and_files_alike(name, tmp_path, pecs_program):
    """`pecs convert` drops from a file what `pecs sense` drops on the way to it; kept and dropped are all."""
    words, keys = STAGES[name]
    write(tmp_path / "s", frames=12, level=1e-3, period_ns=12_000_000)
    loops = ["--duration", "200ms", "--quiet"]
    drops = ["--dropped", tmp_path / "d.npy"]
    for out, args in (("plain", []), ("kept", [*words, *drops]), ("threads", [*words, "--threads", 3])):
        pecs_program("sense", tmp_path / "s", "-o", tmp_path / f"{out}.npz", *loops, *args, check=True)
    pecs_program(
        "convert", tmp_path / "plain.npz", tmp_path / "c.npz", *words, "--dropped", tmp_path / "dc.npy", check=True
    )
    pecs.sense(tmp_path / "s", tmp_path / "python.npz", duration_us=200_000, **keys)
    plain, kept = pecs.read(tmp_path / "plain.npz"), pecs.read(tmp_path / "kept.npz")
    for other in ("threads", "c", "python"):
        np.testing.assert_array_equal(kept, pecs.read(tmp_path / f"{other}.npz"))
    dropped = np.load(tmp_path / "d.npy")
    np.testing.assert_array_equal(dropped, np.load(tmp_path / "dc.npy"))
    assert len(kept) + len(dropped) == len(plain) and 0 < len(kept) < len(plain)
    assert {pecs.sensor.STAGES[s] for s in dropped["stage"]} == {name.split("-")[0].replace("stc", "trail")}
    record = json.loads((tmp_path / "kept.npz.run.json").read_text())
    assert sum(record["results"]["dropped_by_stage"].values()) == len(dropped)
    assert record["config"]["stages"] == keys


def test_convert_drops_in_the_part_that_is_kept(tmp_path, pecs_program):
    """What convert writes, lists as dropped and counts is the part of the file, on its clock and grid."""
    t = np.arange(0, 100_000, 50)
    events = np.zeros(len(t), pecs.EVENT_DTYPE)
    events["t"], (events["x"], events["y"]) = t, np.random.default_rng(1).integers(0, 8, (2, len(t)))
    pecs.write(tmp_path / "in.npz", events, width=8, height=8)
    rows = ["--erc", "10kHz", "--roi", "0,0,8,6"]
    part = ["--t-start", "30ms", "--t-end", "60ms", "--decimate", "2", "--rezero", "--dropped", tmp_path / "d.npy"]
    pecs_program("convert", tmp_path / "in.npz", tmp_path / "o.npz", *rows, *part, check=True)
    kept, dropped = pecs.read(tmp_path / "o.npz"), np.load(tmp_path / "d.npy")
    expected = events[(t >= 30_000) & (t < 60_000) & (events["x"] % 2 == 1) & (events["y"] % 2 == 1)]
    seen = expected[expected["y"] < 6]
    counts = json.loads((tmp_path / "o.npz.run.json").read_text())["results"]["dropped_by_stage"]
    assert counts["erc"] == len(dropped) > 10 and counts["roi"] == len(expected) - len(seen) > 10
    both = np.sort(np.concatenate([kept["t"], dropped["t"]]))
    np.testing.assert_array_equal(both - both[0], seen["t"] - seen["t"][0])
    assert kept["t"][0] == 0 and dropped["x"].max() == 3 and dropped["y"].max() == 2


WRONG = [
    (["--afk", "520:50"], "--afk: got '520:50', wanted LOW:HIGH in Hz, from 50 to 520"),
    (["--afk", "100"], "--afk: got '100', wanted LOW:HIGH in Hz, from 50 to 520"),
    (["--roi", "1,2,0,4"], "--roi: got '1,2,0,4', wanted X,Y,WIDTH,HEIGHT in pixels"),
    (["--trail", "3s"], "--trail"),
    (["--trail", "3ms", "--stc", "3ms"], "excludes"),
    (["--erc", "3"], "--erc"),
]


@pytest.mark.parametrize("case", WRONG, ids=lambda case: " ".join(case[0]))
def test_a_wrong_stage_is_one_line(case, pecs_program):
    words, said = case
    done = pecs_program("sense", "stack", "-o", "x.raw", *words)
    assert done.returncode == 2 and said in done.stderr and done.stderr.count("\n") == 1, done.stderr


def test_wrong_stages_in_python():
    frames, t_us = scene(100, 0.01)
    with pytest.raises(pecs.PecsInputError, match="exclude each other"):
        pecs.simulate(frames, t_us, trail_us=2000, stc_us=2000)
    with pytest.raises(pecs.PecsInputError, match="roi"):
        pecs.simulate(frames, t_us, roi=[(0, 0, 40, 10)])
