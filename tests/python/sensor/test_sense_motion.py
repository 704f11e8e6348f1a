"""`pecs sense` on stacks with the layer `motion`: events as from many more frames, loops, threads, wrong files."""

import json
import warnings

import numpy as np
import pecs
import pytest
from pecs_lab.measure import partners
from support.moving_scene import Scene, write_stack
from support.small_stacks import read_csv, sense

STEP_NS = 8_000_000
SCENE = Scene(96, 72, step=(8.0, 2.0), finest_px=12.0, radii=(22.0, 16.0), samples=8)


@pytest.fixture(scope="module")
def keyframes(tmp_path_factory):
    """Two keyframes, eight pixels apart."""
    frames = [SCENE.frame(t) for t in (0.0, 1.0)]
    return write_stack(tmp_path_factory.mktemp("keys") / "s", frames, [0, STEP_NS], [SCENE.motion()])


def events_of(pecs_program, stack, output, *args):
    sense(pecs_program, stack, "-o", output, "--chip", "ideal", *args)
    return read_csv(output)


def matched(found, wanted, within_us):
    """Share of the wanted events that have one of `found` at the same pixel and polarity, in order, so near in time."""
    times = {}
    for t, x, y, p in found:
        times.setdefault((x, y, p), []).append(t)
    hits = 0
    for t, x, y, p in wanted:
        waiting = times.get((x, y, p), [])
        near = [k for k in waiting if abs(k - t) <= within_us]
        if near:
            waiting.remove(min(near, key=lambda k: abs(k - t)))
            hits += 1
    return hits / len(wanted)


