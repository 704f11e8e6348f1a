"""The light of a stack at any time, and over exposures."""

import json
from functools import partial

import numpy as np
import pecs
import pytest
from support.moving_scene import Scene, write_stack

STEP_NS = 8_000_000
STEP_US = STEP_NS / 1000
SCENE = Scene(96, 72, step=(8.0, 2.0), finest_px=12.0, radii=(22.0, 16.0), samples=4)
THERE, BACK = SCENE.motion(), SCENE.motion()[[*range(10, 20), *range(10)]]
CHIP = pecs.Chip("ideal")


def lit(plane):
    """The left half brighter than motion explains, the rest not rendered."""
    return np.where(np.arange(SCENE.width) < 48, 2 * plane, np.nan).astype(np.float32)


@pytest.fixture(scope="module")
def stack(tmp_path_factory):
    """There and back again, with a picture between of the way back."""
    frames = [SCENE.frame(t) for t in (0.0, 1.0, 0.0)]
    between = [(1, 0, STEP_NS + STEP_NS // 4, lit(SCENE.frame(0.75)))]
    folder = tmp_path_factory.mktemp("light") / "s"
    return write_stack(folder, frames, [k * STEP_NS for k in range(3)], [THERE, BACK], between=between)


def carried(stack, frame, fraction, motion, chip=CHIP):
    first, second = chip.photocurrent(stack, [frame, frame + 1])
    return pecs.carry(first, second, motion, fraction)


def same(found, wanted, rtol=1e-4):
    """Lines that are fitted to edges enlarge rounding errors of the light up to a hundred times."""
    np.testing.assert_allclose(found, wanted, rtol=rtol)


def test_at_a_frame_it_is_the_frame(stack):
    frames = CHIP.photocurrent(stack)
    with pecs.Light(stack, CHIP) as light:
        assert (light.shape, light.end_us, light.along_motion) == ((1, 72, 96), 2 * STEP_US, True)
        for frame in (2, 0, 1):
            assert np.array_equal(light.at(frame * STEP_US)[0], frames[frame])
        assert np.array_equal(light.at(STEP_US * (1 - 1e-16)), light.at(STEP_US))  # to 0.5 ns


def test_between_frames_it_is_carried(stack):
    with pecs.Light(stack, CHIP) as light:
        for fraction in (0.1, 0.5, 0.93):
            same(light.at(fraction * STEP_US)[0], carried(stack, 0, fraction, THERE))
    with pecs.Light(stack, CHIP, motion=False) as frozen:
        first, second = CHIP.photocurrent(stack, [0, 1]).astype(float)
        assert not frozen.along_motion
        same(frozen.at(0.3 * STEP_US)[0], first**0.7 * second**0.3, 1e-5)


def test_pictures_between_are_heeded(stack):
    """As the sensor does: ln of the rendered to the carried light, linear from instant to instant, in the range of the
    light in the pictures around, which the carried light extends as far as it leaves its own."""
    at = 0.25
    with pecs.StackReader(stack) as reader:
        rendered = reader.read_between(1, 0)[0] / reader.read_frame(0)[0] * CHIP.photocurrent(stack, 0)
    between = carried(stack, 1, at, BACK)
    log_ratio = np.nan_to_num(np.log(rendered / between))
    with pecs.Light(stack, CHIP) as light:
        first, second = (light.at(step * STEP_US)[0] for step in (1, 2))
        for fraction, part in ((0.1, 0.1 / at), (at, 1.0), (0.7, 0.3 / 0.75)):
            now, end = carried(stack, 1, fraction, BACK), first if fraction < at else second
            shown = between * np.exp(log_ratio)
            least = np.minimum(shown, end) * np.minimum(1, now / np.minimum(between, end))
            most = np.maximum(shown, end) * np.maximum(1, now / np.maximum(between, end))
            wanted = np.clip(now * np.exp(part * log_ratio), least, most)
            same(light.at((1 + fraction) * STEP_US)[0], wanted)
        assert np.median(log_ratio[:, :48]) > 0.6 and (log_ratio[:, 48:] == 0).all()


def test_the_sensor_sees_the_same(stack, tmp_path):
    """Events of planes at a sensor's instants are those of the stack."""
    pecs.sense(stack, tmp_path / "wanted.npz", chip="ideal")
    wanted = pecs.read(tmp_path / "wanted.npz")
    t_us = np.linspace(0, 2 * STEP_US, 129)
    with pecs.Light(stack, CHIP) as light:
        planes = light.at(t_us)[:, 0]
    found = pecs.simulate(planes, t_us, "ideal", photocurrent_a=1.0)
    assert len(wanted) > 5000 and abs(len(found) - len(wanted)) < 0.02 * len(wanted)
    counts = [np.histogram2d(e["y"], e["x"], (72, 96), ((0, 72), (0, 96)))[0] for e in (found, wanted)]
    assert np.mean(np.abs(counts[0] - counts[1])) < 0.05 * np.mean(counts[1])


def test_order_and_company_change_nothing(stack):
    t_us = np.array([0.0, 0.3, 0.31, 1.0, 1.2, 1.25, 1.9, 2.0]) * STEP_US
    with pecs.Light(stack, CHIP) as light:
        alone = np.stack([light.at(t) for t in t_us])
    with pecs.Light(stack, CHIP, threads=1) as light:
        order = [6, 0, 4, 2, 7, 1, 5, 3]
        assert np.array_equal(light.at(t_us), alone) and np.array_equal(light.at(t_us[order]), alone[order])
        assert light.at([]).shape == (0, 1, 72, 96)


def colour_chip(folder, name, lambda_nm, value):
    """The ideal chip with another QE."""
    profile = json.loads((pecs.data_dir("sensor/chips") / "ideal.json").read_text())
    profile["relative_qe"] = {"source": "test", "lambda_nm": lambda_nm, "value": value}
    (folder / f"{name}.json").write_text(json.dumps(profile))
    return folder / f"{name}.json"


def test_colours_are_chips(stack, tmp_path):
    chips = [
        colour_chip(tmp_path, "a", [400, 700], [0.2, 0.8]),
        colour_chip(tmp_path, "b", [400, 700], [1.0, 0.0]),
        CHIP,
    ]
    with pecs.Light(stack, chips) as light:
        assert light.shape == (3, 72, 96)
        plane = light.at(1.2 * STEP_US)
        blurred = light.mean(0, 4000, steps=4)
    for k, chip in enumerate(chips):
        with pecs.Light(stack, chip) as alone:
            assert np.array_equal(alone.at(1.2 * STEP_US)[0], plane[k])
            assert np.array_equal(alone.mean(0, 4000, steps=4)[0], blurred[k])
    same(plane[1] / plane[0], 1.0, 1e-5)  # half of the QE at 550 nm


def test_an_exposure_is_the_mean(stack):
    begin, length = 0.6 * STEP_US, 0.9 * STEP_US
    with pecs.Light(stack, CHIP) as light:
        for steps in (1, 7, 40):
            middles = begin + (np.arange(steps) + 0.5) / steps * length
            wanted = light.at(middles).astype(float).mean(0)
            same(light.mean(begin, begin + length, steps), wanted, 1e-6)
        # As many as half a pixel of motion needs: 8.2 px and the turn, in each interval.
        fine = light.mean(begin, begin + length, 1000)
        own = light.mean(begin, begin + length)
        assert np.mean(np.abs(np.log(own / fine))) < 2e-3 < np.mean(np.abs(np.log(light.at(begin) / fine)))
        assert any(np.array_equal(own, light.mean(begin, begin + length, steps)) for steps in range(14, 24))


@pytest.mark.parametrize("delay", [20.0, -20.0, 0.9, 150.0])
def test_rolling_shutter(stack, delay):
    """Each row as an exposure of its own, cells counted by their overlap with it."""
    begin, length, steps = (400.0, 1000.0, 8) if delay > 0 else (9000.0, 1000.0, 8)
    cell = length / steps
    edge = [begin + delay * y for y in range(72)]
    low, high = min(edge), max(edge) + length
    with pecs.Light(stack, CHIP) as light:
        found = light.exposure(begin, length, delay, steps)
        first, last = int(np.floor((low - begin) / cell)), int(np.ceil((high - begin) / cell))
        t_us = np.clip(begin + (np.arange(first, last) + 0.5) * cell, low, high)
        planes = light.at(t_us)[:, 0].astype(float)
    starts = begin + np.arange(first, last) * cell
    for y in range(72):
        overlap = np.clip(np.minimum(starts + cell, edge[y] + length) - np.maximum(starts, edge[y]), 0, None)
        same(found[0, y], overlap @ planes[:, y] / overlap.sum(), 1e-5)


def test_subpixels_are_averaged(tmp_path):
    fine = Scene(96, 72, step=(8.0, 2.0), finest_px=12.0, radii=(22.0, 16.0), samples=2)
    motion = fine.motion()
    stack = write_stack(tmp_path / "s", [fine.frame(0), fine.frame(1)], [0, STEP_NS], [motion], subpixels=2)
    with pecs.StackReader(stack) as reader:
        per_light = CHIP.photocurrent(stack, 0).sum() / reader.read_frame(0).sum() * 4
        first, second = reader.read_frame(0)[0], reader.read_frame(1)[0]
    with pecs.Light(stack, CHIP) as light:
        same(light.at(0.0)[0], CHIP.photocurrent(stack, 0))
        half = pecs.carry(first, second, motion, 0.5).reshape(36, 2, 48, 2).mean((1, 3)) * per_light
        same(light.at(STEP_US / 2)[0], half)
        # Rows that are needed alone are those of the whole.
        rolling, whole = light.exposure(100, 10, 100, 1)[0], light.at(100 + 100 * np.arange(36) + 5)[:, 0]
        same(rolling, [whole[y, y] for y in range(36)], 1e-6)


def test_loops_go_on(tmp_path):
    frames = [SCENE.frame(0), SCENE.frame(1)]
    stack = write_stack(tmp_path / "s", frames, [0, STEP_NS], [THERE, BACK], period_ns=2 * STEP_NS)
    with pecs.Light(stack, CHIP) as light:
        assert light.end_us is None
        same(light.at(1.25 * STEP_US)[0], pecs.carry(*CHIP.photocurrent(stack, [1, 0]), BACK, 0.25))
        assert np.array_equal(light.at(2000 * STEP_US), light.at(0.0))
        same(light.at(2001.25 * STEP_US), light.at(1.25 * STEP_US))
        same(light.mean(1.5 * STEP_US, 2.5 * STEP_US, 10), light.mean(3.5 * STEP_US, 4.5 * STEP_US, 10))
        with pytest.raises(ValueError, match="steps"):
            light.exposure(0, 1, 1000, 65536)


def test_frames_without_motion_are_blended(tmp_path):
    frames = np.array([SCENE.frame(0), SCENE.frame(1)], np.float32)
    frames[0, 3, 5], frames[1, 3, 6], frames[:, 3, 7] = np.nan, np.inf, np.nan
    frames[0, 4, 5] = 0
    stack = write_stack(tmp_path / "s", frames, [0, STEP_NS])
    with pecs.Light(stack, CHIP) as light:
        first, second = CHIP.photocurrent(stack)
        assert np.array_equal(light.at(0.0)[0], first, equal_nan=True)
        half = light.at(STEP_US / 2)[0]
        assert (half[3, 5], half[3, 6]) == (second[3, 5], first[3, 6]) and np.isnan(half[3, 7])
        same(half[4, 5], second[4, 5] / 2)
        same(half[10:], np.sqrt(first[10:].astype(float) * second[10:]), 1e-5)
        assert np.array_equal(light.mean(0, STEP_US), light.mean(0, STEP_US, 4), equal_nan=True)


def test_wrong_requests_are_one_line(stack, tmp_path):
    with pytest.raises(pecs.PecsNotFoundError):
        pecs.Light(tmp_path / "none", CHIP)
    with pytest.raises(ValueError, match="chips: got none"):
        pecs.Light(stack, [])
    with pecs.Light(stack, CHIP) as light:
        for t_us in (-1.0, 2 * STEP_US + 0.01, float("nan"), float("inf"), [0.0, -5.0]):
            with pytest.raises(ValueError, match="t_us: got .*, wanted 0 to 16000"):
                light.at(t_us)
        with pytest.raises(ValueError, match="t_us"):
            light.mean(STEP_US, 2 * STEP_US + 1)
        with pytest.raises(ValueError, match="t_us"):
            light.exposure(15_000, 900, 2)
        with pytest.raises(ValueError, match="exposure_us: got 0, wanted more than 0"):
            light.mean(5, 5)
        for steps in (0, -3, 1 << 40):
            with pytest.raises(ValueError, match="steps"):
                light.mean(0, 5, steps)
        with pytest.raises(ValueError, match="shape"):
            light.at(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="closed"):
        light.at(0.0)


def test_options_without_effect_are_refused_as_by_the_program(stack, tmp_path):
    """The stack has times, and light as irradiance."""
    words = "--fps: got .*, wanted frames without times of their own"
    sensed = partial(sense, tmp_path)
    for call in (pecs.StackReader, partial(pecs.Light, chips=CHIP), CHIP.photocurrent, sensed):
        for fps in (500, 125, -5, float("nan")) if call is pecs.StackReader else (500,):
            with pytest.raises(pecs.PecsInputError, match=words):
                call(stack, fps=fps)
    with pecs.StackReader(stack) as reader:
        with pytest.raises(ValueError, match="fps: got one with a StackReader"):
            CHIP.photocurrent(reader, 0, fps=500)
        for frames in ([0.5, 1.7], [True, False, True], "0"):
            with pytest.raises(ValueError, match="frames: got .*, wanted integers"):
                CHIP.photocurrent(reader, frames)
        assert CHIP.photocurrent(reader, []).shape == (0, SCENE.height, SCENE.width)
    of_bands = partial(CHIP.amperes_per_unit, [{"lambda_nm": 550, "weight_nm": 1}])
    for options, wanted in (
        ({"fnumber": 4.0}, "--fnumber: got light in irradiance units, wanted radiance"),
        ({"photocurrent_a": 1e-12}, "--photocurrent: got light in irradiance units, wanted relative light"),
        ({"gain": 1e-15, "photocurrent_a": 1e-12}, "--photocurrent: got --gain as well"),
        ({"gain": 1e-15, "fnumber": 4.0}, "--fnumber: got --gain as well"),
    ):
        calls = partial(pecs.Light, stack, CHIP), partial(CHIP.photocurrent, stack), partial(sensed, stack), of_bands
        for call in calls:
            with pytest.raises(pecs.PecsInputError, match=wanted):
                call(**options)


def sense(folder, stack, **options):
    return pecs.sense(stack, folder / "events.npz", chip=CHIP, **options)


def test_an_exposure_does_not_miss_a_picture_between(tmp_path):
    """A lamp that flashes over a scene where nothing moves: the sensor takes a plane at the picture's time too."""
    still = np.zeros((20, 72, 96), np.float32)
    frame = SCENE.frame(0)
    between = [(0, 0, STEP_NS // 4, 3 * frame)]
    stack = write_stack(tmp_path / "s", [frame, frame], [0, STEP_NS], [still], between=between)
    with pecs.Light(stack, CHIP) as light:
        mean, two = light.mean(0, STEP_US), light.mean(0, STEP_US, 2)
        assert np.array_equal(mean, two) and not np.array_equal(mean, light.mean(0, STEP_US, 1))


def test_each_pixel_of_a_mosaic_has_its_own_filter(stack, tmp_path):
    """Light of the mosaic is that of chips whose QE is multiplied by a filter, pixel by pixel; so are its events."""
    halves = {"A": [1.0, 0.4], "B": [0.2, 0.9]}
    profile = json.loads((pecs.data_dir("sensor/chips") / "ideal.json").read_text())
    curve = {"source": "test", "lambda_nm": [400, 700]}
    profile["mosaic"] = {
        "pattern": ["AB", "BB"],
        "filters": {name: {**curve, "value": value} for name, value in halves.items()},
    }
    (tmp_path / "mosaic.json").write_text(json.dumps(profile))
    y, x = np.mgrid[:72, :96]
    is_a = (y % 2 == 0) & (x % 2 == 0)
    t_us = [0.0, 1.2 * STEP_US]
    with pecs.Light(stack, [tmp_path / "mosaic.json", CHIP]) as light:
        mosaic, plain = light.at(t_us).swapaxes(0, 1)
    for pixels, (low, high) in ((is_a, halves["A"]), (~is_a, halves["B"])):
        transmittance = low + (high - low) * 0.5  # at 550 nm
        same(mosaic[:, pixels] / plain[:, pixels], transmittance)
    assert np.array_equal(pecs.Chip(tmp_path / "mosaic.json").photocurrent(stack, [0])[0], mosaic[0])
    # This chip has no speed, so the same events as without filters.
    found = []
    for chip in (tmp_path / "mosaic.json", CHIP):
        pecs.sense(stack, tmp_path / "out.raw", chip=chip)
        events = pecs.read(tmp_path / "out.raw")
        found.append(events[events["t"] < 0.9 * 2 * STEP_US])  # in the end all light is that of the beginning
        (tmp_path / "out.raw").unlink()
    assert len(found[0]) > 1000 and abs(len(found[0]) / len(found[1]) - 1) < 0.002
