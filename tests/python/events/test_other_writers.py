"""Event files of other programs, whose content decides how they are read."""

import struct

import h5py
import numpy as np
import pecs
import pytest

N = 200
T, X, Y, P = 1000 + 100 * np.arange(N), 5 + np.arange(N) % 120, 7 + np.arange(N) % 90, np.arange(N) % 2
V2E = b"#!AER-DAT2.0\r\n# This is a raw AE data file created by AEDat2Output in v2e\r\n"
JAER = b"#!AER-DAT2.0\r\n# This is a raw AE data file - do not edit\r\n"


def assert_events(events, y=Y, p=P, t=T):
    for name, wanted in zip("txyp", (t, X, y, p), strict=True):
        np.testing.assert_array_equal(events[name], wanted, err_msg=name)


def refused(path, words, **options):
    with pytest.raises(pecs.PecsInputError, match=words):
        pecs.read(path, **options)


# --- Prophesee --------------------------------------------------------------------------------------------------------


def dat(path, version, line):
    address = X | Y << 9 | P << 17 if version == 1 else X | Y << 14 | P << 28
    head = f"% Data file containing TD events.\n{line}% Date 2015-1-1 0:0:0\n"
    path.write_bytes(head.encode() + b"\0\x08" + np.stack([T, address], 1).astype("<u4").tobytes())


@pytest.mark.parametrize("line", ["% Version {}\n", ""])
@pytest.mark.parametrize(("version", "size"), [(1, (304, 240)), (2, (125, 97))])
def test_dat_of_both_versions(tmp_path, version, size, line):
    dat(tmp_path / "e.dat", version, line.format(version))
    events = pecs.read(tmp_path / "e.dat")
    assert_events(events)
    assert (events.width, events.height) == size


def test_dat_of_another_version(tmp_path):
    dat(tmp_path / "e.dat", 2, "% Version 3\n")
    refused(tmp_path / "e.dat", "Version: got 3, wanted 1 or 2")
    dat(tmp_path / "e.dat", 2, "% Version 1\n")
    refused(tmp_path / "e.dat", r"in 18 bits \(version 1\)")


def evt2():
    words, high = [], -1
    for t, x, y, p in zip(T, X, Y, P, strict=True):
        if t >> 6 != high:
            high = t >> 6
            words.append(8 << 28 | high)
        words.append(p << 28 | (t & 63) << 22 | x << 11 | y)
    return np.array(words, "<u4").tobytes()


def evt3(times=T):
    words, high = [], -1
    for t, x, y, p in zip(times, X, Y, P, strict=True):
        if t >> 12 != high:
            high = t >> 12
            words.append(8 << 12 | high & 0xFFF)
        words += [6 << 12 | t & 0xFFF, y, 2 << 12 | p << 11 | x]
    return np.array(words, "<u2").tobytes()


@pytest.mark.parametrize("head", [b"", b"% plugin_name hal_plugin_gen31_fx3\n", b"% plugin_name hal_plugin_gen41\n"])
@pytest.mark.parametrize(("name", "data"), [("evt2", evt2()), ("evt3", evt3())])
def test_raw_that_does_not_name_its_encoding(tmp_path, head, name, data):
    (tmp_path / "e.raw").write_bytes(head + data)
    with pecs.EventReader(tmp_path / "e.raw") as reader:
        assert reader.info["format"] == name
        assert_events(reader.read())


def test_raw_that_could_be_any_encoding(tmp_path):
    (tmp_path / "e.raw").write_bytes(b"% date 2020\n" + bytes(64))
    refused(tmp_path / "e.raw", "does not name its encoding, wanted --input-format evt2, evt21 or evt3")
    (tmp_path / "e.raw").write_bytes(b"% format EVT3; height=720; width=1280\n% end\n" + evt3())
    assert pecs.read(tmp_path / "e.raw").width == 1280


# --- iniVation --------------------------------------------------------------------------------------------------------


def aedat2(path, head, size=(346, 260), times=T, y=Y):
    width, height = size
    if width == 128:  # jAER's DVS128: x from the right, y from below, 1 is OFF
        address = 127 - X << 1 | 127 - y << 8 | 1 - P
    elif width == 640:  # jAER's DVS640
        address = width - 1 - X << 1 | height - 1 - y << 11 | P
    else:
        address = height - 1 - y << 22 | width - 1 - X << 12 | P << 11
    path.write_bytes(head + np.stack([address, times], 1).astype(">u4").tobytes())


@pytest.mark.parametrize(
    ("head", "size"),
    [
        (V2E, (346, 260)),
        (V2E, (640, 480)),
        (JAER, (128, 128)),
        (JAER + b"# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n", (128, 128)),
        (JAER + b"# AEChip: eu.seebetter.ini.chips.davis.Davis346blue\r\n#End Of ASCII Header\r\n", (346, 260)),
    ],
)
def test_aedat2_of_each_camera(tmp_path, head, size):
    aedat2(tmp_path / "e.aedat", head, size)
    events = pecs.read(tmp_path / "e.aedat")
    assert_events(events)
    assert (events.width, events.height) == size


@pytest.mark.parametrize(("head", "size"), [(V2E, (240, 180)), (JAER, (346, 260))])
def test_aedat2_without_a_camera_needs_the_size(tmp_path, pecs_program, head, size):
    aedat2(tmp_path / "e.aedat", head, size)
    refused(tmp_path / "e.aedat", "AEChip: got no camera in the header, wanted --size")
    assert_events(pecs.read(tmp_path / "e.aedat", size=size))
    pecs_program("convert", tmp_path / "e.aedat", tmp_path / "o.csv", "--size", *size, check=True)
    assert_events(pecs.read(tmp_path / "o.csv"))
    refused(tmp_path / "e.aedat", "size: got 300x200", size=(300, 200))
    with pytest.raises(TypeError, match="float"):
        pecs.read(tmp_path / "e.aedat", size=(346.9, 260))


