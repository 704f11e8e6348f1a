import json

import numpy as np
import pytest


@pytest.fixture
def recording(tmp_path):
    random = np.random.default_rng(1)
    rows = np.stack(
        [np.sort(random.integers(0, 20_000, 3000)), *random.integers(0, [[64], [48], [2]], (3, 3000))], axis=1
    )
    path = tmp_path / "events.csv"
    np.savetxt(path, rows, fmt="%d", delimiter=",", header="t_us,x,y,p", comments="")
    return path


@pytest.mark.parametrize(
    "name, head, options",
    [
        ("x.png", b"\x89PNG", ["--window", "2ms", "--count", "4", "--theme", "dark"]),
        ("x.mp4", b"", ["--slow-motion", "20", "--fps", "30"]),
        ("x.html", b"<!doctype html>", ["--limit", "1000"]),
    ],
)
def test_writes(pecs_program, recording, tmp_path, name, head, options):
    result = pecs_program("view", recording, "-o", tmp_path / name, "--json", *options, check=True)
    assert (tmp_path / name).read_bytes().startswith(head)
    said = json.loads(result.stdout)
    assert said["events"] == 3000
    record = json.loads((tmp_path / f"{name}.run.json").read_text())
    assert record["results"] == said
    if name == "x.mp4":
        assert said["frames"] == 12  # 20 ms, 20 times slower, at 30 per second
    if name == "x.html":
        assert said["events_in_page"] == 1000
    assert not [p for p in tmp_path.iterdir() if "partial" in p.name]


@pytest.mark.parametrize(
    "options, code, line",
    [
        (["-o", "x.gif"], 2, "wanted a name that ends in .png, .mp4 or .html"),
        (["-o", "x.png", "--window", "5px"], 2, "--window"),
        (["-o", "x.png", "--window=-5ms"], 2, "--window: got -5000, wanted"),
        (["-o", "x.png", "--from=-5ms"], 2, "--from: got -5000, wanted"),
        (["-o", "x.png", "--to", "0"], 2, "--to: got 0, wanted"),
        (["-o", "x.png", "--from", "1s"], 4, "got 0 events from 1000000 us"),
        (["-o", "missing/x.png"], 5, "missing/x.png"),
        (["-o", "missing/x.mp4"], 5, "missing/x.mp4"),
    ],
)
def test_wrong_use(pecs_program, recording, tmp_path, options, code, line):
    result = pecs_program("view", recording, *options, cwd=tmp_path)
    assert result.returncode == code, result.stderr
    assert line in result.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["events.csv"]
