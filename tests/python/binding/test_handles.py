"""Handles of the library: one by several threads at once, and after they are closed."""

import copy
import pickle
import threading

import numpy as np
import pecs
import pytest


def in_threads(count, work):
    """Runs work(thread's number) in threads; the exceptions of all."""
    raised = []

    def run(number):
        try:
            work(number)
        except Exception as e:
            raised.append(e)

    threads = [threading.Thread(target=run, args=(i,)) for i in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return raised


def test_one_sensor_in_four_threads():
    width, height, pushes = 30, 20, 200
    random = np.random.default_rng(1)
    frames = random.random((pushes, height, width), np.float32)
    with pecs.Sensor(width, height) as sensor:
        events, refused = [], []

        def work(_):
            for i in range(pushes):
                try:
                    events.append(sensor.push(frames[i], 1000.0 * i))
                except ValueError as e:  # another thread was ahead
                    refused.append(e)

        assert in_threads(4, work) == []
        events.append(sensor.finish())
    # Whoever comes first with a frame pushes it; the three others are refused.
    assert len(events) == pushes + 1 and len(refused) == 3 * pushes
    whole = pecs.simulate(frames, 1000.0 * np.arange(pushes))
    order = ["t", "y", "x", "p"]
    np.testing.assert_array_equal(np.sort(np.concatenate(events), order=order), np.sort(whole, order=order))


def test_closed_while_in_use():
    frames = np.random.default_rng(1).random((8, 20, 30), np.float32)
    for _ in range(50):
        sensor = pecs.Sensor(30, 20)
        begun = threading.Barrier(4)

        def work(number, sensor=sensor, begun=begun):
            begun.wait()
            if number == 0:
                sensor.close()
            for i in range(8):
                sensor.push(frames[i], 1000.0 * i)

        for e in in_threads(4, work):
            assert isinstance(e, ValueError) and ("closed" in str(e) or "more than" in str(e))


def test_one_reader_in_four_threads(tmp_path):
    events = np.zeros(500_000, pecs.EVENT_DTYPE)
    events["t"] = np.arange(len(events))
    pecs.write(tmp_path / "e.raw", events, 64, 48)
    found = []
    with pecs.EventReader(tmp_path / "e.raw") as reader:
        assert in_threads(4, lambda _: found.extend(block["t"].copy() for block in reader)) == []
    np.testing.assert_array_equal(np.sort(np.concatenate(found)), events["t"])


def test_closed(tmp_path):
    events = np.zeros(3, pecs.EVENT_DTYPE)
    writer = pecs.EventWriter(tmp_path / "e.npz", 4, 4)
    writer.write(events)
    writer.finish()
    reader, chip, sensor = pecs.EventReader(tmp_path / "e.npz"), pecs.Chip(), pecs.Sensor(4, 4)
    for handle in (reader, chip, sensor):
        handle.close()
        handle.close()
    bands = pecs.bands(n=3)
    for call in (
        lambda: writer.write(events),
        writer.finish,
        lambda: reader.info,
        reader.read,
        lambda: next(iter(reader)),
        lambda: sensor.push(np.ones((4, 4)), 0),
        sensor.finish,
        lambda: chip.amperes_per_unit(bands),
    ):
        with pytest.raises(ValueError, match=r"this \w+ is closed"):
            call()


def test_a_handle_that_never_opened(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        pecs.EventReader(tmp_path / "none.raw")
    assert isinstance(error.value, pecs.PecsError) and error.value.code == 3


def test_errors_are_also_pythons_own(tmp_path):
    (tmp_path / "bad.raw").write_bytes(b"no events")
    with pytest.raises(ValueError) as error:
        pecs.read(tmp_path / "bad.raw")
    assert error.value.code == 4
    with pytest.raises(OSError) as error:
        pecs.write(tmp_path / "none" / "e.npz", np.zeros(1, pecs.EVENT_DTYPE))
    assert isinstance(error.value, pecs.PecsOutputError) and error.value.code == 5
    again = pickle.loads(pickle.dumps(error.value))
    assert str(again) == str(error.value) and again.code == 5


def test_events_know_their_size(tmp_path):
    frames = np.random.default_rng(1).random((5, 20, 30), np.float32)
    events = pecs.simulate(frames, 1000.0 * np.arange(5))
    pecs.write(tmp_path / "e.raw", events)
    events = pecs.read(tmp_path / "e.raw")
    for some in (
        events,
        events[:7],
        events[events["p"] == 1],
        events[["t", "p"]],
        events.copy(),
        copy.deepcopy(events),
        pickle.loads(pickle.dumps(events)),
        np.concatenate([events[:3], events[3:]]),
        np.sort(events, order="x"),
        pecs.Events(np.asarray(events), 30, 20),
    ):
        assert isinstance(some, pecs.Events) and (some.width, some.height) == (30, 20)
    assert type(events["t"]) is np.ndarray and type(events[0]) is np.void
    assert type(events["t"].max()) is np.int64
    with pecs.EventReader(tmp_path / "e.raw") as reader:
        assert reader.read(5).width == 30
    pecs.write(tmp_path / "f.raw", events[events["x"] < 10])
    assert (pecs.read(tmp_path / "f.raw").height, len(pecs.Events(events[:0]))) == (20, 0)
    pecs.write(tmp_path / "g.raw", np.asarray(events), 30, 20)  # a plain array
    np.testing.assert_array_equal(pecs.read(tmp_path / "g.raw"), events)