def test_events_are_those_of_many_frames(tmp_path, pecs_program, keyframes):
    fine = 32
    frames = [SCENE.frame(k / fine) for k in range(fine + 1)]
    dense = write_stack(tmp_path / "dense", frames, [k * STEP_NS // fine for k in range(fine + 1)])
    truth = events_of(pecs_program, dense, tmp_path / "truth.csv")
    carried = events_of(pecs_program, keyframes, tmp_path / "carried.csv")
    frozen = events_of(pecs_program, keyframes, tmp_path / "frozen.csv", "--no-motion")
    assert len(truth) > 5000
    pixel_us = STEP_NS / 1000 / 8
    assert matched(carried, truth, pixel_us / 5) > 0.84 and matched(truth, carried, pixel_us / 5) > 0.8
    assert matched(frozen, truth, pixel_us / 5) < 0.3
    records = [json.loads((tmp_path / f"{name}.csv.run.json").read_text()) for name in ("carried", "frozen", "truth")]
    assert [r["config"]["motion"] for r in records] == [True, False, False]
    # The longest path bends: the ellipse turns.
    assert 28 <= records[0]["results"]["dense_steps"] - 1 <= 41
    assert "dense_steps" not in records[1]["results"]


def sensed_with_noise(folder, lights, noises, motion, **options):
    """Report and events of a stack whose frames are `lights`, with samples of the renderer's noise."""
    write_stack(folder, lights, [i * STEP_NS for i in range(len(lights))], [motion] * (len(lights) - 1), light=False)
    stack = json.loads((folder / "stack.json").read_text()) | {"light": True, "noise": True}
    (folder / "stack.json").write_text(json.dumps(stack))
    with pecs.StackWriter(folder, stack) as writer:
        for i, (light, noise) in enumerate(zip(lights, noises, strict=True)):
            writer.write_frame(i, np.stack([light, noise]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of the share
        report = pecs.sense(folder, folder.with_suffix(".npz"), **{"chip": "ideal"} | options)
    return report["results"], pecs.read(folder.with_suffix(".npz"))


def share_alone(events, others, window_us):
    """The events without a partner within the window."""
    return 1 - len(partners(events, others, window_us)[0]) / len(events)


@pytest.mark.parametrize("sigma", [0.04, 0.08])
def test_events_of_the_renderers_noise(tmp_path, sigma):
    """The estimated share is that of events that differ between two stacks with independent noise."""
    noise_of, frames = np.random.default_rng(3).normal, [SCENE.frame(t) for t in (0.0, 1.0)]
    lights = [[1e-3 * np.exp(noise_of(0, sigma, f.shape)) * f for f in frames] for _ in range(2)]

    def run(name, light, noise, **options):
        noises = [noise * noise_of(0, sigma, f.shape) for f in frames]
        return sensed_with_noise(tmp_path / name, light, noises, SCENE.motion(), **options)

    found, events = run("a", lights[0], 1.0, labels=tmp_path / "labels.npy")
    _, others = run("b", lights[1], 1.0)
    found, camera = found["render_noise"], found["camera_noise"]
    wanted = share_alone(events, others, found["window_us"])
    assert camera["share"] == 0  # `ideal` has no noise
    assert len(events) > 3000 and 0.1 < wanted < 0.6 and found["share"] == pytest.approx(wanted, rel=0.3)
    labels = np.load(tmp_path / "labels.npy")
    assert 0.6 < (labels == pecs.sensor.LABELS.index("render")).mean() / found["share"] < 1

    assert run("still", lights[0], 0.0)[0]["render_noise"]["share"] == 0
    with_noise, without = run("one thread", lights[0], 1.0, threads=1)[1], run("off", lights[0], 1.0, render_noise=0)
    assert not {"render_noise", "camera_noise"} & without[0].keys() and (with_noise == without[1]).all()


def test_noise_decides_the_direction_of_pixels(tmp_path):
    """Pixels that have been on begin on the way to a threshold; where little changes, noise says to which."""
    rng, shape, sigma = np.random.default_rng(5), (SCENE.height, SCENE.width), 0.03
    real = [rng.choice([0.0, -0.1, 0.1], shape, p=(0.8, 0.1, 0.1)) for _ in range(2)]
    results = []
    for name in "ab":
        lights = [1e-3 * np.exp(of + rng.normal(0, sigma, shape)) for of in real]
        noises = [rng.normal(0, sigma, shape) for _ in lights]
        motion = SCENE.motion() / 8
        results.append(sensed_with_noise(tmp_path / name, lights, noises, motion, warmup_us=20_000))
    (found, events), (_, others) = results
    found = found["render_noise"]
    wanted = share_alone(events, others, found["window_us"])
    assert len(events) > 1000 and 0.2 < wanted < 0.8 and found["share"] == pytest.approx(wanted, rel=0.15)


def test_events_of_the_cameras_noise(tmp_path):
    """The estimated share is that of events that differ between two seeds of pixels that are all alike."""
    still = [np.full((SCENE.height, SCENE.width), 1e-3) * (1 - 0.3 * t) for t in (0.0, 1.0)]
    chip = {"chip": "davis346", "overrides": {"threshold_mismatch": 0, "noise_std": 0.05}, "readout": "ideal"}
    runs = []
    for seed in (1, 2):
        folder, noises = tmp_path / f"{seed}", [np.zeros_like(still[0])] * 2
        runs.append(sensed_with_noise(folder, still, noises, 0 * SCENE.motion(), seed=seed, **chip))
    (found, events), (_, others) = runs
    wanted = share_alone(events, others, found["camera_noise"]["window_us"])
    assert found["render_noise"]["share"] == 0 and len(events) > 1000
    assert 0.05 < wanted < 0.9 and found["camera_noise"]["share"] == pytest.approx(wanted, rel=0.1)
    other, _ = sensed_with_noise(tmp_path / "v2e", still, noises, 0 * SCENE.motion(), model="v2e")
    assert "render_noise" in other and "camera_noise" not in other  # its noise has no separate seed


def test_threads_change_nothing(tmp_path, pecs_program, keyframes):
    outputs = []
    for threads in (1, 2, 5):
        sense(pecs_program, keyframes, "-o", tmp_path / "o.csv", "--threads", threads)
        outputs.append((tmp_path / "o.csv").read_bytes())
    assert outputs[0] == outputs[1] == outputs[2] and len(outputs[0]) > 10000


def turning(frames):
    """A pattern of 60 pixels that moves on by its length in a loop, and its motion."""
    width, height = 60, 20
    x = np.arange(width)
    planes = []
    for i in range(frames):
        row = np.exp(0.2 * np.sin(2 * np.pi * (x / 60 - i / frames)) + 0.1 * np.cos(4 * np.pi * (x / 60 - i / frames)))
        planes.append(np.broadcast_to(row, (height, width)).astype(np.float32))
    motion = np.ones((20, height, width), np.float32)
    motion[1:8:2] = motion[11:18:2] = 0
    for k in range(4):
        motion[2 * k], motion[10 + 2 * k] = 60 / frames * (k + 1) / 4, -60 / frames * (k + 1) / 4
    return planes, motion


def test_loops_are_as_if_unrolled(tmp_path, pecs_program):
    planes, motion = turning(4)
    times = [i * 1_000_000 for i in range(9)]
    write_stack(tmp_path / "loop", planes, times[:4], [motion] * 4, period_ns=4_000_000)
    write_stack(tmp_path / "film", (planes * 3)[:9], times, [motion] * 8)
    window = ["--duration", "1500", "--readout", "ideal"]
    looped = events_of(pecs_program, tmp_path / "loop", tmp_path / "a.csv", "--warmup-loops", "1", *window)
    film = events_of(pecs_program, tmp_path / "film", tmp_path / "b.csv", "--start", "4000", *window)
    # The planes between frames are at other times.
    assert len(film) > 500 and abs(len(looped) - len(film)) < 0.02 * len(film) and matched(looped, film, 2) > 0.9
    record = json.loads((tmp_path / "a.csv.run.json").read_text())
    assert record["results"]["dense_steps"] > 5 * 30


def test_python_has_the_same_option(tmp_path, pecs_program, keyframes):
    sense(pecs_program, keyframes, "-o", tmp_path / "a.csv", "--no-motion")
    report = pecs.sense(keyframes, tmp_path / "b.csv", motion=False)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert report["config"]["motion"] is False
    assert pecs.sense(keyframes, tmp_path / "c.csv")["config"]["motion"] is True


def test_a_missing_or_wrong_motion_is_one_line(tmp_path, pecs_program, keyframes):
    frames, motion = [SCENE.frame(0)] * 3, SCENE.motion()
    stack = write_stack(tmp_path / "s", frames, [0, 10_000, 20_000], [motion, motion])

    def refused(folder, *wanted):
        done = pecs_program("sense", folder, "-o", tmp_path / "o.csv", "--quiet")
        assert done.returncode in (3, 4) and len(done.stderr.splitlines()) == 1, done.stderr
        assert all(text in done.stderr for text in wanted), done.stderr
        assert not (tmp_path / "o.csv").exists()

    (stack / "motion_000001.exr").rename(stack / "away.exr")
    refused(stack, "motion_000001.exr: cannot be opened: no such file")
    sense(pecs_program, stack, "-o", tmp_path / "fine.csv", "--no-motion")
    (stack / "motion_000001.exr").write_bytes((stack / "away.exr").read_bytes()[:5000])
    refused(stack, "motion_000001.exr")
    (stack / "motion_000001.exr").write_bytes((stack / "motion_000000.exr").read_bytes())
    refused(stack, "motion_000001.exr", "pecsTimeNs")
    text = (stack / "stack.json").read_text()
    (stack / "stack.json").write_text(text.replace('"x_mid"', '"u_mid"'))
    refused(stack, "stack.json: layers: motion: channels: got x_q1 y_q1 u_mid", "wanted x_q1 y_q1 x_mid")
    (stack / "stack.json").write_text(text.replace('"interval"', '"instant"'))
    refused(stack, "stack.json: layers: motion: at: got instant, wanted interval")


def test_subpixels_are_carried_and_averaged(tmp_path, pecs_program, keyframes):
    """Keyframes with pixels of half the size are carried as they are, and give sharper light."""
    fine = Scene(192, 144, step=(16.0, 4.0), finest_px=12.0, radii=(44.0, 32.0), samples=4)
    frames, motion = [fine.frame(t) for t in (0.0, 1.0)], fine.motion()
    write_stack(tmp_path / "fine", frames, [0, STEP_NS], [motion], subpixels=2)
    parts = 16
    planes = [fine.frame(k / parts).reshape(72, 2, 96, 2).mean((1, 3)) for k in range(parts + 1)]
    write_stack(tmp_path / "dense", planes, [k * STEP_NS // parts for k in range(parts + 1)])
    truth = events_of(pecs_program, tmp_path / "dense", tmp_path / "truth.csv")
    carried = events_of(pecs_program, tmp_path / "fine", tmp_path / "carried.csv")
    assert len(truth) > 5000
    assert matched(carried, truth, 100) > 0.88 and matched(truth, carried, 100) > 0.87
    # A step is 0.3 of a pixel, not of a subpixel.
    assert json.loads((tmp_path / "carried.csv.run.json").read_text())["results"]["dense_steps"] - 1 <= 41


def lamp(t):
    """A light that goes up and down again within an interval, on the left half."""
    return np.where(np.arange(SCENE.width) < 48, np.exp(0.9 * np.sin(np.pi * t) ** 2), 1.0).astype(np.float32)


def test_what_was_rendered_between_is_heeded(tmp_path, pecs_program):
    """Motion explains the ellipse, not the lamp: a few pictures of the lit half do."""
    parts = 16
    fine = [SCENE.frame(k / parts) * lamp(k / parts) for k in range(parts + 1)]
    dense = write_stack(tmp_path / "dense", fine, [k * STEP_NS // parts for k in range(parts + 1)])
    unlit = np.where(np.arange(SCENE.width) < 48, np.float32(1), np.float32("nan"))
    between = [(0, 2 * k, k * STEP_NS // parts, fine[k] * unlit) for k in range(2, parts, 2)]
    ends, times, motion = [fine[0], fine[-1]], [0, STEP_NS], [SCENE.motion()]
    refined = write_stack(tmp_path / "refined", ends, times, motion, between=between)
    plain = write_stack(tmp_path / "plain", ends, times, motion)
    truth = events_of(pecs_program, dense, tmp_path / "truth.csv")
    found = events_of(pecs_program, refined, tmp_path / "found.csv")
    carried = events_of(pecs_program, plain, tmp_path / "carried.csv")
    lit = [events[events[:, 1] < 48] for events in (truth, found, carried)]
    assert matched(lit[1], lit[0], 200) > 0.9 and matched(lit[2], lit[0], 200) < 0.6 and len(lit[0]) > 5000
    # The other half is warped as before, except for the times of its planes.
    others = [np.count_nonzero(events[:, 1] >= 48) for events in (found, carried)]
    assert abs(others[0] - others[1]) < 0.02 * others[1]


def test_a_still_scene_under_a_lamp(tmp_path, pecs_program):
    """Nothing moves: the pictures between alone say when the light changes, and pixels that none shows stay silent."""
    still = SCENE.frame(0)
    between = [(0, k, k * STEP_NS // 8, np.where(lamp(k / 8) > 1, still * lamp(k / 8), np.nan)) for k in range(1, 8)]
    motion = np.zeros((20, *still.shape), np.float32)
    stack = write_stack(tmp_path / "s", [still, still], [0, STEP_NS], [motion], between=between)
    events = events_of(pecs_program, stack, tmp_path / "o.csv")
    # 0.9 up are 4 thresholds of 0.2; down again are 3, and the fourth is met exactly.
    assert (events[:, 1] < 48).all() and 7 * 48 * SCENE.height <= len(events) <= 8 * 48 * SCENE.height
    assert json.loads((tmp_path / "o.csv.run.json").read_text())["results"]["dense_steps"] == 9
    assert len(events_of(pecs_program, stack, tmp_path / "o.csv", "--no-motion")) == 0


def test_pictures_between_at_wrong_times_are_one_line(tmp_path, pecs_program):
    still = SCENE.frame(0)
    motion = np.zeros((20, *still.shape), np.float32)
    between = [(0, 0, 1000, still), (0, 3, 2000, still)]
    stack = write_stack(tmp_path / "s", [still, still], [0, STEP_NS], [motion], between=between)
    sense(pecs_program, stack, "-o", tmp_path / "o.csv")
    (stack / "between_000000_000005.exr").write_bytes((stack / "between_000000_000000.exr").read_bytes())
    done = pecs_program("sense", stack, "-o", tmp_path / "p.csv", "--quiet")
    assert done.returncode == 4 and len(done.stderr.splitlines()) == 1
    assert "between_000000_000005.exr: pecsTimeNs: got 1000, wanted more than 2000" in done.stderr


def pushed(frames, t_us, motions, **options):
    """Events of frames given one by one, each with the motion before it."""
    with pecs.Sensor(SCENE.width, SCENE.height, photocurrent_a=1e-15, **options) as sensor:
        parts = [sensor.push(frames[0], t_us[0])]
        for frame, t, motion in zip(frames[1:], t_us[1:], motions, strict=True):
            parts.append(sensor.push(frame, t, motion=motion))
        return np.concatenate([*parts, sensor.finish()])


def test_pushed_frames_give_the_same_events(tmp_path, pecs_program):
    there, back = SCENE.motion(), SCENE.motion()[[*range(10, 20), *range(10)]]
    ends = [SCENE.frame(0), SCENE.frame(1)]
    stack = write_stack(tmp_path / "s", [*ends, ends[0]], [0, STEP_NS, 2 * STEP_NS], [there, back])
    sense(pecs_program, stack, "-o", tmp_path / "o.csv", "--seed", 3)
    wanted = read_csv(tmp_path / "o.csv")
    chip, reader = pecs.Chip("imx636"), pecs.StackReader(stack)
    frames = [(1e15 * chip.photocurrent(reader, i)).astype(np.float32) for i in range(3)]
    t_us = np.array([0, STEP_NS, 2 * STEP_NS]) / 1000
    events = pushed(frames, t_us, [there, back], seed=3)
    assert len(events) > 5000
    # The light differs by its rounding: by an event here and there.
    assert abs(len(events) - len(wanted)) < 5
    assert matched(np.stack([events[k] for k in "txyp"], 1).astype(int), wanted, 2) > 0.998
    # Together, and with a motion for the first frame too, which is not looked at.
    with pecs.Sensor(SCENE.width, SCENE.height, photocurrent_a=1e-15, seed=3) as sensor:
        together = sensor.push(np.stack(frames), t_us, last=True, motion=np.stack([there * np.nan, there, back]))
    assert np.array_equal(together, events)


def test_optical_flow_may_be_pushed(tmp_path):
    motion = SCENE.motion()
    frames, t_us = [SCENE.frame(0), SCENE.frame(1)], [0, STEP_NS / 1000]
    full = pushed(frames, t_us, [motion], chip="ideal")
    flow = pushed(frames, t_us, [motion[[6, 7, 16, 17]]], chip="ideal")
    frozen = pushed(frames, t_us, [np.full((2, *SCENE.frame(0).shape), np.nan)], chip="ideal")
    plain = np.concatenate([pecs.simulate(np.stack(frames), t_us, "ideal", photocurrent_a=1e-15)])
    columns = [np.stack([events[k] for k in "txyp"], 1).astype(int) for events in (full, flow, frozen, plain)]
    assert matched(columns[1], columns[0], 200) > 0.8 > 0.4 > matched(columns[2], columns[0], 200)
    assert np.array_equal(columns[2], columns[3])
    with pecs.Sensor(SCENE.width, SCENE.height) as sensor:
        sensor.push(frames[0], 0)
        with pytest.raises(ValueError, match="motion: got shape"):
            sensor.push(frames[1], 1000, motion=motion[:3])
