import json

import numpy as np
import pecs


def test_noise_is_no_disk(pecs_program, tmp_path):
    random = np.random.default_rng(1)
    events = np.zeros(5000, pecs.EVENT_DTYPE)
    events["t"] = np.sort(random.integers(0, 50_000, len(events)))
    events["x"] = random.integers(0, 320, len(events))
    events["y"] = random.integers(0, 240, len(events))
    events["p"] = random.integers(0, 2, len(events))
    pecs.write(tmp_path / "noise.raw", events, 320, 240)
    result = pecs_program("align", "detect", "noise.raw", "-o", "found.png", cwd=tmp_path)
    assert result.returncode == 4
    assert "nothing found (best candidate: " in result.stderr and len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "found.png").exists()


def test_a_board_needs_its_counts(pecs_program):
    result = pecs_program("align", "detect", "x.raw", "--target", "checkerboard")
    assert result.returncode == 2 and "--columns and --rows" in result.stderr
    result = pecs_program("align", "detect", "x.raw", "--target", "table", "--columns", "3", "--rows", "3")
    assert result.returncode == 2 and "got 'table'" in result.stderr


def test_intrinsics_say_what_is_missing(pecs_program, tmp_path):
    random = np.random.default_rng(1)
    events = np.zeros(20000, pecs.EVENT_DTYPE)
    events["t"] = np.sort(random.integers(0, 50_000, len(events)))
    events["x"], events["y"] = random.integers(0, 320, len(events)), random.integers(0, 240, len(events))
    pecs.write(tmp_path / "a.raw", events, 320, 240)
    pecs.write(tmp_path / "b.raw", events, 640, 480)
    board = ["--columns", "4", "--rows", "3"]
    result = pecs_program("align", "intrinsics", "a.raw", *board, "-o", "camera.json", cwd=tmp_path)
    assert result.returncode == 4 and "the board in 0 views" in result.stderr
    assert not (tmp_path / "camera.json").exists()
    result = pecs_program("align", "intrinsics", "a.raw", "b.raw", *board, cwd=tmp_path)
    assert result.returncode == 4 and "b.raw: size: got 640 x 480 pixels, wanted 320 x 240" in result.stderr


def test_the_real_recording(pecs_program, shared, tmp_path):
    result = pecs_program("align", "detect", shared / "data/real/R_360_L.hdf5", "-o", tmp_path / "found.png", "--json")
    assert result.returncode == 0, result.stderr
    disk = json.loads(result.stdout)
    assert abs(disk["speed_deg_s"]["value"] - 2098) < 5
    assert (tmp_path / "found.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "found.png.run.json").read_text())["results"] == disk
