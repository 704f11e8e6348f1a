"""Our event files by readers of others, and real files read by them and by us, event by event."""

import numpy as np
import pecs
import pytest
from support.event_readers import (
    HEIGHT,
    PEERS,
    SKIPPED,
    STREAMS,
    WIDTH,
    array,
    assert_same,
    by_eventcv,
    by_evlib,
    by_evt3,
    by_expelliarmus_dat,
    by_h5py_dsec,
    by_h5py_metavision,
)


@pytest.mark.filterwarnings("ignore:loadtxt")
@pytest.mark.parametrize("stream", STREAMS)
@pytest.mark.parametrize(("format", "extension", "reader"), PEERS, ids=lambda v: getattr(v, "__name__", v))
def test_peer_reads_ours(tmp_path, format, extension, reader, stream):
    if reason := SKIPPED.get((format, reader, stream)):
        pytest.skip(reason)
    path = tmp_path / f"events{extension}"
    pecs.write(path, STREAMS[stream], WIDTH, HEIGHT, format)
    assert_same(reader(path), STREAMS[stream])


@pytest.fixture
def aedat2(tmp_path):
    """Writes the layout of jAER and v2e: events of a chip among samples of frames, of the IMU and of external input."""

    def write(events, width, height, chip=None):
        t, x, y, p = (events[name].astype(np.int64) for name in "txyp")
        address = (height - 1 - y) << 22 | (width - 1 - x) << 12 | p << 11
        samples = np.array([(a, t[0]) for a in (1 << 31 | 5 << 12, 3 << 10, 1 << 10)])
        words = np.concatenate([samples.reshape(-1, 2), np.stack([address, t & 0xFFFFFFFF], axis=1)])
        header = "#!AER-DAT2.0\r\n# Timestamps tick is 1 us\r\n"
        if not chip:
            header += "# This is a raw AE data file created by AEDat2Output in v2e\r\n"
        else:
            header += f"# AEChip: eu.seebetter.ini.chips.davis.{chip}\r\n" + "# <entry key='bias'/>\r\n" * 9000
        path = tmp_path / "events.aedat"
        path.write_bytes(header.encode() + words.astype(">u4").tobytes())
        return path

    return write


@pytest.mark.parametrize(
    ("chip", "size"),
    [(None, (346, 260)), ("Davis346blue", (346, 260)), ("DAVIS240C", (240, 180)), ("Davis640", (640, 480))],
)
def test_aedat2_is_read_as_jaer_reads_it(aedat2, chip, size):
    rng, n = np.random.default_rng(1), 500
    t = np.sort(rng.integers((1 << 32) - 1_000_000, (1 << 32) + 1_000_000, n))  # 32 bits wrap
    events = array(
        *zip(t, rng.integers(0, size[0], n), rng.integers(0, size[1], n), rng.integers(0, 2, n), strict=True)
    )
    found = pecs.read(aedat2(events, *size, chip))
    assert (found.width, found.height) == size
    assert_same([found[name] for name in "txyp"], events)


def test_aedat2_by_another_reader(aedat2):
    """eventcv turns rows, not columns; jAER turns both."""
    events = array(*((10 * i, i % 346, i * 7 % 260, i % 2) for i in range(1000)))
    path = aedat2(events, 346, 260, "Davis346blue")
    t, x, y, p = by_eventcv(path)
    found = pecs.read(path)
    assert_same((t, 345 - np.asarray(x), y, p), {name: found[name] for name in "txyp"})


@pytest.mark.parametrize(
    ("chip", "width", "words"), [("CochleaAMS1c", 346, "got CochleaAMS1c"), ("DAVIS240C", 346, "pixel (-106, 0)")]
)
def test_other_aedat2_is_refused(aedat2, chip, width, words):
    path = aedat2(array((5, 0, 0, 1)), width, 180, chip)
    with pytest.raises(pecs.PecsInputError) as error:
        pecs.read(path)
    assert words in str(error.value) and str(path) in str(error.value)


def test_the_real_recording_by_the_vendors_decoder(shared):
    """Needs the vendor's HDF5 plugin (github.com/prophesee-ai/hdf5_ecf) on HDF5_PLUGIN_PATH; the sums of what it gives
    stand in tests/events/real_test.cpp."""
    path = shared / "data/real/R_360_L.hdf5"
    assert_same(by_h5py_metavision(path), pecs.read(path))


def test_the_peers_dat_by_another_reader(shared):
    path = shared / "data/peer/R_360_L_ESIM.dat"
    assert_same(by_expelliarmus_dat(path), pecs.read(path))


def test_the_real_recording_through_evt3_and_dsec(shared, tmp_path):
    ours = pecs.read(shared / "data/real/R_360_L.hdf5")
    for name, readers in (("r.raw", (by_evlib, by_evt3)), ("r.h5", (by_h5py_dsec, by_evlib))):
        pecs.write(tmp_path / name, ours, WIDTH, HEIGHT)
        for reader in readers:
            assert_same(reader(tmp_path / name), ours)


