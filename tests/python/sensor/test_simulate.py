"""pecs.simulate and pecs.Sensor: frames in memory."""

import numpy as np
import pecs
import pytest

H, W = 30, 40


def waves(n=40):
    t = np.arange(n) * 1000.0
    y, x = np.mgrid[0:H, 0:W]
    return (1.5 + 1.4 * np.sin(0.3 * x + 0.05 * y - t[:, None, None] * 2e-3)).astype(np.float32), t


@pytest.mark.parametrize("chip", ["imx636", "ideal"])
def test_frame_by_frame_is_the_same(chip):
    frames, t = waves()
    whole = pecs.simulate(frames, t, chip=chip, threads=1)
    assert len(whole) > 1000 and (np.diff(whole["t"]) >= 0).all()
    with pecs.Sensor(W, H, chip) as sensor:
        pushed = [sensor.push(frame, time) for frame, time in zip(frames, t, strict=True)] + [sensor.finish()]
    np.testing.assert_array_equal(np.concatenate(pushed), whole)
    assert not np.array_equal(whole, other := pecs.simulate(frames, t, chip=chip, seed=2)) or chip == "ideal"
    np.testing.assert_array_equal(pecs.simulate(frames, t, chip=chip, seed=np.int64(2)), other)


def test_input_types():
    frames, t = waves()
    linear = frames / 3
    reference = pecs.simulate(linear, t, chip="ideal")
    np.testing.assert_array_equal(pecs.simulate(linear.astype(np.float64), t, chip="ideal"), reference)
    np.testing.assert_array_equal(pecs.simulate(linear[:, :, ::-1][:, :, ::-1], t, chip="ideal"), reference)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    for encoded in ((srgb * 65535).round().astype(np.uint16), (srgb * 255).round().astype(np.uint8)):
        assert len(pecs.simulate(encoded, t, chip="ideal")) == pytest.approx(len(reference), rel=0.03)


def test_tensors_by_dlpack():
    frames, t_us = waves()
    frames = frames.copy()

    class Tensor:  # what a tensor library without NumPy's own interface shows
        def __dlpack__(self, **options):
            return frames.__dlpack__(**options)

        def __dlpack_device__(self):
            return frames.__dlpack_device__()

    assert (pecs.simulate(Tensor(), t_us) == pecs.simulate(frames, t_us)).all()


def test_errors():
    frames, t = waves()
    with pytest.raises(ValueError, match="wanted"):
        pecs.simulate(frames, t[:-1])
    with pytest.raises(ValueError, match="int32"):
        pecs.simulate(frames.astype(np.int32), t)
    with pytest.raises(ValueError, match="frames: got masked values"):
        pecs.simulate(np.ma.masked_array(frames, frames > np.median(frames)), t)
    for times in (*(t.astype(kind) for kind in ("m8[us]", "M8[ms]", complex, str)), np.ma.masked_equal(t, 5000)):
        with pytest.raises(ValueError, match="t_us: got "):
            pecs.simulate(frames, times)
        with pecs.Sensor(W, H) as sensor, pytest.raises(ValueError, match="t_us: got "):
            sensor.push(frames, times)
    with pytest.raises(pecs.PecsError, match="unknown key"):
        pecs.simulate(frames, t, overrides={"threshold": 1})
    with pytest.raises(pecs.PecsError, match="more than"):
        pecs.simulate(frames, t[::-1])
    with pytest.raises(pecs.PecsNotFoundError, match="none of"):
        pecs.Sensor(W, H, "nope")
    with pytest.raises(pecs.PecsInputError, match="size: got 1400x800, wanted at most imx636's 1280x720"):
        pecs.Sensor(1400, 800)
    for noise in (None, "no", 0.5):  # None was False, the others True
        with pytest.raises(pecs.PecsInputError, match="noise: got .*, wanted True or False"):
            pecs.simulate(frames, t, noise=noise)
    with pytest.raises(TypeError, match="no_such"):
        pecs.simulate(frames, t, no_such=1)
    sensor = pecs.Sensor(W, H)
    sensor.finish()
    with pytest.raises(ValueError, match="closed"):
        sensor.push(frames[0], 0)


def test_times_in_seconds():
    frames, t = waves()
    with pytest.raises(ValueError, match="t_us: got 0.001 between frames, wanted microseconds"):
        pecs.simulate(frames, t * 1e-6)
    with pecs.Sensor(W, H) as sensor:
        sensor.push(frames[0], 0)
        with pytest.raises(ValueError, match="wanted microseconds"):
            sensor.push(frames[1], 0.033)
        assert len(sensor.push(frames[1:], t[1:], last=True))  # a refused push changes nothing


def test_a_refused_push_changes_nothing():
    frames, t = waves()
    whole = pecs.simulate(frames, t)
    with pecs.Sensor(W, H) as sensor:
        parts = []
        for i in range(len(t)):
            parts.append(sensor.push(frames[i], t[i]))
            with pytest.raises(ValueError, match="more than"):
                sensor.push(frames[:3], [t[i] + 1, t[i] + 9, t[i] + 5])
        parts.append(sensor.finish())
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_values_that_no_light_has(recwarn):
    frames, t = waves()
    clean = frames.copy()
    clean[3, 4, 5:9] = 0
    frames[3, 4, 5:9] = -0.5
    with pytest.warns(UserWarning, match="frames: values that no light has: 0 not finite, 4 negative"):
        events = pecs.simulate(frames, t)
    np.testing.assert_array_equal(events, pecs.simulate(clean, t))  # darkness
    frames[10, :2] = np.nan
    frames[11, 2] = np.inf
    recwarn.clear()
    with pecs.Sensor(W, H) as sensor:
        for frame, time in zip(frames, t, strict=True):
            sensor.push(frame, time)
        assert sensor.bad_values == {"not_finite": 3 * W, "negative": 4}
    assert len(recwarn) == 1  # the first push that had some


def test_progress_can_stop():
    frames, t = waves()
    done = []
    pecs.simulate(frames, t, progress=done.append)
    assert done[-1] == 1

    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pecs.simulate(frames, t, progress=stop)


@pytest.mark.parametrize("chip", ["imx636", "davis346", "ideal"])
def test_labels(chip):
    frames, t = waves()
    plain = pecs.simulate(frames, t, chip, photocurrent_a=1e-14)
    events = pecs.simulate(frames, t, chip, photocurrent_a=1e-14, labels=True)
    for name in ("t", "x", "y", "p"):
        np.testing.assert_array_equal(events[name], plain[name])
    assert (events.width, events.height) == (W, H)
    assert events["label"].max() <= 3 and (events["label"] == 0).mean() > 0.5
