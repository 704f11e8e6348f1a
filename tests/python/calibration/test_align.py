import json

import cv2
import numpy as np
import pecs
import pytest
from support import pecs_blender


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


def test_a_picture_is_one_whatever_the_case_of_its_extension(pecs_program, tmp_path):
    for name in ("b.png", "b.PNG"):
        cv2.imwrite(str(tmp_path / name), np.zeros((240, 320), np.uint8))
        done = pecs_program("align", "intrinsics", name, "--columns", "4", "--rows", "3", cwd=tmp_path)
        assert done.returncode == 4 and "the board in 0 views" in done.stderr


def test_align_needs_a_scene_that_fits(pecs_program, root, tmp_path):
    events = np.zeros(5000, pecs.EVENT_DTYPE)
    events["t"] = np.arange(5000)
    pecs.write(tmp_path / "small.raw", events, 320, 240)
    result = pecs_program("align", "small.raw", "--scene", root / "scenes/board", cwd=tmp_path)
    assert result.returncode == 4 and "got 320 x 240 pixels, wanted 1280 x 720 of 4.86 um" in result.stderr
    result = pecs_program("align", "small.raw", "--scene", root / "scenes/room", cwd=tmp_path)
    assert result.returncode == 6 and "scenes/board" in result.stderr
    result = pecs_program("align", "small.raw", cwd=tmp_path)
    assert result.returncode == 2 and "--scene" in result.stderr


def disk_events(random, count=40_000, centre=(160, 120), radius=100, span_us=60_000):
    """Events of a disk of four sectors on 320 x 240 pixels, -2000 deg/s, shortly behind their edges."""
    events = np.zeros(count, pecs.EVENT_DTYPE)
    t, edge = np.sort(random.integers(0, span_us, count)), random.integers(0, 4, count)
    angle = np.radians(90 * edge - 2000e-6 * t + 3 * random.random(count))
    radius = radius * np.sqrt(random.random(count))
    x, y = centre[0] + radius * np.cos(angle), centre[1] - radius * np.sin(angle)
    seen = (x >= 0) & (x < 320) & (y >= 0) & (y < 240)
    events["t"], events["p"], events["x"], events["y"] = t, edge % 2, np.where(seen, x, 0), np.where(seen, y, 0)
    return events[seen]


def detected(pecs_program, folder, events):
    pecs.write(folder / "disk.npz", events, 320, 240)
    return pecs_program("align", "detect", "disk.npz", "--json", cwd=folder)


def test_a_clock_that_wraps_changes_nothing(pecs_program, tmp_path):
    events = disk_events(np.random.default_rng(1))
    plain = json.loads(detected(pecs_program, tmp_path, events).stdout)
    events["t"] = (events["t"] + 2**24 - 30_000) % 2**24
    rows = "".join(f"{e['t']},{e['x']},{e['y']},{e['p']}\n" for e in events)
    (tmp_path / "wraps.csv").write_text("t_us,x,y,p\n" + rows)
    wraps = pecs_program("align", "detect", "wraps.csv", "--json", cwd=tmp_path, check=True)
    assert "the timestamps wrap after 16777216 us" in wraps.stderr
    found = json.loads(wraps.stdout)
    assert found["speed_deg_s"]["value"] == pytest.approx(plain["speed_deg_s"]["value"], rel=1e-3)
    assert abs(found["speed_deg_s"]["value"] + 2000) < 5


def test_more_turns_with_the_same_latencies_do_not_sharpen_the_centre(pecs_program, tmp_path):
    half_turn_us = 90_000
    half_turn = disk_events(np.random.default_rng(1), span_us=half_turn_us)
    turns = np.concatenate([half_turn] * 4)
    turns["t"] += np.repeat(np.arange(4) * half_turn_us, len(half_turn))
    one, four = (
        json.loads(detected(pecs_program, tmp_path, events).stdout)["centre_x"]["deviation"]
        for events in (half_turn, turns)
    )
    assert four > 0.7 * one


def test_a_disk_partly_out_of_view(pecs_program, tmp_path):
    events = disk_events(np.random.default_rng(1), centre=(250, 120))  # a sixth of it is outside
    result = detected(pecs_program, tmp_path, events)
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout)
    assert abs(found["centre_x"]["value"] - 250) < 0.3 and abs(found["speed_deg_s"]["value"] + 2000) < 10
    assert abs(found["rim"]["axis_a_px"] / 2 - 100) < 1