def test_metavision_indexes_are_the_vendors(shared, tmp_path):
    import h5py

    original = shared / "data/real/R_360_L.hdf5"
    pecs.write(tmp_path / "e.hdf5", pecs.read(original), WIDTH, HEIGHT)
    with h5py.File(original) as wanted, h5py.File(tmp_path / "e.hdf5") as got:
        np.testing.assert_array_equal(got["CD/indexes"][:], wanted["CD/indexes"][:])
        assert got["CD/indexes"].attrs["offset"] == wanted["CD/indexes"].attrs["offset"]
        assert got["CD/events"].dtype == wanted["CD/events"].dtype
        assert got["CD/events"].id.get_create_plist().get_filter(0)[0] == 0x8ECF


def test_a_gap_that_dat_cannot_show_is_refused(tmp_path):
    with pytest.raises(pecs.PecsError, match="event 0: .* wanted a gap below 2147483648 us"):
        pecs.write(tmp_path / "e.dat", STREAMS["late_start"], WIDTH, HEIGHT)


@pytest.mark.parametrize("compression", ["blosc", "gzip", None])
def test_dsec_from_other_writers(tmp_path, compression):
    import h5py
    import hdf5plugin

    options = {"blosc": hdf5plugin.Blosc(cname="zstd"), "gzip": {"compression": "gzip", "shuffle": True}, None: {}}
    events = STREAMS["bursts"]
    with h5py.File(tmp_path / "e.h5", "w") as file:
        for name, kind in zip("txyp", ("u4", "u2", "u2", "u1"), strict=True):
            file.create_dataset(
                f"events/{name}", data=events[name].astype(kind), chunks=(1000,), **options[compression]
            )
        file["t_offset"] = np.int64(49_599_300_523)
        file["ms_to_idx"] = np.zeros(1, "u8")
    back = pecs.read(tmp_path / "e.h5")
    assert_same((back["t"] - 49_599_300_523, back["x"], back["y"], back["p"]), events)


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "LZ4_HIGH", "ZSTD", "ZSTD_HIGH"])
def test_aedat4_from_its_own_library(tmp_path, compression):
    import dv_processing

    events = STREAMS["bursts"]
    config = dv_processing.io.MonoCameraWriter.EventOnlyConfig(
        "DVX", (WIDTH, HEIGHT), getattr(dv_processing.CompressionType, compression)
    )
    writer = dv_processing.io.MonoCameraWriter(str(tmp_path / "e.aedat4"), config)
    store = dv_processing.EventStore()
    for t, x, y, p in events.tolist():
        store.push_back(t, x, y, bool(p))
    writer.writeEvents(store)
    del writer
    with pecs.EventReader(tmp_path / "e.aedat4") as reader:
        assert reader.info == {"format": "aedat4", "width": WIDTH, "height": HEIGHT, "camera": "DVX"}
    back = pecs.read(tmp_path / "e.aedat4")
    assert_same([back[name] for name in "txyp"], events)


def test_npz_from_numpy(tmp_path):
    e = STREAMS["bursts"]
    np.savez_compressed(tmp_path / "e.npz", t=e["t"].astype(">u8"), x=e["x"].astype("i4"), y=e["y"], p=e["p"] > 0)
    assert_same([pecs.read(tmp_path / "e.npz")[name] for name in "txyp"], e)
    np.savez(tmp_path / "seconds.npz", t=e["t"] * 1e-6, x=e["x"], y=e["y"], p=e["p"])
    with pytest.raises(pecs.PecsError, match=r"t\.npy: byte \d+: got type '<f8', wanted integer microseconds"):
        pecs.read(tmp_path / "seconds.npz")


@pytest.mark.parametrize(
    "text",
    [
        "t_us,x,y,p\n5,1,2,1\n7,3,4,0\n",
        "x;y;polarity;timestamp [ms]\n1;2;1;0.005\n3;4;-1;0.007\n",
        "# anything\nt_s x y p\n5.0e-06 1.0 2.0 1.0\n.000007 3 4 0\n",
        "t_ns,p,x,y,why\n5499,1,1,2,a\n6500,0,3,4,b\n",
        "%geometry:1280,720\n1,2,1,5\n3,4,0,7\n",
        "1280 720\n0.000005 1 2 1\n7e-6 3 4 0\n",
        "#!events.txt\n# a comment\n0.000005 1 2 1 1\n7e-06 3 4 0 0\n",
        "0.000005 1 2 1\n0.000007000 3 4 0\n",
    ],
)
def test_text_conventions(tmp_path, text):
    (tmp_path / "e.csv").write_text(text)
    assert_same([pecs.read(tmp_path / "e.csv")[name] for name in "txyp"], array((5, 1, 2, 1), (7, 3, 4, 0)))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("t,x,y,p\n", r'line 1 \(byte 0\): got time column "t" without its unit, wanted t_us'),
        ("1,2,3,4\n", r"line 1 \(byte 0\): got 1,2,3,4, wanted a header line"),
        ("t_us,x,y\n", "wanted a header line such as t_us,x,y,p"),
        ("t_us,x,y,p\n1,2,3,1\n4,5,x,1\n", r"line 3 \(byte 19\): got 4,5,x,1, wanted t, x, y and p as numbers"),
        ("t_us,x,y,p\n1,2,3\n", "wanted t, x, y and p as numbers"),
        ("t_us,x,y,p,x_rectified\n1,2,3,1,9\n", 'got a second column of x, "x_rectified", wanted one of each'),
        ("t_us,x,y,p\n1,2,3,1,9\n", "wanted 4 columns"),
        ("t_us,label,x,y,p,valid\n1,,2,3,1,1\n", "wanted 6 columns, none empty"),
        ("t_us,x,y,p\n1,70000,3,1\n", "wanted a pixel"),
        ("t_us,x,y,p\n1,2,3,7\n", "p of -1, 0 or 1"),
        ("t_us,x,y,p\n99999999999999999999,2,3,1\n", "as numbers"),
        ("\n\n", "got no content"),
        ("", "got an empty file"),
    ],
)
def test_bad_text_is_placed(tmp_path, text, line):
    (tmp_path / "e.csv").write_text(text)
    with pytest.raises(pecs.PecsError, match=line) as error:
        pecs.read(tmp_path / "e.csv")
    assert error.value.code == 4


