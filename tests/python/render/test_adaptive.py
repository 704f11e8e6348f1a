"""--time adaptive: keyframes, motion and pictures between them, in the scenes of scripts/bench/motion_scenes.py."""

import json
import os
import re
import shutil
import subprocess
import sys
import warnings

import numpy as np
import pecs
import pytest
from support import in_bpy, load_script, pecs_blender

FRAMES, TURN_RAD = 17, 0.8
COMMON = ("--bands", 3, "--fps", 1000, "--frames", FRAMES, "--samples", 4)


@pytest.fixture(scope="module")
def blends(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("adaptive")
    names = ("room", "shadow", "mirror", "flicker", "lamps", "still")
    subprocess.run([sys.executable, root / "scripts/bench/motion_scenes.py", folder, *names], check=True)
    return folder


@pytest.fixture(scope="module")
def bench(root):
    return load_script(root / "scripts/bench/motion.py")


def render(blends, name, *args):
    """The folder of a stack, rendered once."""
    folder = blends / "-".join(map(str, (name, *args)))
    if not folder.is_dir():
        pecs_blender("render", blends / f"{name}.blend", "-o", folder, *COMMON, *args)
    return folder


def adaptive(blends, name, *args):
    return render(blends, name, "--time", "adaptive", *args)


def files(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.exr")}


def between(folder):
    return sorted(path.name for path in folder.glob("between_*.exr"))


def test_keyframes_are_instants_of_the_plan(blends):
    folder = adaptive(blends, "room")
    stack = json.loads((folder / "stack.json").read_text())
    times = stack["times_ns"]
    assert times[0] == 0 and times[-1] == (FRAMES - 1) * 1_000_000
    assert all(t % 1_000_000 == 0 for t in times) and len(times) <= FRAMES / 5
    assert (stack["width"], stack["height"], stack["subpixels"], stack["between"]) == (96, 54, 2, True)
    assert [layer["name"] for layer in stack["layers"]] == ["motion"]
    with pecs.StackReader(folder) as reader:
        motion = reader.read_layer("motion", 0)
    assert 10 < np.nanmax(np.hypot(motion[6], motion[7])) / 2 <= 25  # pixels: of the default, 24


def test_the_plan_measures_an_interval(blends):
    folder = adaptive(blends, "room")
    args = ("-o", blends / "plan", *COMMON, "--time", "adaptive", "--plan")
    said = pecs_blender("render", blends / "room.blend", *args).stderr
    assert " % of them by the renderer's noise, median " in said
    path = blends / "turns.txt"  # about z, slowest in the middle, which is measured
    part = np.linspace(0, 1, FRAMES)
    half_rad = 0.5 * TURN_RAD * (part + 0.8 / (2 * np.pi) * np.sin(2 * np.pi * part))
    s, c, r = np.sin(half_rad), np.cos(half_rad), np.full(FRAMES, 0.5**0.5)
    np.savetxt(path, np.stack([0.001 * np.arange(FRAMES), 0 * r, 0 * r, 1 + 0 * r, -c * r, -s * r, s * r, c * r], 1))
    plain = pecs_blender(
        "render", blends / "room.blend", *args, "--no-denoise", "--samples", 1, "--camera-path", path
    ).stderr
    assert "events of " in plain and "renderer's noise" not in plain
    px_per_s = float(re.search(r"median (\S+) px/s", plain)[1])
    assert 1 < px_per_s / (96 * TURN_RAD / (0.001 * (FRAMES - 1))) < 1.25, plain  # more off the axis
    megabytes = float(re.search(r"about ([\d.]+) MB on the disk", said)[1])
    size = sum(path.stat().st_size for path in folder.glob("*.exr"))
    assert abs(megabytes * 1e6 / size - 1) < 0.4 and not (blends / "plan").exists()


def test_fewer_frames_give_the_same_events(blends, bench):
    truth = bench.events(
        render(blends, "room", "--fps", 2000, "--frames", 2 * FRAMES - 1, "--samples", 32, "--seed", 9)
    )
    every = bench.score(truth, bench.events(render(blends, "room")), 1000)
    few = bench.score(truth, bench.events(adaptive(blends, "room")), 1000)
    alone = bench.score(truth, bench.events(adaptive(blends, "room"), motion=False), 1000)
    assert few["recall"] > every["recall"] - 0.08 and few["precision"] > every["precision"] + 0.1
    assert few["recall"] > 2 * alone["recall"]


@pytest.mark.parametrize("time, rate, frames", [("adaptive", 1300, 22), ("uniform", 500, 9)])
def test_events_with_noise_do_not_know_the_rate(blends, tmp_path, time, rate, frames):
    """One scene at two rates, all noise of the camera included."""
    counts = []
    for args in ((), ("--fps", rate, "--frames", frames)):
        folder = render(blends, "room", "--time", time, "--layers", "motion", "--samples", 32, *args)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of the renderer's noise
            pecs.sense(folder, tmp_path / "e.npz", chip="imx636", fnumber=2.0, readout="ideal")
        counts.append(np.histogram(pecs.read(tmp_path / "e.npz")["t"], 8, (0, 16_000))[0])
    assert np.abs(counts[0] / counts[1] - 1).max() < 0.08, counts


def test_denoising_removes_the_noise_and_threads_change_nothing(blends):
    """Relative, against many samples; by half at least."""
    clean, noisy = adaptive(blends, "room"), adaptive(blends, "room", "--no-denoise")
    error = []
    with pecs.StackReader(adaptive(blends, "room", "--no-denoise", "--samples", 256, "--seed", 9)) as reader:
        truth = reader.read_frame(0).mean(0)
    for folder in (noisy, clean):
        with pecs.StackReader(folder) as reader:
            error.append(np.std(reader.read_frame(0).mean(0) / truth))
    print(f"noise {error[0]:.3f}, denoised {error[1]:.3f}")
    assert error[1] < error[0] / 2
    assert files(adaptive(blends, "room", "--threads", 1)) == files(clean)


BLACK = """
import numpy as np
from pecs_blender.camera.denoise import Denoiser
light, guides = (np.zeros((n, 96, 96), np.float32) for n in (3, 6))
light[:, 48:] = np.random.default_rng(0).gamma(4, 5e-5, (3, 48, 96))
guides[:3], guides[5] = 0.5, 1
clean = Denoiser()(light, guides)
assert not clean[:, :46].any() and clean[:, 50:].min() > 0  # a surface in the dark
guides[:, :48] = 0
assert not Denoiser()(light, guides)[:, :48].any()  # no surface
assert not Denoiser()(np.zeros_like(light), guides).any()
"""


def test_a_black_sky_stays_black():
    in_bpy(BLACK)


def test_the_share_of_noise_events_is_that_between_two_renders(blends, bench):
    events, share = bench.simulated(adaptive(blends, "room"))
    again = bench.events(adaptive(blends, "room", "--seed", 2))
    wanted = 1 - bench.score(again, events, 5000)["precision"]
    assert 0.1 < wanted < 0.3 and abs(share / wanted - 1) < 1 / 3


TYPICAL = """
from pecs_blender.adaptive.keyframes import Keyframes
from pecs_blender.scene.timeline import Timeline
grid = Timeline(list(range(0, 1100, 100)), None)
for partial, at in ((), 400), ((4, 5, 6, 7), 200), ((2, 8), 400), ((1, 2, 3, 4, 5, 6, 7, 8, 9), 0):
    found = Keyframes(grid, list(range(11)), partial, (1.0,) * 10).typical(2)
    assert found.grid.times_ns[0] == at, (partial, found)
    assert len(found.whole) == 2 and len(found.paths_px) == len(found.keys) - 1 == found.keys[-1]
"""


def test_an_estimate_is_of_as_many_partial_keyframes_as_on_average():
    in_bpy(TYPICAL)


def test_samples_are_chosen_for_a_share_of_noise_events(blends, bench):
    folder = adaptive(blends, "room", "--noise-events", "12%")
    samples = json.loads((folder / "stack.json").read_text())["render"]["samples"]
    assert samples >= 16 and 0.05 < bench.simulated(folder)[1] < 0.15


@pytest.mark.parametrize("name", ["shadow", "flicker"])
def test_pictures_between_show_what_motion_does_not_explain(blends, bench, name):
    folder = adaptive(blends, name)
    assert len(between(folder)) > FRAMES / 2
    truth = bench.events(render(blends, name, "--fps", 2000, "--frames", 2 * FRAMES - 1, "--samples", 32, "--seed", 9))
    every = bench.score(truth, bench.events(render(blends, name)), 1000)
    few = bench.score(truth, bench.events(folder), 1000)
    assert few["recall"] > every["recall"] - 0.02 and few["precision"] > every["precision"] - 0.02


def test_lamps_of_any_strength_are_as_rendered(blends):
    """One is off half of the time, one is instanced and fades, and so does the sky."""
    folder, every = adaptive(blends, "lamps"), render(blends, "lamps", "--samples", 16)
    chip = pecs.Chip("ideal")
    truth = chip.photocurrent(every).mean((1, 2))
    with pecs.Light(folder, chip) as light:
        found = np.array([light.at(1000.0 * step)[0].mean() for step in range(FRAMES)])
    assert np.abs(np.log(found / truth)).max() < 0.05 and np.ptp(np.log(truth)) > 1.5


@pytest.mark.filterwarnings("ignore:All-NaN")
def test_pictures_between_show_their_own_instant(blends):
    """In every tile, within the noise: light of the keyframe in its place differs by up to a factor of 40."""
    folder, worst = adaptive(blends, "mirror"), []
    every = render(blends, "mirror", "--subpixels", 2, "--samples", 32)
    with pecs.StackReader(folder) as reader, pecs.StackReader(every) as truth:
        for interval in range(len(list(folder.glob("motion_*.exr")))):
            for which, t_ns in enumerate(reader.between_ns(interval)):
                light = reader.read_between(interval, which).mean(0) / truth.read_frame(t_ns // 1_000_000).mean(0)
                light = light[: light.shape[0] // 16 * 16].reshape(-1, 16, light.shape[1] // 16, 16)
                worst.append(np.nanmax(np.abs(np.log(np.nanmedian(light, axis=(1, 3))))))
    assert len(worst) > 10 and max(worst) < 1.5


DESK = ("--lens", "none", "--focal", "5mm", "--fnumber", 2, "--bands", 1, "--fps", 1000, "--frames", 17)
SMALL, LARGER = ("--width", 96, "--height", 54, "--samples", 16), ("--width", 160, "--height", 90, "--samples", 8)


@pytest.fixture(scope="module")
def desk(root, tmp_path_factory):
    """Renders scenes/desk with further arguments."""

    def rendered(*args):
        folder = tmp_path_factory.mktemp("desk") / "s"
        pecs_blender("render", root / "scenes/desk", "-o", folder, *DESK, *args)
        return folder

    return rendered


def test_rendered_tiles_show_still_pixels_as_the_keyframe_does(desk):
    """What a denoiser makes of a part of the picture differs from what it made of the whole."""
    size = "--width", 192, "--height", 108, "--samples", 8
    folder = desk(*size, "--time", "adaptive", "--set", "metronome_hz=6", "--set", "fan_hz=8")
    still, same = 0, 0
    with pecs.StackReader(folder) as reader:
        first, second = reader.read_frame(0), reader.read_frame(1)
        for which in range(len(reader.between_ns(0))):
            light = reader.read_between(0, which)
            there = (first == second).all(0) & np.isfinite(light[0])
            still += there.sum()
            same += (there & (light[: len(first)] == first).all(0)).sum()
    assert still > 2000 and same > 0.4 * still


FAN = ("--time", "adaptive", "--set", "metronome_hz=0", "--set", "fan_hz=20", "--frames", 41)


def pools(frame, where):
    """Means of 4x4 pixels [180, 320] of a frame, those of which most are in `where`."""
    light, share = (one.reshape(45, 4, 80, 4).mean((1, 3)) for one in (frame.mean(0), where))
    return light[share > 0.5]


def test_a_small_fast_part_has_partial_keyframes(desk, root):
    """The camera stands still: what is not rendered in a partial keyframe has the light of the whole ones."""
    folder = desk(*LARGER, *FAN)
    stack = json.loads((folder / "stack.json").read_text())
    partial, count = stack["render"]["partial_keyframes"], len(stack["times_ns"])
    assert count >= 4 and len(partial) == count - 2 and 0 not in partial and count - 1 not in partial
    at = stack["times_ns"][partial[1]] // 1_000_000
    alone = desk(*LARGER, *FAN[2:-1], f"{at}:{at + 1}", "--subpixels", 2, "--samples", 64)
    with pecs.StackReader(folder) as reader, pecs.StackReader(alone) as truth:
        frames = [reader.read_frame(i) for i in range(count)]
        moved = np.mean([(frame == frames[0]).all(0) for frame in frames], 0) < 1
        assert (~moved[:, :160]).mean() > 0.95 and 0.01 < moved.mean() < 0.25  # the fan is on the right
        pooled = [pools(one, moved) for one in (*frames, truth.read_frame(0))]
        assert np.argmin([np.std(np.log(one / pooled[-1])) for one in pooled[:-1]]) == partial[1]
    for name in (f"frame_{partial[1]:06d}.exr", f"motion_{partial[1]:06d}.exr"):
        whole = (folder / name).read_bytes()
        (folder / name).unlink()
        pecs_blender("render", root / "scenes/desk", "-o", folder, *DESK, *LARGER, *FAN)
        assert (folder / name).read_bytes() == whole


def test_a_camera_that_trembles_needs_few_whole_keyframes(desk, tmp_path):
    """Paths are bent, but the places of points are exact in the partial keyframes."""
    t_s, path = np.arange(121) / 1000, tmp_path / "trembles.txt"
    half_rad = 0.0015 * np.sin(2 * np.pi * 20 * t_s)  # about the camera's y axis
    s, c, still = np.sin(half_rad), np.cos(half_rad), np.zeros(121)
    np.savetxt(path, np.stack([t_s, still, still, still, -c * 0.5**0.5, -s * 0.5**0.5, s * 0.5**0.5, c * 0.5**0.5], 1))
    trembling = ("--set", "metronome_hz=0", "--set", "fan_hz=0", "--camera-path", path)
    folder = desk(*LARGER, *trembling, "--time", "adaptive", "--frames", 121)
    stack = json.loads((folder / "stack.json").read_text())
    partial, count = stack["render"]["partial_keyframes"], len(stack["times_ns"])
    assert count >= 4 and count - len(partial) <= 3
    aside = max(partial, key=lambda i: abs(half_rad[stack["times_ns"][i] // 1_000_000]))
    at = stack["times_ns"][aside] // 1_000_000
    alone = desk(*LARGER, *trembling, "--frames", f"{at}:{at + 1}", "--subpixels", 2, "--samples", 64)
    with pecs.StackReader(folder) as reader, pecs.StackReader(alone) as truth:
        pictures = truth.read_frame(0), reader.read_frame(aside), reader.read_frame(0)
        true, partly, whole = (np.log(np.maximum(one[0], 1e-9)) for one in pictures)
    right = np.gradient(true)[1]
    edges = (np.abs(right) > 0.2) & (np.abs(right) < 1)
    shift_px = [np.median((one - true)[edges] / right[edges]) for one in (partly, whole)]
    assert abs(shift_px[0]) < 0.03 < 0.1 < abs(shift_px[1])


def test_lamps_of_a_scene_folder_flicker_as_rendered(desk):
    flicker = (*SMALL, "--set", "flicker_hz=125", "--set", "window_to_lamp=0", "--set", "fan_hz=0")
    folder = desk("--time", "adaptive", "--no-denoise", *flicker)  # the denoiser makes this dark picture 2 % brighter
    every, chip = desk(*flicker), pecs.Chip("ideal")
    truth = chip.photocurrent(every).mean((1, 2))
    with pecs.Light(folder, chip) as light:
        found = np.array([light.at(1000.0 * step)[0].mean() for step in range(17)])
    assert np.abs(np.log(found / truth)).max() < 0.03 and np.ptp(np.log(truth)) > 0.3


def test_a_shadow_needs_a_part_of_the_picture_alone(blends):
    folder = adaptive(blends, "shadow")
    sizes = [len(data) for name, data in files(folder).items() if name.startswith("between")]
    whole = len((folder / "frame_000000.exr").read_bytes())
    assert np.median(sizes) < 0.5 * whole  # what is not rendered is NaN, and compresses to nothing


def test_a_still_scene_is_rendered_once_and_silent(blends, bench):
    folder = adaptive(blends, "still")
    stack = json.loads((folder / "stack.json").read_text())
    assert len(stack["times_ns"]) == 2 and not between(folder)
    with pecs.StackReader(folder) as reader:
        assert (reader.read_frame(0) == reader.read_frame(1)).all()
        assert not reader.read_layer("motion", 0)[[*range(8), *range(10, 18)]].any()
    assert len(bench.events(folder)) == 0


def test_what_stands_still_stays_bit_by_bit(blends):
    folder = adaptive(blends, "still", "--frames", 200)  # by then a ball has set off
    with pecs.StackReader(folder) as reader:
        first, last = reader.read_frame(0), reader.read_frame(reader.info["frames"] - 1)
    same = (first == last).all(0)
    assert 0.3 < same.mean() < 1  # the ball changes the light on what is near it


def test_stopped_jobs_and_shards_give_the_same_stack(blends, tmp_path):
    whole = adaptive(blends, "shadow")
    count = len(json.loads((whole / "stack.json").read_text())["times_ns"])
    stopped = tmp_path / "stopped"
    shutil.copytree(whole, stopped)
    for name in ("frame_000001.exr", "motion_000000.exr", between(whole)[0]):
        (stopped / name).unlink()
    told = os.environ | {"PECS_PROGRESS": "json"}
    done = pecs_blender("render", blends / "shadow.blend", "-o", stopped, *COMMON, "--time", "adaptive", env=told)
    assert files(stopped) == files(whole)
    assert '"render"' in done.stderr and '"motion"' not in done.stderr  # the keyframes are those of stack.json
    shards = [tmp_path / "first", tmp_path / "second"]
    for shard, part in zip(shards, ("0:1", f"1:{count}"), strict=True):
        pecs_blender("render", blends / "shadow.blend", "-o", shard, *COMMON, "--time", "adaptive", "--only", part)
    pecs_blender("merge", *shards, "-o", tmp_path / "merged")
    assert files(tmp_path / "merged") == files(whole)


def test_through_a_lens_too(root, tmp_path):
    args = ("--bands", 2, "--width", 48, "--fps", 2000, "--frames", 21, "--samples", 8)
    pecs_blender("render", root / "scenes/rotating_disk", "-o", tmp_path / "s", *args, "--time", "adaptive")
    stack = json.loads((tmp_path / "s/stack.json").read_text())
    assert len(stack["times_ns"]) < 6 and stack["lens"]["name"]
    with pecs.StackReader(tmp_path / "s") as reader:
        assert (reader.read_frame(0) > 0).all()
    pecs.sense(
        tmp_path / "s", tmp_path / "e.npz", noise=False, overrides={"corner_hz_per_a": 1e18, "amplifier_cutoff_hz": 0}
    )
    assert len(pecs.read(tmp_path / "e.npz")) > 50


def test_noise_has_both_signs_with_diffraction(root, tmp_path):
    args = ("--bands", 2, "--width", 48, "--fps", 2000, "--frames", 3, "--samples", 8, "--fnumber", 150)
    pecs_blender("render", root / "scenes/rotating_disk", "-o", tmp_path / "s", *args, "--time", "adaptive")
    assert json.loads((tmp_path / "s/stack.json").read_text())["lens"]["diffraction"]
    with pecs.StackReader(tmp_path / "s") as reader:
        assert 0.2 < (reader.read_layer("noise", 0) < 0).mean() < 0.8


def test_the_still_outline_of_what_turns_stays_in_place(root, tmp_path, bench):
    """A path that bends more than its polynomial moves the disk's rim over the wall, which makes events."""

    def at_the_rim(name, *options):
        size = ("--lens", "none", "--focal", 15.02, "--width", 96, "--bands", 1, "--samples", 8)
        times = ("--fps", 875, "--frames", 43)
        pecs_blender("render", root / "scenes/rotating_disk", "-o", tmp_path / name, *size, *times, *options)
        found = bench.events(tmp_path / name)
        radius = np.hypot(found["x"] - 71.75, found["y"] - 27.0) / 22.7
        return np.sum((radius > 0.93) & (radius < 1.07))

    assert at_the_rim("adaptive", "--time", "adaptive") < 1.4 * at_the_rim("uniform")


PASSING = """
import sys
import bpy
from pecs_lab.blend import GREY, ball, curves, floor, lamp, material, move, put, save, start

scene = start((48, 32), (0, -4, 0), 90)
scene.render.fps, scene.frame_start, scene.frame_end = 1000, 0, 160
glow, _, _ = material("glow", ("ShaderNodeEmission", {"Strength": 0.5}))
flies, blinks, goes = (ball(glow, place, 0.25) for place in ((-3, 0, 0.6), (-1, 0, -0.5), (-0.4, 0, -0.5)))
move(flies, "location", [(-3, 0, 0.6), (3, 0, 0.6)], (20, 60))
flash = put(lamp("POINT", (1, 1, 1), 3, (0.9, -50, 0)), (0.9, -1, -0.5), name="flash")
for thing, hidden, begin, end in ((blinks, True, 20, 60), (goes, False, 20, 60), (flash, True, 70, 80)):
    for frame, value in ((0, hidden), (begin, not hidden), (end, hidden)):
        thing.hide_render = value
        thing.keyframe_insert("hide_render", frame=frame)
grows = floor(glow, 0.3, (0.2, 0, -0.5), (90, 0, 0))
move(grows.modifiers.new("array", "ARRAY"), "count", (1, 2), (0, 121))
for curve in (*curves(flies), *curves(grows)):
    curve.extrapolation = "CONSTANT"
    curve.keyframe_points[0].interpolation = "LINEAR" if curve.data_path == "location" else "CONSTANT"
floor(material("plate", ("ShaderNodeBsdfDiffuse", {"Color": GREY}))[0], 0.6, (0.9, 0, -0.5), (90, 0, 0))
light = lamp("SPOT", (1, 1, 1), 5, (0.9, -1, -0.5))
bpy.data.objects[light.name].rotation_euler.x = 1.5708
for key, values in (("energy", (5, 20)), ("spot_size", (0.2, 0.6))):
    move(light, key, values, (0, 160))
animation, action = light.animation_data, light.animation_data.action
strip = animation.nla_tracks.new().strips.new("both", 0, action)
strip.action_slot, strip.frame_end, animation.action = action.slots[0], 160, None
save(sys.argv[1], "passing")
"""


def deviation(blend, *, frames, fps, samples):
    """[T, H, W]: |ln| of the light between keyframes of a .blend at 1000 Hz over that of uniform steps, `fps`."""
    all_frames = (frames - 1) * fps // 1000 + 1
    ways = {
        "few": ("--time", "adaptive", "--no-denoise"),
        "all": ("--fps", fps, "--frames", all_frames, "--subpixels", 2),
    }
    for name, words in ways.items():
        every = *COMMON, "--frames", frames, "--samples", samples, "--bands", 1, *words
        pecs_blender("render", blend, "-o", blend.parent / name, *every)
    truth = pecs.Chip("ideal").photocurrent(blend.parent / "all")
    with pecs.Light(blend.parent / "few", "ideal") as light:
        found = np.array([light.at(1e6 / fps * step)[0] for step in range(len(truth))])
    dark = 0.01 * truth.max()
    return np.abs(np.log((found + dark) / (truth + dark)))


def test_what_is_in_the_picture_between_keyframes_alone(tmp_path):
    """Before black: a ball that flies through, one that is there for 40 ms, one that is not, a mesh that gets more
    vertices, a lamp of which one strip moves strength and size, and one that is on for 10 ms."""
    in_bpy(PASSING, tmp_path)
    wrong = deviation(tmp_path / "passing.blend", frames=131, fps=200, samples=16) > 0.3
    assert wrong.mean() < 2e-3 and wrong.mean((1, 2)).max() < 0.03


SMALL_THINGS = """
import sys
from pecs_lab.blend import box, floor, lamp, material, move, save, start

scene = start((96, 64), (0, -4, 0), 90)
scene.render.fps, scene.frame_start, scene.frame_end = 1000, 0, 40
glow, _, _ = material("glow", ("ShaderNodeEmission", {"Strength": 0.3}))
floor(glow, 8, (0, 2, 0), (90, 0, 0))
own, tree, _ = material("own", ("ShaderNodeEmission", {}))
info = tree.nodes.new("ShaderNodeObjectInfo")
tree.links.new(info.outputs["Color"], tree.nodes["Emission"].inputs["Color"])
clear, tree, out = material("clear", ("ShaderNodeEmission", {"Strength": 3}))
mix, hole = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
for source, target in ((hole.outputs[0], mix.inputs[2]), (tree.nodes["Emission"].outputs[0], mix.inputs[1])):
    tree.links.new(source, target)
tree.links.new(mix.outputs[0], out.inputs["Surface"])
mix.inputs[0].default_value = 0.6
smoke, _, _ = material("smoke", ("ShaderNodeVolumePrincipled", {"Density": 0, "Emission Strength": 20}), end="Volume")
paper, _, _ = material("paper", ("ShaderNodeBsdfDiffuse", {}))
black, _, _ = material("black", ("ShaderNodeEmission", {"Strength": 0.05}))
plate = dict(rotation_deg=(90, 0, 0))
move(floor(own, 0.1, (-1, 0, 0.78), **plate), "color", ((1, 1, 1, 1), (0.1, 0.1, 0.1, 1)), (0, 40))
for moving, side in ((floor(clear, 0.1, (0, 0, 0.12), **plate), 1), (box(smoke, (0, 0, -0.6), 0.1), -1)):
    at = moving.location.copy()
    move(moving, "location", [(side * x, *at.yz) for x in (-1, 1)], (0, 40))
floor(glow, 0.1, (0.8, 0.4, 0.78), **plate)  # seen between two plates in the middle
for side in (-1, 1):
    cover = floor(black, 1, (0, 0.2, 0), **plate)
    cover.scale.y = 0.3
    move(cover, "location", [(0.75 + x + side * 0.6, 0.2, 0.75) for x in (-0.3, 0.3)], (0, 40))
floor(paper, 0.1, (1, 0, -0.6), **plate)
lamp("POINT", (1, 1, 1), 10, (1, -2, -0.6))
move(floor(black, 0.3, (1, -1.9, -0.9), **plate), "location", [(1, -1.9, z) for z in (-1.1, 0)], (0, 40))
save(sys.argv[1], "small")
"""


def test_small_things_that_change(tmp_path):
    """A colour of an object, what is half clear and flies, and smoke; what two plates hide at both keyframes; a shadow
    of something outside the picture."""
    in_bpy(SMALL_THINGS, tmp_path)
    wrong = deviation(tmp_path / "small.blend", frames=41, fps=100, samples=8) > 0.6
    assert wrong.sum((1, 2)).max() < 4  # pixels; a thing has nine


SHADOW_ALONE = """
import sys
from pecs_lab.blend import ball, box, floor, lamp, material, move, save, start

scene = start((96, 64), (0, -4, 0), 90)
scene.render.fps, scene.frame_start, scene.frame_end = 1000, 0, 70
floor(material("paper", ("ShaderNodeBsdfDiffuse", {}))[0], 12, (0, 1, 0), (90, 0, 0))
lamp("POINT", (1, 1, 1), 300, (0, -2, 3)).shadow_soft_size = 0
glow, _, _ = material("glow", ("ShaderNodeEmission", {"Strength": 0.5}))
move(ball(glow, radius=0.07), "location", [(x, -0.3, 0.75) for x in (-1.1, 0.18)], (0, 70))
wire = box(glow, size=0.2)
wire.scale = (0.07, 0.07, 1)
move(wire, "location", [(x, -1, 2.05) for x in (-0.1, 0.35)], (0, 70))
save(sys.argv[1], "shadow")
"""


def test_a_shadow_far_from_what_partial_keyframes_follow(tmp_path):
    """It comes into the picture and is in no keyframe at first; that of a wire is two rendered pixels thin."""
    in_bpy(SHADOW_ALONE, tmp_path)
    wrong = deviation(tmp_path / "shadow.blend", frames=71, fps=100, samples=8) > 0.3
    stack = json.loads((tmp_path / "few/stack.json").read_text())
    assert stack["render"]["partial_keyframes"] and wrong.sum((1, 2)).max() < 8  # pixels; the wire's has 70


FLASHES = """
import sys
from math import pi
from pecs_lab.blend import curves, floor, material, move, save, start

scene = start((96, 64), (0, -4, 0), 90)
scene.render.fps, scene.frame_start, scene.frame_end = 1000, 0, 100
floor(material("wall", ("ShaderNodeEmission", {"Strength": 0.1}))[0], 12, (0, 1, 0), (90, 0, 0))
spins = floor(material("glow", ("ShaderNodeEmission", {"Strength": 0.5}))[0], 0.3, (0, 0, 0), (90, 0, 0))
move(spins, "rotation_euler", [(pi / 2, turn, 0) for turn in (0, 4 * pi)], (0, 100))
for place, begin, end in eval(sys.argv[2]):
    flash, tree, _ = material("flash", ("ShaderNodeEmission", {}))
    move(tree.nodes["Emission"].inputs["Strength"], "default_value", (0.3, 1.5, 0.3), (0, begin, end))
    for point in curves(tree)[0].keyframe_points:
        point.interpolation = "CONSTANT"
    floor(flash, 0.3, place, (90, 0, 0))
save(sys.argv[1], "flashes")
"""


def test_what_the_middle_partial_keyframe_does_not_show(tmp_path):
    """Near what spins, and far from it, there in no partial keyframe."""
    in_bpy(FLASHES, tmp_path, [((0.4, 0, 0), 18, 42), ((1, 0, -0.5), 36, 48), ((-1, 0, 0.5), 58, 82)])
    wrong = deviation(tmp_path / "flashes.blend", frames=101, fps=200, samples=8) > 0.3
    stack = json.loads((tmp_path / "few/stack.json").read_text())
    partial = [stack["times_ns"][i] // 1_000_000 for i in stack["render"]["partial_keyframes"]]
    assert min(abs(t - 50) for t in partial) < 8 and not any(36 <= t < 48 for t in partial)
    assert wrong.sum((1, 2)).max() < 40  # pixels; a flash has 100


FOCUS = """
import sys
from pecs_lab.blend import floor, material, move, save, start
dof = start((96, 64), (0, -4, 0), 90).camera.data.dof
dof.use_dof, dof.aperture_fstop = True, 0.1
move(dof, "focus_distance", (4, 3), (1, 11))
glow, _, _ = material("glow", ("ShaderNodeEmission", {}))
for row in (4, 28, 52):
    floor(glow, 0.1, (0, 0, (32 - row) / 33.3), (90, 0, 0))
save(sys.argv[1], "focus")
"""


def test_keyframes_of_a_camera_whose_focus_moves(tmp_path):
    """Small things that the first keyframe shows out of focus."""
    in_bpy(FOCUS, tmp_path)
    every = ("render", tmp_path / "focus.blend", *COMMON, "--fps", 24, "--frames", 11, "--samples", 64, "--bands", 1)
    pecs_blender(*every, "-o", tmp_path / "few", "--time", "adaptive", "--no-denoise")
    pecs_blender(*every, "-o", tmp_path / "all", "--frames", "10:11")
    with pecs.StackReader(tmp_path / "few") as few, pecs.StackReader(tmp_path / "all") as alone:
        last = few.read_frame(few.info["frames"] - 1)[0]
        truth = alone.read_frame(0)[0]
    last = last.reshape(64, 2, 96, 2).mean((1, 3))
    assert np.abs(last - truth).max() < 0.3 * truth.max()


def test_a_moving_part_needs_no_telling(blends, tmp_path):
    args = (*COMMON, "--time", "adaptive", "--moving-px", "0:0:9:9")
    result = pecs_blender("render", blends / "room.blend", "-o", tmp_path / "s", *args, check=False)
    assert result.returncode == 2 and "--moving-px" in result.stderr and result.stderr.count("\n") == 1
