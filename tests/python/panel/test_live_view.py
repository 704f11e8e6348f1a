"""The live view without a window: light to events and their picture, time, recording; register and unregister."""

import numpy as np
import pecs
import pytest
from pecs_blender.ui import live_sensor
from support import in_bpy

WIDTH, HEIGHT, DT_S = 40, 30, 1 / 24


def pictures(count=8):
    """[count, height, width, 4] linear RGBA, row 0 at the bottom: a bright, coloured bar moves to the right and up."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    out = np.ones((count, HEIGHT, WIDTH, 4), np.float32)
    for i in range(count):
        bar = (np.abs(x - 3 * i - 5) < 4) & (y > 2 * i)
        out[i, ..., :3] = np.where(bar[..., None], (0.9, 0.5, 0.2), 0.1)
    return out


def pushed(sensor, rgba):
    return [sensor.push(sensor.light(picture), DT_S * (i > 0)) for i, picture in enumerate(rgba)]


def test_events_are_those_of_the_sensor():
    rgba, sensor = pictures(), live_sensor.LiveSensor(WIDTH, HEIGHT, threshold=0.15)
    ours = np.concatenate(pushed(sensor, rgba))
    light = np.stack([sensor.light(picture)[::-1] for picture in rgba])
    values = {"contrast_threshold_on": 0.15, "contrast_threshold_off": 0.15, "dark_current_a": live_sensor.DARK_A}
    times = 1e6 * (1 + DT_S * np.arange(len(rgba)))
    all_events = np.asarray(pecs.simulate(light, times, "ideal", overrides=values, readout="ideal"))
    known = all_events[: len(ours)]
    assert len(ours) > 2000 and len(all_events) > len(ours)  # those of the last interval are still to come
    for name in "txyp":
        np.testing.assert_array_equal(ours[name], known[name])
    assert ours["t"].max() < 1e6 * sensor.known_s <= all_events["t"][len(ours)] + 1e-3


def test_the_picture_has_each_pixels_last_event():
    sensor = live_sensor.LiveSensor(WIDTH, HEIGHT)
    wanted = np.zeros((HEIGHT, WIDTH))
    for events in pushed(sensor, pictures()):
        for t, x, y, p in events.tolist():
            wanted[HEIGHT - 1 - y, x] = t * 1e-6 if p else -t * 1e-6
    np.testing.assert_allclose(sensor.last_s, wanted, rtol=1e-6)
    assert (wanted > 0).sum() > 50 and (wanted < 0).sum() > 50


def test_white_is_one_as_pecs_sense_weighs_rgb():
    weights = live_sensor.rgba_weights(pecs.Chip("imx636"))
    assert weights.sum() == pytest.approx(1) and weights[3] == 0 and min(weights[:3]) > 0.1
    bands = [{"lambda_nm": nm, "weight_nm": 1} for nm in (610, 550, 465)]
    amperes = np.array(pecs.Chip("imx636").amperes_per_unit(bands, "relative", photocurrent_a=1))
    np.testing.assert_allclose(weights[:3], amperes / amperes.sum(), rtol=1e-6)


def test_black_fires_no_storm():
    sensor = live_sensor.LiveSensor(4, 4)
    levels = (0, 0, 1, 1, 1)
    count = sum(len(sensor.push(np.full((4, 4), v, np.float32), DT_S * (i > 0))) for i, v in enumerate(levels))
    assert count == 16 * int(np.log(1001) / 0.2)


def test_the_rate_is_that_of_the_scenes_time():
    sensor, count = live_sensor.LiveSensor(WIDTH, HEIGHT), 0
    rgba = pictures(4)
    for i in range(200):
        count += len(sensor.push(sensor.light(rgba[i % 4]), DT_S))
    assert sensor.rate_hz == pytest.approx(count / (200 * DT_S), rel=0.25)


@pytest.mark.parametrize("size", [(30, 40), (15, 10), (7, 13), (60, 80), (30, 10)])
def test_shrink_keeps_the_mean_light(size):
    light = np.random.default_rng(1).random((30, 40), np.float32)
    small = live_sensor.shrink(light, *size)
    assert small.shape == size
    if 30 % size[0] == 0 and 40 % size[1] == 0:
        blocks = light.reshape(size[0], 30 // size[0], size[1], 40 // size[1])
        np.testing.assert_allclose(small, blocks.mean(axis=(1, 3)), rtol=1e-5)
    np.testing.assert_allclose(live_sensor.shrink(np.full((30, 40), 0.5, np.float32), *size), 0.5)
    assert light.min() <= small.min() and small.max() <= light.max()


@pytest.mark.parametrize("block", [1.98, 3.97, 8])
def test_coarse_pictures_consist_of_blocks(block):
    """The picture's size need not be a multiple of the block's."""
    fine = np.random.default_rng(1).random((120, 161), np.float32)
    fine[:, :10] = 0.5  # a part may be plain
    y, x = (np.arange(n) // block for n in fine.shape)
    coarse = fine[np.ix_(y.astype(int), x.astype(int))]
    assert live_sensor.is_coarse(coarse) and not live_sensor.is_coarse(fine)
    assert live_sensor.is_coarse(np.zeros_like(fine))


def test_clock_takes_the_scenes_time_while_it_plays():
    clock = live_sensor.Clock()
    step = lambda frame, wall_s, playing=True: clock.step(frame, wall_s, playing, 25.0, 100)  # noqa: E731
    assert step(1, 0.0).dt_s == 0
    one = step(2, 0.5)
    assert one.dt_s == pytest.approx(0.04) and one.forward and clock.dropped == 0
    assert step(2, 0.6).dt_s == 0  # the same frame, drawn again
    three = step(5, 0.7)
    assert three.dt_s == pytest.approx(0.12) and three.frames == 3 and clock.dropped == 2
    step(100, 0.8)
    again = step(1, 0.9)
    assert again.dt_s == pytest.approx(0.04) and not again.forward  # nothing lies between the last and the first
    step(10, 1.0)
    back = step(9, 1.1)
    assert back.dt_s == pytest.approx(0.04) and not back.forward


def test_clock_takes_the_walls_time_while_things_are_dragged():
    clock = live_sensor.Clock()
    for wall_s, wanted in ((10.0, 0), (10.02, 0.02), (70.0, live_sensor.MAX_WALL_S), (70.01, 0.01)):
        assert clock.step(7, wall_s, False, 24, 250).dt_s == pytest.approx(wanted)
    assert clock.step(8, 70.03, True, 24, 250).dt_s == pytest.approx(0.02)  # it has just begun to play
    assert clock.dropped == 0


def test_subframes_fill_half_a_frame():
    assert live_sensor.subframes_that_fit(8, 0.0, 1 / 24) == 8
    assert live_sensor.subframes_that_fit(8, 0.001, 1 / 24) == 8
    assert live_sensor.subframes_that_fit(8, 0.005, 1 / 24) == 4
    assert live_sensor.subframes_that_fit(8, 0.1, 1 / 24) == 1


def test_recording(tmp_path):
    rgba, sensor, path = pictures(), live_sensor.LiveSensor(WIDTH, HEIGHT), tmp_path / "live.raw"
    before = pushed(sensor, rgba)
    sensor.record(path)
    assert not path.exists()
    after = np.concatenate([sensor.push(sensor.light(picture), DT_S) for picture in rgba])
    assert sensor.stop_recording() == len(after) > 1000 and sensor.recording is None
    read = pecs.read(path)
    assert (read.width, read.height) == (WIDTH, HEIGHT) and sum(map(len, before)) > 0
    np.testing.assert_array_equal(read["t"], after["t"] - after["t"][0])
    np.testing.assert_array_equal(read["x"], after["x"])


def test_a_closed_view_leaves_a_whole_recording(tmp_path):
    sensor = live_sensor.LiveSensor(WIDTH, HEIGHT)
    sensor.record(tmp_path / "live.npz")
    count = sum(map(len, pushed(sensor, pictures())))
    sensor.close()
    assert len(pecs.read(tmp_path / "live.npz")) == count > 0
    assert [p.name for p in tmp_path.iterdir()] == ["live.npz"]


def test_a_recording_that_fails_ends_alone(tmp_path):
    sensor = live_sensor.LiveSensor(WIDTH, HEIGHT)
    with pytest.raises(pecs.PecsError, match="cannot be"):
        sensor.record(tmp_path / "no_folder" / "live.raw")
    assert sensor.recording is None
    sensor.record(tmp_path / "live.raw")
    sensor.recording.close()  # as a disk that fails under it
    with pytest.raises(ValueError, match="closed"):
        pushed(sensor, pictures())
    assert sensor.recording is None and not (tmp_path / "live.raw").exists()
    assert len(sensor.push(sensor.light(pictures()[0]), DT_S)) > 0  # the view goes on


BLENDER = """
import bpy
from pecs_blender import ui
handlers = lambda: {n: len(h) for n, h in vars(type("H", (), {n: getattr(bpy.app.handlers, n) for n in
    ("load_pre", "load_post", "depsgraph_update_post", "frame_change_post")})).items() if isinstance(h, list)}
