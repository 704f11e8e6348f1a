"""Faults found by trying to break the program: each is one line and the documented exit code now, and nothing is lost.
Devices are made by mknod in a folder of the test, never taken from /dev."""

import json
import os
import resource
import signal
import stat
import subprocess
import tempfile
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pecs
import pytest
from test_disk_full import random_stack, small_disk  # noqa: F401 (a fixture)


def events(count=2000, step_us=10, size=(64, 48)):
    rng = np.random.default_rng(1)
    out = np.zeros(count, dtype=[("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    out["t"] = np.arange(count) * step_us
    out["x"], out["y"] = rng.integers(size[0], size=count), rng.integers(size[1], size=count)
    out["p"] = rng.integers(2, size=count)
    return out


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "in.raw"
    pecs.write(path, events(), 64, 48)
    return path


@pytest.fixture
def stack(tmp_path):
    random_stack(tmp_path / "s", 3)
    return tmp_path / "s"


def device(path, major, minor):
    try:
        os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(major, minor))
        os.close(os.open(path, os.O_WRONLY))
    except OSError:
        pytest.skip("no device may be made and opened here")
    return path


def refused(result, code, *words):
    assert result.returncode == code, (result.returncode, result.stderr)
    assert len(result.stderr.splitlines()) == 1 and result.stderr.startswith("pecs: "), result.stderr
    for word in words:
        assert word in result.stderr, result.stderr


# --- outputs ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["evt3", "csv", "dat"])
def test_a_device_is_written_through(pecs_program, recording, tmp_path, format):
    null = device(tmp_path / "null", 1, 3)
    result = pecs_program("convert", recording, null, "--format", format)
    assert result.returncode == 0, result.stderr
    assert stat.S_ISCHR(null.stat().st_mode)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.raw", "null"]  # no record beside a device


@pytest.mark.parametrize("format", ["npz", "dsec", "metavision-hdf5", "aedat4"])
def test_a_device_is_refused_where_the_format_goes_back(pecs_program, recording, tmp_path, format):
    null = device(tmp_path / "null", 1, 3)
    refused(pecs_program("convert", recording, null, "--format", format), 5, "null", "device")
    assert stat.S_ISCHR(null.stat().st_mode)


def test_a_full_device(pecs_program, recording, tmp_path):
    refused(pecs_program("convert", recording, device(tmp_path / "full", 1, 7), "--format", "evt3"), 5, "space")


def test_a_pipe_takes_what_a_file_takes(pecs_program, recording, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE)
    assert pecs_program("convert", recording, pipe, "--format", "csv").returncode == 0
    got = reader.communicate()[0]
    assert pecs_program("convert", recording, tmp_path / "file.csv").returncode == 0
    assert got == (tmp_path / "file.csv").read_bytes() and stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("name", ["o.raw", "o.npz", "o.h5", "o.hdf5"])
def test_a_partial_that_is_a_link_is_not_followed(pecs_program, recording, tmp_path, name):
    precious = tmp_path / "precious"
    precious.write_text("mine")
    (tmp_path / f"{name}.partial").symlink_to(precious)
    refused(pecs_program("convert", recording, tmp_path / name), 5, "symbolic link")
    assert precious.read_text() == "mine"


def test_a_link_to_a_file_stays_a_link(pecs_program, recording, tmp_path):
    (tmp_path / "to").mkdir()
    (tmp_path / "to/o.raw").write_bytes(b"old")
    (tmp_path / "o.raw").symlink_to("to/o.raw")
    assert pecs_program("convert", recording, tmp_path / "o.raw").returncode == 0
    assert (tmp_path / "o.raw").is_symlink() and (tmp_path / "to/o.raw").read_bytes() == recording.read_bytes()


@pytest.mark.parametrize("name", ["o.raw", "o.npz", "o.h5", "o.hdf5", "o.aedat4", "o.csv"])
def test_the_second_of_two_writers_is_refused(pecs_program, recording, tmp_path, name):
    with pecs.EventWriter(tmp_path / name, 64, 48) as writer:
        writer.write(events())
        refused(pecs_program("convert", recording, tmp_path / name), 5, "another process")
    assert (pecs.read(tmp_path / name)["t"] == events()["t"]).all()


def test_an_output_that_is_an_input_is_refused(pecs_program, recording, stack, tmp_path):
    whole = recording.read_bytes()
    (tmp_path / "link.raw").symlink_to(recording)
    (tmp_path / "a.raw.partial").write_bytes(whole)
    for output in (recording, tmp_path / "link.raw", tmp_path / "." / "in.raw"):
        refused(pecs_program("convert", recording, output), 2, "the input itself")
    refused(pecs_program("convert", tmp_path / "a.raw.partial", tmp_path / "a.raw"), 2, "the input itself")
    assert recording.read_bytes() == whole and (tmp_path / "a.raw.partial").read_bytes() == whole
    before = {p.name: p.read_bytes() for p in stack.iterdir()}
    for name in ("stack.json", "frame_000001.exr"):
        result = pecs_program("sense", stack, "-o", stack / name, "--format", "evt3", "--gain", 1e-15)
        refused(result, 2, name, "a file of the input folder")
    labels = ["--labels", tmp_path / "o.raw"]
    refused(pecs_program("sense", stack, "-o", tmp_path / "o.raw", "--gain", 1e-15, *labels), 2, "two outputs")
    assert before == {p.name: p.read_bytes() for p in stack.iterdir()}
    assert pecs_program("sense", stack, "-o", stack / "o.raw", "--gain", 1e-15).returncode == 0
    assert pecs_program("sense", stack, "-o", stack / "o.raw", "--gain", 1e-15).returncode == 0  # over its own last


@pytest.mark.parametrize("name", ["o.npz", "o.h5", "o.hdf5"])
def test_the_same_events_are_the_same_bytes(pecs_program, recording, tmp_path, name):
    for folder, fake in (("a", "2021-03-04 05:06:07"), ("b", "1999-12-31 23:59:58")):
        (tmp_path / folder).mkdir()
        pecs_program("convert", recording, tmp_path / folder / name, env=faked_time(fake))
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    if name == "o.npz":
        with zipfile.ZipFile(tmp_path / "a" / name) as archive:
            assert {i.date_time for i in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    else:
        times = set()
        with h5py.File(tmp_path / "a" / name) as file:
            file.visititems(lambda _, item: times.add(h5py.h5g.get_objinfo(item.id).mtime))
        assert times == {0}


def faked_time(text):
    """Another time zone moves the local time of a ZIP; the clock itself needs libfaketime, which need not be there."""
    return {**os.environ, "TZ": "UTC+7" if text < "2000" else "UTC-9"}


@pytest.mark.parametrize("name", ["o.h5", "o.hdf5", "o.npz", "o.raw", "o.aedat4"])
def test_a_full_disk_is_one_line(pecs_program, small_disk, tmp_path, name):  # noqa: F811
    pecs.write(tmp_path / "in.raw", events(300_000), 64, 48)
    refused(pecs_program("convert", tmp_path / "in.raw", small_disk / name, "--quiet"), 5, name)


def test_a_limit_on_file_sizes_is_one_line(pecs_program, recording, tmp_path):
    limit = dict(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)))
    refused(pecs_program("convert", recording, tmp_path / "o.csv", **limit), 5, "o.csv")


# --- the way in and out -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("closed", [[0], [1], [2], [0, 1], [0, 2], [1, 2], [0, 1, 2]], ids=str)
def test_closed_descriptors(root, stack, tmp_path, closed):
    program = root / "build/release/bin/pecs"
    command = [program, "sense", stack, "-o", tmp_path / "o.raw", "--gain", "1e-15"]
    subprocess.run(command, check=True, capture_output=True)
    wanted = (tmp_path / "o.raw").read_bytes()
    (tmp_path / "o.raw").unlink()

    def close():
        for fd in closed:
            os.close(fd)

    result = subprocess.run(command, preexec_fn=close, stdin=subprocess.DEVNULL, capture_output=True)
    assert result.returncode == 0
    assert (tmp_path / "o.raw").read_bytes() == wanted


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals_end_the_program(root, tmp_path, sent, code):
    pecs.write(tmp_path / "in.raw", events(200_000), 64, 48)
    os.mkfifo(tmp_path / "pipe")
    command = [root / "build/release/bin/pecs", "convert", tmp_path / "in.raw", tmp_path / "pipe", "--format", "csv"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    with open(tmp_path / "pipe", "rb") as pipe:  # opened by both: the program runs, and waits for us to read
        pipe.read(1)
        process.send_signal(sent)
        assert process.wait() == code
    assert process.stderr.read() == "pecs: interrupted\n"


@pytest.mark.parametrize("args", [["--help"], ["--version"], ["info", "IN"], ["info", "IN", "--json"]], ids=str)
def test_a_standard_output_that_fails(root, recording, tmp_path, args):
    full = device(tmp_path / "full", 1, 7)
    command = [root / "build/release/bin/pecs", *(str(recording) if a == "IN" else a for a in args)]
    with open(full, "wb") as stdout:
        result = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True)
    refused(result, 5, "standard output", "space")


def test_out_of_memory_is_one_line(pecs_program, tmp_path):
    pecs.write(tmp_path / "in.raw", events(3_000_000), 64, 48)
    limit = dict(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (400 << 20, 400 << 20)))
    refused(pecs_program("compare", tmp_path / "in.raw", tmp_path / "in.raw", **limit), 7, "memory")