@pytest.mark.parametrize("end", [b"", b"#End Of ASCII Header\r\n"])
@pytest.mark.parametrize("row", [141, 143])
@pytest.mark.parametrize("times", [T, 0x01010100 + np.arange(N)])
def test_an_event_that_begins_like_a_comment(tmp_path, end, row, times):
    """The first byte of its address is '#'; with these times a byte '\\n' follows some events later."""
    y = Y.copy()
    y[0] = 259 - row
    aedat2(tmp_path / "e.aedat", V2E + end, times=times, y=y)
    assert_events(pecs.read(tmp_path / "e.aedat"), y=y, t=times)


def test_other_aedat_are_refused_by_name(tmp_path):
    (tmp_path / "e.aedat").write_bytes(b"#!AER-DAT3.1\r\n#Format: RAW\r\n#!END-HEADER\r\n" + bytes(64))
    refused(tmp_path / "e.aedat", "got #!AER-DAT3.1, wanted #!AER-DAT2.0 or #!AER-DAT4.0")
    refused(tmp_path / "e.aedat", "wanted #!AER-DAT2.0", format="aedat2")


XML = """<dv version="2.0"><node name="outInfo" path="/outInfo/"><node name="0" path="/outInfo/0/">
<attr key="typeIdentifier" type="string">EVTS</attr><node name="info" path="/outInfo/0/info/">
<attr key="sizeX" type="int">346</attr><attr key="sizeY" type="int">260</attr></node></node></node></dv>"""


def prefixed(*parts):
    data = b"".join(parts)
    return struct.pack("<I", len(data)) + data


def test_aedat4_of_dv_1(tmp_path):
    """DV of 2020 wrote the length before a finished FlatBuffer, whose fields are aligned to its own first byte."""
    text = XML.encode()
    header = prefixed(
        struct.pack("<I4s", 20, b"IOHE"),  # place of the table, file identifier
        struct.pack("<5H2x", 10, 20, 4, 12, 8),  # sizes of vtable and table; places in it of its three fields
        struct.pack("<iiIq", 12, 0, 12, -1),  # to the vtable; compression, to the text, place of the table of packets
        struct.pack("<I", len(text)) + text + bytes(4),
    )
    events = [struct.pack("<qhh?3x", *e) for e in zip(T.tolist(), X.tolist(), Y.tolist(), P.tolist(), strict=True)]
    packet = prefixed(
        struct.pack("<I4s", 16, b"EVTS"),
        struct.pack("<3H2x", 6, 8, 4),
        struct.pack("<iI4xI", 8, 8, N),
        *events,
    )
    (tmp_path / "e.aedat4").write_bytes(b"#!AER-DAT4.0\r\n" + header + struct.pack("<ii", 0, len(packet)) + packet)
    back = pecs.read(tmp_path / "e.aedat4")
    assert_events(back)
    assert (back.width, back.height) == (346, 260)


def test_hdf5_under_a_filter_that_is_not_built_in(tmp_path):
    plugin = pytest.importorskip("hdf5plugin")
    with h5py.File(tmp_path / "e.h5", "w") as file:
        for name, values in zip("txyp", (T, X, Y, P), strict=True):
            file.create_dataset("events/" + name, data=values, chunks=(64,), **plugin.Zstd())
    refused(tmp_path / "e.h5", "32015")


# --- events out of order ----------------------------------------------------------------------------------------------


def test_late_events_are_sorted_or_dropped_and_counted(tmp_path, pecs_program):
    times = T.copy()
    times[100] -= 300
    times[150] -= 150
    head = b"% format EVT3;height=720;width=1280\n% end\n"
    (tmp_path / "e.raw").write_bytes(head + evt3(times))
    convert = ["convert", tmp_path / "e.raw", tmp_path / "o.csv"]
    done = pecs_program(*convert)
    assert done.returncode == 4 and "--late sort, --late drop" in done.stderr
    order, kept = np.argsort(times, kind="stable"), np.delete(np.arange(N), [100, 150])
    for late, wanted in (("sort", order), ("drop", kept)):
        done = pecs_program(*convert, "--late", late)
        assert f"2 late ones {'sorted' if late == 'sort' else 'dropped'}" in done.stdout
        for events in (pecs.read(tmp_path / "o.csv"), pecs.read(tmp_path / "e.raw", late=late)):
            np.testing.assert_array_equal(events["t"], times[wanted])
            np.testing.assert_array_equal(events["x"], X[wanted])
    with pecs.EventReader(tmp_path / "e.raw", late="drop") as reader:
        while len(reader.read(7)):
            pass
        assert reader.info["late_events"] == 2


# --- options ----------------------------------------------------------------------------------------------------------


def test_the_named_text_format_is_the_one_that_is_read(tmp_path):
    seconds = "".join(f"{(t - 1000) / 1e6:.9g} {x} {y} {p}\n" for t, x, y, p in zip(T, X, Y, P, strict=True))
    assert seconds.startswith("0 5 7 0\n")
    (tmp_path / "e.txt").write_text(seconds)
    for format in (None, "v2e"):
        assert_events(pecs.read(tmp_path / "e.txt", format), t=T - 1000)
    files = {"v2e": seconds, "e2vid": "200 100\n" + seconds, "csv": "t_us,x,y,p\n5,1,2,1\n"}
    for own, text in files.items():
        (tmp_path / "e.txt").write_text(text)
        assert len(pecs.read(tmp_path / "e.txt", own))
        for other in files.keys() - {own}:
            refused(tmp_path / "e.txt", "wanted", format=other)
