"""Event streams, and third-party readers of event files."""

import numpy as np
import pytest

WIDTH, HEIGHT = 1280, 720
MINUTE_US = 60_000_000


def array(*events):
    return np.array([tuple(e) for e in events], dtype=[("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])


def row_bursts():
    """Several events of one row at one time, as a row arbiter makes them."""
    rng = np.random.default_rng(1)
    out = []
    for t in range(10, 2000, 7):
        y, p, keep = rng.integers(HEIGHT), rng.integers(2), rng.integers(1, 4)
        out += [(t, x, y, p) for x in range(rng.integers(WIDTH), WIDTH) if rng.integers(keep) == 0]
        out += [(t, WIDTH - 1, y, p), (t, 0, y, p)]
    return array(*out)


def around(*times_us):
    return array(*((t + d, WIDTH - 1, 3, 1) for t in times_us for d in (-1, 0, 1)))


STREAMS = {
    "empty": array(),
    "one_at_zero": array((0, 0, 0, 0)),
    "corners": array((0, 0, 0, 1), (0, 1279, 0, 1), (0, 1279, 719, 0), (5, 0, 719, 1), (5, 1279, 719, 1)),
    "bursts": row_bursts(),
    "wraps_of_16_s": around(1 << 12, 1 << 24, 2 << 24),
    "wraps_of_71_min": around(1 << 31, 1 << 32),
    "gaps_of_minutes": array((0, 5, 5, 1), *((i * 7 * MINUTE_US + i, 1279, 719, i % 2) for i in range(1, 11))),
    "late_start": array((100 * MINUTE_US + 4095, 1279, 0, 1)),
}


# --- readers of others: path -> (t_us, x, y, p) ---------------------------------------------------------------


def by_evlib(path):
    import evlib

    events = evlib.load_events(str(path), sort=False).collect()
    return events["t"].to_physical(), events["x"], events["y"], events["polarity"].to_numpy() > 0


def by_evt3(path):
    import evt3

    events = evt3.decode_file(str(path))
    return events.timestamp, events.x, events.y, events.polarity


def by_eventcv(path):
    import eventcv

    unit = {} if path.suffix == ".raw" else {"time_unit": "microseconds"}  # else guessed from the values
    events = np.asarray(eventcv.load(str(path), **unit).numpy())  # x, y, t, p
    return events[:, 2], events[:, 0], events[:, 1], events[:, 3]


def by_faery(path):
    import faery

    packets = [*faery.events_stream_from_file(str(path))]
    events = np.concatenate(packets) if packets else np.zeros(0, faery.EVENTS_DTYPE)
    return events["t"], events["x"], events["y"], events["on"]


def by_expelliarmus_dat(path):
    import expelliarmus

    events = expelliarmus.Wizard(encoding="dat").read(str(path))
    return events["t"], events["x"], events["y"], events["p"]


def by_h5py_dsec(path):
    import h5py

    with h5py.File(path) as file:
        events = file["events"]
        return events["t"][:] + file["t_offset"][()], events["x"][:], events["y"][:], events["p"][:]


def by_h5py_metavision(path):
    import h5py

    if not h5py.h5z.filter_avail(0x8ECF):
        pytest.skip("needs the vendor's ECF plugin on HDF5_PLUGIN_PATH")
    with h5py.File(path) as file:
        events = file["CD/events"][:]
        return events["t"], events["x"], events["y"], events["p"]


def by_dv_processing(path):
    import dv_processing

    recording = dv_processing.io.MonoCameraRecording(str(path))
    assert recording.getEventResolution() == (WIDTH, HEIGHT)
    batches = []
    while recording.isRunning() and (batch := recording.getNextEventBatch()) is not None:
        batches.append(batch.numpy().copy())
    events = np.concatenate(batches) if batches else STREAMS["empty"][["t", "x", "y", "p"]]
    t, x, y, p = ("timestamp", "x", "y", "polarity") if batches else "txyp"
    return events[t], events[x], events[y], events[p]


def by_aedat(path):
    import aedat

    packets = [packet["events"] for packet in aedat.Decoder(str(path)) if "events" in packet]
    if not packets:
        return [STREAMS["empty"][name] for name in "txyp"]
    events = np.concatenate(packets)
    return events["t"], events["x"], events["y"], events["on"]


def by_numpy(path):
    with np.load(path, allow_pickle=False) as file:
        assert (file["width"], file["height"]) == (WIDTH, HEIGHT)
        return file["t"], file["x"], file["y"], file["p"]


def by_numpy_csv(path):
    assert path.read_text().splitlines()[0] == "t_us,x,y,p"
    return np.loadtxt(path, np.int64, delimiter=",", skiprows=1, ndmin=2).reshape(-1, 4).T


def by_numpy_seconds(path):
    has_size = path.read_text().startswith(f"{WIDTH} {HEIGHT}\n")
    t, x, y, p = np.loadtxt(path, np.float64, skiprows=int(has_size), ndmin=2).reshape(-1, 4).T
    return np.rint(t * 1e6), x, y, p


PEERS = [
    ("evt3", ".raw", by_evlib),
    ("evt3", ".raw", by_evt3),
    ("evt3", ".raw", by_eventcv),
    ("evt3", ".raw", by_faery),
    ("evt2", ".raw", by_evlib),
    ("evt2", ".raw", by_eventcv),
    ("evt2", ".raw", by_faery),
    ("evt21", ".raw", by_evlib),
    ("dat", ".dat", by_expelliarmus_dat),
    ("dat", ".dat", by_faery),
    ("metavision-hdf5", ".hdf5", by_h5py_metavision),
    ("dsec", ".h5", by_h5py_dsec),
    ("dsec", ".h5", by_evlib),
    ("dsec", ".h5", by_eventcv),
    ("aedat4", ".aedat4", by_dv_processing),
    ("aedat4", ".aedat4", by_aedat),
    ("npz", ".npz", by_numpy),
    ("e2vid", ".txt", by_numpy_seconds),
    ("v2e", ".txt", by_numpy_seconds),
    ("csv", ".csv", by_numpy_csv),
    ("csv", ".csv", by_faery),
]
SKIPPED = {
    ("dsec", by_evlib, "empty"): "evlib 0.13.2 cannot load an empty HDF5 file",
    ("dat", by_expelliarmus_dat, "empty"): "expelliarmus 1.1.12 cannot load an empty DAT file",
}
# 32 bits of time show no gap of 2^31 us (36 min).
SKIPPED |= {("dat", r, "late_start"): "refused" for r in (by_expelliarmus_dat, by_faery)}


def assert_same(got, wanted):
    for name, column in zip("txyp", got, strict=True):
        column = np.asarray(column).astype(np.int64)
        assert column.shape == wanted[name].shape, name
        np.testing.assert_array_equal(column, wanted[name].astype(np.int64), err_msg=name)
