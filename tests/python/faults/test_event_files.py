"""Event files that say what is not so: see test_faults.py."""

import zipfile
from pathlib import Path

import h5py
import numpy as np
import pecs
import pytest
from support.faults import events, raw_text, refused


@pytest.mark.parametrize("line", ["format EVT4", "format EVT9;height=4;width=4", "evt 4.0"])
def test_a_raw_format_that_nobody_knows(pecs_program, tmp_path, line):
    (tmp_path / "in.raw").write_bytes(raw_text(line, body=bytes(16)))
    refused(pecs_program("info", tmp_path / "in.raw"), 4, line.split(" ")[1].split(";")[0], "EVT2, EVT21 or EVT3")


@pytest.mark.parametrize(
    ("lines", "size"),
    [
        (["system_ID 21"], (640, 480)),
        (["system_ID 28", "integrator_name Prophesee"], (640, 480)),
        (["plugin_name hal_plugin_gen3_fx3"], (640, 480)),
        (["plugin_name hal_plugin_gen31_evk2"], (640, 480)),
        (["plugin_name hal_plugin_gen41_evk3"], (1280, 720)),
        (["system_ID 49"], (1280, 720)),
        (["sensor_generation 4.2"], (1280, 720)),
        (["generation 3.1"], (640, 480)),
        (["sensor_generation 320"], (320, 320)),
        (["system_ID 49", "integrator_name Someone"], (8, 6)),
        (["geometry 100x90", "system_ID 49"], (100, 90)),
        ([], (8, 6)),
    ],
    ids=str,
)
def test_a_raw_file_without_geometry_has_the_size_of_its_camera(tmp_path, lines, size):
    pecs.write(tmp_path / "a.raw", np.array([(5, 7, 5, 1)], events(1).dtype), 8, 6, format="evt2")
    body = (tmp_path / "a.raw").read_bytes().split(b"% end\n")[1]
    (tmp_path / "b.raw").write_bytes(raw_text("evt 2.0", *lines, body=body))
    with pecs.EventReader(tmp_path / "b.raw") as reader:
        list(reader)
        assert (reader.info["width"], reader.info["height"]) == size


def test_half_a_size_is_no_size(pecs_program, tmp_path):
    e = events(10)
    np.savez(tmp_path / "in.npz", width=64, **{k: e[k] for k in "txyp"})
    assert pecs_program("convert", tmp_path / "in.npz", tmp_path / "o.npz").returncode == 0
    with np.load(tmp_path / "o.npz") as o:
        assert (o["width"], o["height"]) == (e["x"].max() + 1, e["y"].max() + 1)
    for name in ("o.npz", "o.csv", "o.h5", "o.raw"):
        with pytest.raises(pecs.PecsError, match="64x0"):
            pecs.write(tmp_path / name, e, 64, 0)


def test_a_size_that_changes_in_the_file(pecs_program, tmp_path):
    """Two recordings of Metavision's CSV, one after the other."""
    one = "%geometry:640,480\n30,10,1,100\n"
    (tmp_path / "in.csv").write_text(one + one)
    assert pecs_program("info", tmp_path / "in.csv").returncode == 0
    (tmp_path / "in.csv").write_text(one + "%geometry:320,240\n30,10,1,200\n")
    refused(pecs_program("info", tmp_path / "in.csv"), 4, "line 3", "%geometry:320,240", "640x480 as before")


@pytest.mark.parametrize("extension", [".raw", ".csv", ".npz", ".h5", ".aedat4"])
def test_an_empty_file_is_said(pecs_program, tmp_path, extension):
    (tmp_path / f"in{extension}").touch()
    refused(pecs_program("info", tmp_path / f"in{extension}"), 4, "an empty file")


BAD_COLUMNS = [
    ("x", np.int32, -1, "x{}[3]: got -1, wanted 0 to"),
    ("x", np.int64, 1_000_000, "x{}[3]: got 1000000, wanted 0 to"),
    ("y", np.uint64, 2**40, "y{}[3]: got 1099511627776, wanted 0 to"),
    ("t", np.uint64, 2**64 - 1, "t{}[3]: got 18446744073709551615, wanted at most 9223372036854775807"),
    ("p", np.int16, 7, "p{}[3]: got 7, wanted -1, 0 or 1"),
    ("p", np.int8, -2, "p{}[3]: got -2, wanted -1, 0 or 1"),
]


