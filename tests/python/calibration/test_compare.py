import json

import numpy as np
import pecs
import pytest


def stream(count, seed, width=64, height=48):
    random = np.random.default_rng(seed)
    events = np.zeros(count, pecs.EVENT_DTYPE)
    events["t"] = np.sort(random.integers(0, 10_000, count))
    events["x"] = random.integers(0, width, count)
    events["y"] = random.integers(0, height, count)
    events["p"] = random.integers(0, 2, count)
    return events


def test_wrong_input():
    a = stream(100, 1)
    with pytest.raises(pecs.PecsError, match="event .*: got x .* wanted x < 32, y < 48"):
        pecs.compare(a, a, width=32, height=48)
    with pytest.raises(pecs.PecsError, match="sim: got 0 events, wanted at least 1"):
        pecs.compare(a, stream(0, 1), width=64, height=48)
    with pytest.raises(pecs.PecsError, match="normalisation: got 'float'"):
        pecs.compare(a, a, width=64, height=48, normalisation="float")
    sized, smaller = pecs.Events(a, 64, 48), pecs.Events(stream(100, 2, 63, 47), 63, 47)
    with pytest.raises(pecs.PecsError, match="sim: sensor size: got 63x47, wanted 64x48"):
        pecs.compare(sized, smaller)
    with pytest.raises(pecs.PecsError, match="sim: sensor size: got 64x48, wanted 63x47"):
        pecs.compare(smaller, sized)
    assert pecs.compare(sized, smaller, normalisation="eq16")["map_correlation"] is None
    assert pecs.compare(sized, a) == pecs.compare(sized, sized)


def test_program_says_the_same(pecs_program, tmp_path):
    streams = [stream(2000, seed) for seed in (1, 2)]
    names = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for name, s in zip(names, streams, strict=True):
        pecs.write(name, s)
    result = pecs_program("compare", *names, "--normalisation", "eq16", "--json", check=True)
    ours = pecs.compare(*streams, width=64, height=48, normalisation="eq16")
    theirs = json.loads(result.stdout)
    assert theirs == ours
    streams[0]["t"][:3] = 2000, 1000, 1500  # late ones
    names[0].write_text("t_us,x,y,p\n" + "".join("{},{},{},{}\n".format(*row) for row in streams[0][list("txyp")]))
    part = json.loads(pecs_program("compare", *names, "--normalisation", "eq16", "--window", "5ms", "--json").stdout)
    assert part == pecs.compare(*streams, width=64, height=48, normalisation="eq16", window_us=5000)
    assert part["real"]["t_last_us"] < part["real"]["t_first_us"] + 5000
    table = pecs_program("compare", *names, "--normalisation", "eq16").stdout
    ours = pecs.compare(*streams, width=64, height=48, normalisation="eq16")
    assert f"{ours['chamfer']:.4f}" in table and f"{ours['gaussian']:.5f}" in table


