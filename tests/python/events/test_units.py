"""Times of files that do not state their unit: one rule for all doors, the same in Python and on the command line."""

import cv2
import h5py
import numpy as np
import pecs
import pytest

N = 200
T, X, Y, P = 1000 + 137 * np.arange(N), 5 + np.arange(N) % 120, 7 + np.arange(N) % 90, np.arange(N) % 2
PER_US = {"ns": 1e3, "us": 1, "ms": 1e-3, "s": 1e-6}


def text(path, per_us, digits=1):
    path.write_text("".join(f"{t * per_us:.{digits}f} {x} {y} {p}\n" for t, x, y, p in zip(T, X, Y, P, strict=True)))


def npz(path, per_us):
    np.savez(path, t=np.int64(T * per_us), x=X, y=Y, p=P)


def hdf5(path, per_us, **more):
    with h5py.File(path, "w") as file:
        for name, values in zip("txyp", (np.int64(T * per_us), X, Y, P), strict=True):
            file["events/" + name] = values
        for name, values in more.items():
            file[name] = values


WRITERS = {"e.txt": text, "e.npz": npz, "e.h5": hdf5}


@pytest.mark.parametrize(
    ("name", "unit"), [("e.txt", "us"), ("e.txt", "ns"), ("e.txt", "ms"), ("e.npz", "ns"), ("e.h5", "ns")]
)
def test_another_unit_is_refused_and_can_be_stated(tmp_path, pecs_program, name, unit):
    path = tmp_path / name
    WRITERS[name](path, PER_US[unit], *([3] if unit == "ms" else []))
    with pytest.raises(pecs.PecsInputError, match="--time-unit") as error:
        pecs.read(path)
    for command in (["info", path], ["convert", path, tmp_path / "o.csv"]):
        done = pecs_program(*command)
        assert (done.returncode, done.stderr) == (4, f"pecs: {error.value}\n")
        assert pecs_program(*command, "--time-unit", unit).returncode == 0
    np.testing.assert_array_equal(pecs.read(path, time_unit=unit)["t"], T)
    np.testing.assert_array_equal(pecs.read(tmp_path / "o.csv")["t"], T)


@pytest.mark.parametrize(("name", "arguments"), [("e.txt", (1e-6, 6)), ("e.npz", (1,)), ("e.h5", (1,))])
def test_the_unit_of_the_format_needs_no_option(tmp_path, name, arguments):
    WRITERS[name](tmp_path / name, *arguments)
    np.testing.assert_array_equal(pecs.read(tmp_path / name)["t"], T)


def bare(path, t, width=125, height=97):
    i = np.arange(len(t))
    np.savez(path, t=t, x=i % width, y=i % height, p=i % 2)
    return path


@pytest.mark.parametrize(
    ("t", "got"),
    [
        (T * 1000 + 7, "steps of 1000 us alone"),  # a clock in us with an offset
        (np.floor(T * 1e-6 * 1e9).astype(np.int64), "steps of 1000 us alone"),  # through a float of seconds
        (1_700_000_000_000_000_000 + 7 * T, "us, wanted times that can only be us"),  # since 1970
    ],
)
def test_nanoseconds_that_no_recording_has_by_chance(tmp_path, t, got):
    path = bare(tmp_path / "e.npz", t)
    with pytest.raises(pecs.PecsInputError, match=f"{got}.*--time-unit"):
        pecs.read(path)
    assert len(pecs.read(path, time_unit="ns")) == N


@pytest.mark.parametrize(("width", "height", "per_pixel"), [(128, 128, 10), (640, 480, 10), (1280, 720, 30)])
def test_nanoseconds_of_a_clock_that_resolves_them(tmp_path, width, height, per_pixel):
    """At the rates of a moving camera (docs/howto/cost.md), 160,000 to 28 million events per second."""
    gaps = np.random.default_rng(1).exponential(1e9 / (per_pixel * width * height), 5000)
    path = bare(tmp_path / "e.npz", np.cumsum(gaps).astype(np.int64), width, height)
    with pytest.raises(pecs.PecsInputError, match=r"events per second of \d+x\d+ pixels, if times are us.*--time-unit"):
        pecs.read(path)
    assert len(pecs.read(path, time_unit="ns")) == 5000
    np.savez(path, **{**np.load(path), "t": np.cumsum(gaps * 1e-3).astype(np.int64)})
    assert len(pecs.read(path)) == 5000