@pytest.mark.parametrize(
    "option",
    [["--gain", "nan"], ["--gain", "inf"], ["--fnumber", "nan"], ["--fps", "nan"], ["--seed", "-1"]],
    ids=" ".join,
)
def test_odd_numbers_are_refused_by_name(pecs_program, stack, tmp_path, option):
    result = pecs_program("sense", stack, "-o", tmp_path / "o.raw", *option)
    assert result.returncode == 2 and option[0] in result.stderr and option[1] in result.stderr, result.stderr


@pytest.mark.parametrize("option", ["--duration-us", "--start-us"])
def test_an_output_without_end_is_refused(pecs_program, stack, tmp_path, option):
    result = pecs_program("sense", stack, "-o", tmp_path / "o.raw", option, 2**63 - 1)
    assert result.returncode == 2 and option in result.stderr


@pytest.fixture
def open_folder():
    """A folder that others may enter, which pytest's may not."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


def test_what_cannot_be_read(pecs_program, tmp_path, open_folder):
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    for command in (["info", loop], ["convert", loop, tmp_path / "o.csv"], ["sense", loop, "-o", tmp_path / "o.raw"]):
        refused(pecs_program(*command), 3, "loop")
    stack = open_folder / "s"
    random_stack(stack, 2)
    somebody = {"user": 65534, "group": 65534, "cwd": "/"} if os.geteuid() == 0 else {}
    if subprocess.run([pecs_program("--version").args[0], "--version"], capture_output=True, **somebody).returncode:
        pytest.skip("the program is closed to others")
    (stack / "frame_000000.exr").chmod(0)
    refused(pecs_program("info", stack, **somebody), 3, "frame_000000.exr")
    stack.chmod(0)
    refused(pecs_program("info", stack, **somebody), 3, str(stack))
    stack.chmod(0o755)


# --- words of files in our lines ------------------------------------------------------------------------------------


def raw_text(*lines, body=b""):
    return "".join(f"% {line}\n" for line in [*lines, "end"]).encode("latin-1") + body


def test_bytes_of_files_in_errors_and_answers(pecs_program, tmp_path):
    path = tmp_path / os.fsdecode(b"\xff\x1b[31m.raw")
    path.write_bytes(raw_text("evt 3.0", "format EVT3;height=4;width=4", "sensor_name A\xff\x1bB", body=b"\0\x80"))
    result = pecs_program("info", path, "--json", errors="surrogateescape")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["camera"] == "A\\xff\\x1bB"
    assert pecs_program("convert", path, tmp_path / "o.csv", errors="surrogateescape").returncode == 0
    path.write_bytes(raw_text("format EVT\x1b9"))
    result = pecs_program("info", path)
    refused(result, 4, r"\xff\x1b[31m.raw", r"EVT\x1b9")
    assert "\x1b" not in result.stderr


def test_a_scene_name_that_is_no_text(pecs_program, stack):
    text = json.loads((stack / "stack.json").read_text())
    for name in (7, ["a"], {"b": 1}):
        (stack / "stack.json").write_text(json.dumps({**text, "scene": {"name": name}}))
        result = pecs_program("info", stack)
        assert result.returncode == 0 or "scene" in result.stderr, result.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 200_000, ["100 levels"]),
        ('{"a":' * 200_000, ["100 levels"]),
        ('{"name": 1e999}', ["1e999", "line 1"]),
        ('{"name": 1, "name": 2}', ["name", "twice"]),
        ('{"a": {"b": [{"c": 1}, {"c": 1, "c": 2}]}}', ["a.b[1].c", "twice"]),
        ('\ufeff{"name": 1}', ["byte order mark"]),
        ('{"name": "\udcff"}', ["not UTF-8"]),
        ('{"' + "k" * 400_000 + '": 1, "' + "k" * 400_000 + '": 2}', ["kkk..."]),
        ('{"a\\nb\\u001b\\u0000": 1, "a\\nb\\u001b\\u0000": 2}', ["a\\x0ab\\x1b\\x00"]),
    ],
    ids=["arrays", "objects", "number", "twice", "twice below", "mark", "utf-8", "long", "control"],
)
@pytest.mark.parametrize("kind", ["chip", "lens", "stack"])
def test_json_that_asks_too_much(pecs_program, stack, tmp_path, kind, text, words):
    path = stack / "stack.json" if kind == "stack" else tmp_path / "x.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    command = {
        "chip": ["sense", stack, "-o", tmp_path / "o.raw", "--chip", path],
        "lens": ["lens", "info", path],
        "stack": ["info", stack],
    }[kind]
    result = pecs_program(*command)
    refused(result, 4, *words)
    assert len(result.stderr) < 1000


# --- event files ------------------------------------------------------------------------------------------------------


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
        (["system_ID 49", "integrator_name Somebody"], (8, 6)),
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


def test_a_flipped_bit_in_an_npz(pecs_program, recording, tmp_path):
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
    """Each chunk is unpacked once: reading blocks of 65,536 from chunks of 4 M items took 64 times the work."""
    count = 1 << 22
    with h5py.File(tmp_path / "in.h5", "w") as file:
        for c, dtype in (("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")):
            file.create_dataset(f"events/{c}", data=np.zeros(count, dtype), chunks=(count,), compression="gzip")

    def cpu_s(chunks):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        pecs.read(tmp_path / "in.h5") if chunks else pecs.read(tmp_path / "small.h5")
        return resource.getrusage(resource.RUSAGE_SELF).ru_utime - before

    with h5py.File(tmp_path / "in.h5") as whole, h5py.File(tmp_path / "small.h5", "w") as small:
        for c in "txyp":
            small.create_dataset(f"events/{c}", data=whole[f"events/{c}"][:], chunks=(1 << 15,), compression="gzip")
    assert cpu_s(True) < 5 * cpu_s(False)


def test_npz_sizes_are_those_stored(pecs_program, tmp_path):
    np.savez(tmp_path / "a.npz", **{c: events(8)[c] for c in "txyp"})
    with zipfile.ZipFile(tmp_path / "a.npz") as old, zipfile.ZipFile(tmp_path / "b.npz", "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b"(8,), }          ", b"(2000000000,), } "))
    refused(pecs_program("info", tmp_path / "b.npz", timeout=60), 4, "2000000000 values")


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


def test_video_in_a_missing_folder(pecs_program, recording, tmp_path):
    refused(pecs_program("view", recording, "-o", tmp_path / "none/o.mp4"), 5, "No such file or directory")