# --- python, info, convert --------------------------------------------------------------------------------------------


def test_blocks(tmp_path):
    events = STREAMS["bursts"]
    with pecs.EventWriter(tmp_path / "e.raw", WIDTH, HEIGHT, camera="IMX636") as writer:
        for block in np.array_split(events, 7):
            writer.write(block)
        assert not (tmp_path / "e.raw").exists()
    with pecs.EventReader(tmp_path / "e.raw") as reader:
        assert reader.info == {"format": "evt3", "width": WIDTH, "height": HEIGHT, "camera": "IMX636"}
        read_only = np.frombuffer(bytes(16 * 8), pecs.EVENT_DTYPE)
        with pytest.raises(ValueError, match="block: got read-only"):
            reader.read_into(read_only)
        back = np.concatenate([*reader])
    assert_same([back[name] for name in "txyp"], events)


def test_an_exception_leaves_no_output(tmp_path):
    with pytest.raises(KeyError), pecs.EventWriter(tmp_path / "e.raw", WIDTH, HEIGHT) as writer:
        writer.write(STREAMS["bursts"])
        raise KeyError
    assert not (tmp_path / "e.raw").exists()


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"t": "f8"}, "t: got float64, wanted integer microseconds"),
        ({"x": "f4"}, "x: got float32, wanted integers"),
        ({"x": "i4"}, "x: got values from -1 to 3, wanted uint16"),
    ],
)
def test_other_arrays_are_refused(tmp_path, change, line):
    kinds = {"t": "i8", "x": "u2", "y": "u2", "p": "u1"} | change
    events = np.array([(1, 3, 2, 1), (2, 3, 4, 0)], dtype=[*kinds.items()])
    if change == {"x": "i4"}:
        events["x"][1] = -1
    with pytest.raises(ValueError, match=line):
        pecs.write(tmp_path / "e.raw", events, WIDTH, HEIGHT)
    for shape, kind in (((3, 4), float), ((3, 4), pecs.EVENT_DTYPE), ((), pecs.EVENT_DTYPE)):
        with pytest.raises(ValueError, match="wanted one dimension with t, x, y and p"):
            pecs.write(tmp_path / "e.raw", np.zeros(shape, kind), WIDTH, HEIGHT)
    with pytest.raises(ValueError, match="events: got masked values"):
        pecs.write(tmp_path / "e.raw", np.ma.masked_array(np.zeros(3, pecs.EVENT_DTYPE), [0, 1, 0]), WIDTH, HEIGHT)


def test_errors_name_the_formats(tmp_path):
    (tmp_path / "e.bin").write_bytes(b"\x00\x01\x02" * 100)
    with pytest.raises(pecs.PecsError, match="byte 0: got content of no known event format, wanted one of evt3, "):
        pecs.read(tmp_path / "e.bin")
    with pytest.raises(pecs.PecsError, match="format: got evt9, wanted one of evt3, "):
        pecs.write(tmp_path / "e.raw", STREAMS["corners"], WIDTH, HEIGHT, "evt9")
    with pytest.raises(pecs.PecsError, match="wanted 1x1 to 2048x2048"):
        pecs.write(tmp_path / "e.raw", STREAMS["corners"])
    assert {"evt3", "evt2", "dat", "dsec", "metavision-hdf5", "npz", "csv"} <= {f["name"] for f in pecs.event_formats()}


def test_the_docs_list_every_format(root):
    lines = (root / "docs/reference/event_file.md").read_text().splitlines()
    rows = [line.split("|") for line in lines if line.startswith("| `")]
    listed = {row[1].strip(" `"): (row[3].strip() == "yes", row[4].strip() == "yes") for row in rows}
    assert listed == {f["name"]: (f["reads"], f["writes"]) for f in pecs.event_formats()}