def test_two_seconds_of_noise_align_nothing(pecs_program, root, tmp_path):
    random = np.random.default_rng(1)
    events = np.zeros(100_000, pecs.EVENT_DTYPE)
    for key, end in (("x", 320), ("y", 240), ("p", 2), ("t", 2_000_000)):
        events[key] = random.integers(0, end, len(events))
    pecs.write(tmp_path / "noise.npz", np.sort(events, order="t"), 320, 240)
    for scene in ("board", "rotating_disk"):
        result = pecs_program(
            "align", "noise.npz", "--scene", root / "scenes" / scene, "--pixel-pitch", 19.44, "-o", "a.json",
            cwd=tmp_path,
        )  # fmt: skip
        assert result.returncode == 4 and "nothing found" in result.stderr, result.stderr
        assert len(result.stderr.splitlines()) == 1 and not (tmp_path / "a.json").exists()


def test_a_simulation_of_another_size_is_refused(pecs_program, root, tmp_path):
    events = disk_events(np.random.default_rng(1))
    pecs.write(tmp_path / "real.npz", events, 320, 240)
    pecs.write(tmp_path / "sim.npz", events, 640, 480)
    result = pecs_program(
        "align", "real.npz", "--scene", root / "scenes/rotating_disk", "--pixel-pitch", 19.44, "--sim", "sim.npz",
        cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 4, result.stderr
    assert "sim.npz: size: got 640 x 480 pixels, wanted 320 x 240, as in real.npz" in result.stderr


def test_the_real_recording(pecs_program, shared, tmp_path):
    result = pecs_program(
        "align", "detect", shared / "data/real/R_360_L.hdf5", "-o", tmp_path / "found.png", "--json", check=True
    )
    disk = json.loads(result.stdout)
    assert abs(disk["speed_deg_s"]["value"] - 2098) < 5
    assert (tmp_path / "found.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "found.png.run.json").read_text())["results"] == disk


def test_an_aligned_scene_is_rendered_as_it_was_seen(pecs_program, root, tmp_path):
    """A recording drawn through the lens by pecs_lab; aligned; rendered by Cycles: the same picture."""
    pytest.importorskip("bpy")
    from pecs_lab import lab_views as lab

    size = (640, 360)
    camera = lab.Camera("pecs_lab_15mm", 1.56, *size, 0.00972, stop_diameter_mm=1.0)
    turn = lab.turn_of((92.0, 1.0, 3.0))
    start, velocity = turn @ [20.0, -10.0, 1450.0], turn @ [-900.0, 0.0, 0.0]
    board = lab.Board(turn, tuple(start), tuple(velocity), plate_mm=(419 - 4 * 41.7) / 2)
    (events,) = lab.record(board.light(camera), np.arange(0, 0.0402, 5e-4), size, [1], 1e-11)
    pecs.write(tmp_path / "real.raw", events, *size)
    pecs_program(
        "align", "real.raw", "--scene", root / "scenes/board", "--pixel-pitch", 9.72, "--views", 4,
        "-o", "aligned.json", "--picture", "overlay.png", cwd=tmp_path,
        check=True,
    )  # fmt: skip
    aligned = json.loads((tmp_path / "aligned.json").read_text())
    assert abs(aligned["parameters"]["speed_m_per_s"] - 0.9) < 0.01
    assert aligned["residual"]["rms_px"] < 0.3
    assert (tmp_path / "overlay.png").read_bytes().startswith(b"\x89PNG")

    args = ("--set", f"@{tmp_path}/aligned.json", "--frames", 1, "--bands", 1, "--width", 640, "--samples", 4)
    pecs_blender("render", root / "scenes/board", "-o", tmp_path / "stack", *args)
    with pecs.StackReader(tmp_path / "stack") as reader:
        picture = reader.read_frame(0).reshape(360, 640)
    drawn = board.light(camera)(0.0)
    y, x = np.round(board.seen(camera, 0.0).mean(axis=0)[::-1]).astype(int)
    near = np.s_[y - 60 : y + 60, x - 60 : x + 60]  # within the plate
    middle = (picture[near].min() + picture[near].max()) / 2
    different = (picture[near] > middle) != (drawn[near] > (lab.BLACK + lab.WHITE) / 2)
    assert different.mean() < 0.04, different.mean()  # edges off by half a pixel are 2 %