@pytest.mark.parametrize("kind", ["npz", "dsec", "metavision"])
@pytest.mark.parametrize(("column", "dtype", "value", "words"), BAD_COLUMNS, ids=lambda v: str(v)[:12])
def test_integers_out_of_range_are_named(pecs_program, tmp_path, kind, column, dtype, value, words):
    values = {c: events(8)[c].astype(dtype if c == column else events(1).dtype[c]) for c in "txyp"}
    values[column][3] = value
    path = tmp_path / ("in.npz" if kind == "npz" else "in.h5")
    if kind == "npz":
        np.savez(path, **values)
    else:
        with h5py.File(path, "w") as file:
            if kind == "dsec":
                for c in "txyp":
                    file[f"events/{c}"] = values[c]
            else:
                items = np.zeros(8, dtype=[(c, values[c].dtype) for c in "xypt"])
                for c in "txyp":
                    items[c] = values[c]
                file["CD/events"] = items
    refused(pecs_program("info", path), 4, words.format(".npy" if kind == "npz" else ""))


def test_a_flipped_bit_in_an_npz(pecs_program, tmp_path):
    path = tmp_path / "o.npz"
    for save in (np.savez, np.savez_compressed):
        save(path, **{c: events()[c] for c in "txyp"})
        good = path.read_bytes()
        with zipfile.ZipFile(path) as archive:
            at = archive.getinfo("x.npy").header_offset + 400
        path.write_bytes(good[:at] + bytes([good[at] ^ 1]) + good[at + 1 :])
        refused(pecs_program("info", path), 4, "x.npy")


def test_npz_words(pecs_program, tmp_path):
    np.savez(tmp_path / "in.npz", t=np.int64(1), x=np.int64(1), y=np.int64(1), p=np.int64(1))
    refused(pecs_program("info", tmp_path / "in.npz"), 4, "got a single value without a dimension, wanted an array")


def dsec(path, **changes):
    with h5py.File(path, "w") as file:
        for c in "txyp":
            if c not in changes:
                file[f"events/{c}"] = events(8)[c]
        for c, make in changes.items():
            make(file, c)


@pytest.mark.parametrize("kind", ["virtual", "missing source", "external storage", "external link", "group", "soft"])
def test_hdf5_of_other_files_is_not_followed(pecs_program, tmp_path, kind):
    path, other = tmp_path / "in.h5", tmp_path / "other.h5"
    if kind != "missing source":
        dsec(other)
    (tmp_path / "secret").write_bytes(bytes(range(64)))

    def virtual(file, c):
        layout = h5py.VirtualLayout(shape=(8,), dtype="<u2")
        layout[:] = h5py.VirtualSource(other.name, "events/x", shape=(8,))
        file.create_virtual_dataset(f"events/{c}", layout, fillvalue=0)

    def storage(file, c):
        file.create_dataset(f"events/{c}", (8,), "<u2", external=[("secret", 0, 16)])

    def link(file, c):
        file[f"events/{c}"] = h5py.ExternalLink(other.name, "/events/x")

    def soft(file, c):
        file["out"] = h5py.ExternalLink(other.name, "/")
        file[f"events/{c}"] = h5py.SoftLink("/out/events/x")

    if kind == "group":
        with h5py.File(path, "w") as file:
            file["events"] = h5py.ExternalLink(other.name, "/events")
    else:
        makers = {"external storage": storage, "external link": link, "soft": soft}
        dsec(path, x=makers.get(kind, virtual))
    result = pecs_program("info", path, cwd=tmp_path)
    refused(result, 4, "/events")
    assert "this file" in result.stderr


