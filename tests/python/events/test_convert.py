"""pecs info and pecs convert on event files."""

import json

import numpy as np
import pecs
import pytest
from support.event_readers import HEIGHT, STREAMS, WIDTH, array, assert_same


def test_info(pecs_program, tmp_path):
    pecs.write(tmp_path / "e.raw", array((1000, 1, 2, 1), (2000, 3, 4, 0), (5000, 3, 4, 1)), 100, 50, camera="X1")
    info = json.loads(pecs_program("info", tmp_path / "e.raw", "--json", check=True).stdout)
    assert info == {
        "format": "evt3",
        "width": 100,
        "height": 50,
        "camera": "X1",
        "events": 3,
        "t_first_us": 1000,
        "t_last_us": 5000,
        "duration_us": 4000,
        "on_fraction": pytest.approx(2 / 3),
        "event_rate_hz": pytest.approx(750),
        "event_rate_per_pixel_hz": pytest.approx(0.15),
        "time_reversals": 0,
    }
    words = pecs_program("info", tmp_path / "e.raw", check=True).stdout
    assert "evt3, 100x50 pixels, X1" in words and "1000 to 5000 us" in words


def test_info_of_events_by_pixel(pecs_program, tmp_path):
    """The first and the last event of the file are not those in time: the rate was another one."""
    np.savez(tmp_path / "e.npz", t=[3001, 9001, 1001, 4007], x=[0, 0, 1, 1], y=[0] * 4, p=[1] * 4)
    info = json.loads(pecs_program("info", tmp_path / "e.npz", "--json", check=True).stdout)
    assert (info["t_first_us"], info["t_last_us"], info["time_reversals"]) == (1001, 9001, 1)
    assert info["event_rate_hz"] == pytest.approx(500)


def test_convert_a_part(pecs_program, tmp_path):
    events = STREAMS["bursts"]
    pecs.write(tmp_path / "in.raw", events, WIDTH, HEIGHT)
    out = tmp_path / "out.h5"
    options = ("--t-start", 500, "--t-end", 1500, "--rezero", "--decimate", 4, "--json")
    result = json.loads(pecs_program("convert", tmp_path / "in.raw", out, *options, check=True).stdout)

    keep = (events["t"] >= 500) & (events["t"] < 1500) & (events["x"] % 4 == 2) & (events["y"] % 4 == 2)
    wanted = events[keep]
    assert len(wanted) > 1000
    assert_same(
        (pecs.read(out)["t"], *(pecs.read(out)[n] for n in "xyp")),
        {"t": wanted["t"] - wanted["t"][0], "x": wanted["x"] // 4, "y": wanted["y"] // 4, "p": wanted["p"]},
    )
    assert (result["width"], result["height"], result["events"]) == (320, 180, len(wanted))
    record = json.loads((tmp_path / "out.h5.run.json").read_text())
    assert record["config"]["decimate"] == 4 and record["results"]["events"] == len(wanted)
    assert record["inputs"][0]["sha256"]


def test_convert_measures_a_size_that_the_file_does_not_say(pecs_program, tmp_path):
    (tmp_path / "e.csv").write_text("t_us,x,y,p\n5,10,20,1\n")
    pecs_program("convert", tmp_path / "e.csv", tmp_path / "e.raw", check=True)
    assert pecs.EventReader(tmp_path / "e.raw").info["width"] == 11
    pecs_program("convert", tmp_path / "e.csv", tmp_path / "e.raw", "--size", 640, 480, check=True)
    assert pecs.EventReader(tmp_path / "e.raw").info["width"] == 640


def test_convert_refuses(pecs_program, tmp_path):
    (tmp_path / "e.csv").write_text("t_us,x,y,p\n5,10,20,1\n4,10,20,1\n")
    back = pecs_program("convert", tmp_path / "e.csv", tmp_path / "e.raw")
    assert back.returncode == 4
    place = f"{tmp_path}/e.csv: event 1 (line 3, byte 21)"
    assert (
        back.stderr
        == f"pecs: {place}: got t = 4 us, wanted at least 5 us, the event before (or --late sort, --late drop)\n"
    )
    assert not (tmp_path / "e.raw").exists() and not (tmp_path / "e.raw.run.json").exists()
    assert pecs_program("convert", tmp_path / "e.csv", tmp_path / "e.xyz").returncode == 2
    assert pecs_program("convert", tmp_path / "e.csv").returncode == 2