def test_files_that_state_their_unit(tmp_path):
    """What PECS writes is read whatever the times are; ms_to_idx states the unit of DSEC's files."""
    events = np.zeros(N, pecs.EVENT_DTYPE)
    events["t"] = 1000 * np.arange(N)
    for name in ("e.npz", "e.h5", "e.csv", "e.raw"):
        pecs.write(tmp_path / name, events, 8, 8)
        np.testing.assert_array_equal(pecs.read(tmp_path / name)["t"], events["t"])
    for name in ("e.csv", "e.raw"):
        with pytest.raises(pecs.PecsError, match="time_unit: got ns, wanted none"):
            pecs.read(tmp_path / name, time_unit="ns")
    index = np.searchsorted(T, 1000 * np.arange(T[-1] // 1000 + 1))
    hdf5(tmp_path / "d.h5", 1, ms_to_idx=index)
    np.testing.assert_array_equal(pecs.read(tmp_path / "d.h5")["t"], T)
    (tmp_path / "d.h5").unlink()
    hdf5(tmp_path / "d.h5", 1000, ms_to_idx=index)
    with pytest.raises(pecs.PecsInputError, match="ms_to_idx"):
        pecs.read(tmp_path / "d.h5")
    np.testing.assert_array_equal(pecs.read(tmp_path / "d.h5", time_unit="ns")["t"], T)


def test_a_column_of_time_without_unit(tmp_path):
    (tmp_path / "e.csv").write_text("t,x,y,p\n5,1,2,1\n7,3,4,0\n")
    assert pecs.read(tmp_path / "e.csv", time_unit="ms")["t"].tolist() == [5000, 7000]
    with pytest.raises(pecs.PecsError, match="time_unit: got h, wanted s, ms, us or ns"):
        pecs.read(tmp_path / "e.csv", time_unit="h")


FRAMES = np.linspace(0.2, 0.8, 20)[:, None, None] * np.ones((20, 4, 5))


@pytest.mark.parametrize(("unit", "step"), [("s", 1e-3), ("ns", 1e6), ("ms", 1.0)])
def test_times_of_frames(tmp_path, pecs_program, unit, step):
    folder = tmp_path / "p"
    folder.mkdir()
    for i, frame in enumerate(FRAMES.astype(np.float32)):
        cv2.imwrite(str(folder / f"{i}.tif"), frame)
    times = step * np.arange(20)
    (tmp_path / "t.txt").write_text("\ufeff" + "".join(f"{t:.6f}\n" for t in times))  # as Windows' editors write it
    args = ["sense", folder, "-o", tmp_path / "o.npz", "--chip", "ideal", "--times", tmp_path / "t.txt"]
    done = pecs_program(*args)
    if unit == "ms":  # 1 us between frames is possible
        assert done.returncode == 0 and "1 us apart; if the file is not in us, state --time-unit" in done.stderr
        (tmp_path / "o.npz").unlink()
    else:
        assert done.returncode == 4 and "--time-unit" in done.stderr and len(done.stderr.splitlines()) == 1
        with pytest.raises(pecs.PecsInputError, match="time_unit"):
            pecs.simulate(FRAMES, times, "ideal")
    assert pecs_program(*args, "--time-unit", unit).returncode == 0
    wanted = pecs.simulate(FRAMES, 1000.0 * np.arange(20), "ideal")
    assert len(wanted) > 50
    for events in (pecs.read(tmp_path / "o.npz"), pecs.simulate(FRAMES, times, "ideal", time_unit=unit)):
        np.testing.assert_array_equal(events["t"], wanted["t"])


def test_frames_with_times_since_1970(tmp_path, pecs_program):
    for i, frame in enumerate(FRAMES.astype(np.float32)):
        cv2.imwrite(str(tmp_path / f"{i}.tif"), frame)
    (tmp_path / "t.txt").write_text("".join(f"{1_700_000_000_000_000_000 + 1_000_000 * i}\n" for i in range(20)))
    args = ["sense", tmp_path, "-o", tmp_path / "o.npz", "--chip", "ideal", "--times", tmp_path / "t.txt"]
    assert pecs_program(*args).returncode == 4
    assert pecs_program(*args, "--time-unit", "ns").returncode == 0
    assert pecs.read(tmp_path / "o.npz")["t"].max() <= 19_000


def test_integers_of_16_bits_are_the_same_light_everywhere(tmp_path, pecs_program):
    frames = np.round(65535 * FRAMES).astype(np.uint16)
    for i, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"{i}.png"), frame)
    assert pecs_program("sense", tmp_path, "-o", tmp_path / "o.npz", "--chip", "ideal", "--fps", 1000).returncode == 0
    for encoding in (None, "srgb"):
        events = pecs.simulate(frames, 1000.0 * np.arange(20), "ideal", encoding=encoding)
        np.testing.assert_array_equal(pecs.read(tmp_path / "o.npz")["t"], events["t"])
    assert len(pecs.simulate(frames, 1000.0 * np.arange(20), "ideal", encoding="linear")) < len(events)