@pytest.mark.parametrize("count", [2_000_000_000, 2**60])
@pytest.mark.parametrize("kind", ["dsec", "metavision"])
def test_hdf5_sizes_are_those_stored(pecs_program, tmp_path, kind, count):
    path = tmp_path / "in.h5"
    with h5py.File(path, "w") as file:
        if kind == "dsec":
            for c in "txyp":
                file.create_dataset(f"events/{c}", (count,), events(1).dtype[c], chunks=(1 << 16,))
        else:
            dtype = [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")]
            file.create_dataset("CD/events", (count,), dtype, chunks=(1 << 14,))
    refused(pecs_program("convert", path, tmp_path / "o.raw", timeout=60), 4, f"{count} items", "chunks")
    path.unlink()
    with h5py.File(path, "w") as file:  # contiguous, never written
        for c in "txyp":
            file.create_dataset(f"events/{c}", (count,), events(1).dtype[c])
    refused(pecs_program("info", path, timeout=60), 4, f"{count} items")


def test_large_hdf5_chunks_are_read_once(tmp_path):
    """Blocks of 65,536 events from chunks of 4 M read every chunk 64 times, by the bytes that the system hands over."""
    count, path = 1 << 22, tmp_path / "in.h5"
    columns = {c: np.zeros(count, dtype) for c, dtype in (("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1"))}
    columns["x"] = np.random.default_rng(1).integers(0, 640, count, np.uint16)
    with h5py.File(path, "w") as file:
        for c, values in columns.items():
            file.create_dataset(f"events/{c}", data=values, chunks=(count,), compression=1)

    def bytes_read():
        return int(Path("/proc/self/io").read_text().split()[1])  # rchar

    before = bytes_read()
    np.testing.assert_array_equal(pecs.read(path)["x"], columns["x"])
    assert path.stat().st_size < bytes_read() - before < 3 * path.stat().st_size


def test_npz_sizes_are_those_stored(pecs_program, tmp_path):
    np.savez(tmp_path / "a.npz", **{c: events(8)[c] for c in "txyp"})
    with zipfile.ZipFile(tmp_path / "a.npz") as old, zipfile.ZipFile(tmp_path / "b.npz", "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b"(8,), }          ", b"(2000000000,), } "))
    refused(pecs_program("info", tmp_path / "b.npz", timeout=60), 4, "2000000000 values")


def test_a_video_is_no_text_of_events(pecs_program, tmp_path):
    """Words of four columns, the first with a point, may stand in any binary file."""
    (tmp_path / "a.mp4").write_bytes(b"\0\0\0\x1cftyp.isom\0 \1 \2 \3\n")
    refused(pecs_program("info", tmp_path / "a.mp4"), 4, "got content of no known event format")
    refused(pecs_program("sense", tmp_path / "a.mp4", "-o", "e.raw"), 4, "got no video that OpenCV can read")


@pytest.mark.parametrize("ends", ["\r", "\r\n", "\n"], ids=["cr", "crlf", "lf"])
@pytest.mark.parametrize("mark", ["", "\ufeff"], ids=["", "bom"])
def test_csv_from_elsewhere(tmp_path, ends, mark):
    text = mark + ends.join(["t_us,x,y,p", "1,2,3,0", "4,5,6,1", ""])
    (tmp_path / "in.csv").write_bytes(text.encode())
    assert [tuple(e) for e in pecs.read(tmp_path / "in.csv")] == [(1, 2, 3, 0), (4, 5, 6, 1)]
    bad = text.replace("4,5", "4,x")
    (tmp_path / "in.csv").write_bytes(bad.encode())
    with pytest.raises(pecs.PecsError, match=rf"line 3 \(byte {bad.encode().index(b'4,x')}\)"):
        pecs.read(tmp_path / "in.csv")


def test_utf16_csv_is_said(pecs_program, tmp_path):
    (tmp_path / "in.csv").write_bytes("t_us,x,y,p\n1,2,3,0\n".encode("utf-16"))
    refused(pecs_program("info", tmp_path / "in.csv", "--format", "csv"), 4, "UTF-16")


@pytest.mark.parametrize("format", ["evt2", "dat", "csv"])
def test_times_that_fall_are_the_inputs(pecs_program, tmp_path, format):
    path = tmp_path / {"evt2": "in.raw", "dat": "in.dat", "csv": "in.csv"}[format]
    pecs.write(path, events(5), 64, 48, format=format)
    data = path.read_bytes()
    if format == "csv":
        lines = data.split(b"\n")
        lines[2], lines[3] = lines[3], lines[2]
        data, wanted = b"\n".join(lines), len(b"\n".join(lines[:3])) + 1
    else:
        size = 4 if format == "evt2" else 8
        wanted = len(data) - 3 * size
        a, b = data[wanted - size : wanted], data[wanted : wanted + size]
        data = data[: wanted - size] + b + a + data[wanted + size :]
    path.write_bytes(data)
    result = pecs_program("convert", path, tmp_path / "o.aedat4")
    refused(result, 4, f"{path}: event 2 (", f"byte {wanted})", "t = 10 us")