def test_delays_behind_a_disk(pecs_program, tmp_path):
    """Events 10 to 30 degrees behind the edges of four sectors; the simulation's come 5 degrees later."""
    random = np.random.default_rng(1)
    names, streams = ("real.npz", "sim.npz"), []
    for late in (10, 15):
        events = np.zeros(60_000, pecs.EVENT_DTYPE)
        t, edge = random.integers(0, 60_000, len(events)), random.integers(0, 4, len(events))
        angle = np.radians(90 * edge + 2000e-6 * t - late - 20 * random.random(len(events)) ** 2)
        radius = 140 * np.sqrt(random.random(len(events)))
        events["t"], events["p"] = t, edge % 2
        events["x"], events["y"] = 160 + radius * np.cos(angle), 150 - radius * np.sin(angle)
        streams.append(np.sort(events, order="t"))
        pecs.write(tmp_path / names[len(streams) - 1], streams[-1], 320, 300)
    (tmp_path / "disk.json").write_text(pecs_program("align", "detect", "real.npz", "--json", cwd=tmp_path).stdout)
    result = pecs_program(
        "compare", *names, "--disk", "disk.json", "-o", "delays.png", "--json", cwd=tmp_path, check=True
    )
    theirs = json.loads(result.stdout)
    for p in ("on", "off"):
        assert theirs["delays"][p]["earth_mover_deg"] == pytest.approx(5, abs=0.5)
        assert 0.3 < theirs["delays"][p]["overlap"] < 0.9
    disk = json.loads((tmp_path / "disk.json").read_text())
    assert pecs.compare(*streams, width=320, height=300, disk=disk) == theirs
    assert (tmp_path / "delays.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "delays.png.run.json").read_text())["results"] == theirs
    table = pecs_program("compare", *names, "--disk", "find", cwd=tmp_path)
    assert "delay behind the edge" in table.stdout and "sd of ON + next OFF" in table.stdout
    # One stream alone: the same numbers, and what a model needs to predict them.
    alone = pecs.delays(streams[0], disk=disk, width=320, height=300, duration_us=int(theirs["rate_curve_us"]))
    for p in ("on", "off"):
        assert alone[p]["histogram"] == pytest.approx(theirs["delays"][p]["histogram"]["real"], rel=1e-9)
        passes = np.array(alone[p]["passes"])
        assert passes.shape == (alone["regions"]["around"] * alone["regions"]["along"], 55)
        assert (np.array(alone[p]["histogram"]) * passes.sum(0)).sum() == pytest.approx(30_000 * 0.92, rel=0.02)
    assert sum(alone["regions"]["events"]) == pytest.approx(60_000 * (0.98**2 - 0.2**2), rel=0.02)
    with pytest.raises(pecs.PecsError, match="time order"):
        pecs.delays(streams[0][::-1], disk=disk, width=320, height=300, duration_us=60_000)
    other = disk | {"phase_time_us": disk["phase_time_us"] + 60_000}  # of the recording before --rezero
    (tmp_path / "other.json").write_text(json.dumps(other))
    result = pecs_program("compare", *names, "--disk", "other.json", cwd=tmp_path)
    assert result.returncode == 4 and "real.npz: phase_time_us of the disk: got " in result.stderr, result.stderr
    with pytest.raises(pecs.PecsInputError, match="real: phase_time_us of the disk: got "):
        pecs.compare(*streams, width=320, height=300, disk=other)
    (tmp_path / "no.json").write_text('{"sectors": 4}')
    result = pecs_program("compare", *names, "--disk", "no.json", cwd=tmp_path)
    assert result.returncode == 4 and "no.json: centre_x" in result.stderr


def test_realism_names_a_clock(pecs_program, tmp_path):
    """The same numbers in Python and from files of two types; a simulation on a clock of 1 ms is known by it."""
    streams = [stream(100_000, seed, 192, 128) for seed in (1, 2)]
    for s in streams:
        s["t"] *= 10
    streams[1]["t"] -= streams[1]["t"] % 1000
    for name, s in zip(("real.csv", "sim.csv", "real.npz", "sim.npz"), streams * 2, strict=True):
        pecs.write(tmp_path / name, s, 192, 128)
    ours = pecs.compare(*streams, width=192, height=128, realism=True)
    assert ours["realism"]["named"][0] == "clock" and ours["realism"]["auc"] > 0.9
    low, high = ours["realism"]["floor"]["interval"]
    assert low < 0.5 < high
    for names in (("real.csv", "sim.csv"), ("real.npz", "sim.npz")):
        result = pecs_program("compare", *names, "--realism", "--json", cwd=tmp_path)
        assert json.loads(result.stdout) == ours, result.stderr
    shown = pecs_program("compare", "real.csv", "sim.csv", "--realism", cwd=tmp_path).stdout
    assert "Strongest cue: clock" in shown and "timestamp_s" in shown