def classes():
    return {n for n in dir(bpy.types) if n.lower().startswith("pecs")}
before = handlers(), classes()
for _ in range(100):
    ui.register()
    during = handlers(), classes()
    ui.unregister()
    assert (handlers(), classes()) == before, (handlers(), classes())
    assert not any(hasattr(bpy.types.Scene, n) for n in ("pecs", "pecs_live"))
assert during != before
from types import SimpleNamespace
from mathutils import Matrix, Vector
from pecs_blender.ui import live_view
region = SimpleNamespace(width=800, height=300)
x, y, w, h = live_view.centred(346, 260, region)
assert (y, h) == (0, 300) and abs(w / h - 346 / 260) < 1e-9 and abs(x + w / 2 - 400) < 1e-9
whole = Matrix.Diagonal((0.7, 0.9, 1, 1))  # of the region
part = live_view.part_of_view(whole, (x, y, w, h), region)
corner = Vector((x + w, y + h, 0, 1))  # in pixels; seen in the region at
seen = Vector((2 * corner.x / 800 - 1, 2 * corner.y / 300 - 1, 0, 1))
assert all(abs(abs(v) - 1) < 1e-6 for v in (part @ whole.inverted() @ seen).xy)
assert live_view.inset(346, 260, region)[2] < 400
ui.register()
assert not bpy.ops.pecs.live.poll() and not bpy.ops.pecs.live_record.poll()  # no window
s = bpy.context.scene.pecs_live
s.width, s.threshold, s.pixel = 64, 0.3, "CHIP"  # nothing runs: nothing happens
bpy.ops.wm.read_factory_settings()
"""


def test_nothing_stays_behind():
    pytest.importorskip("bpy")
    in_bpy(BLENDER)
