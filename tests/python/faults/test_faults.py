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
import pecs
import pytest
from support.faults import device, events, random_stack, raw_text, refused


def test_a_picture_that_ends_too_soon_is_one_line(pecs_program, tmp_path):
    """OpenCV writes a line of its own to std::cerr."""
    for name in ("a.ppm", "b.ppm"):
        (tmp_path / name).write_bytes(b"P6\n32 24\n255\n" + bytes(100))
    words = ("-o", tmp_path / "o.raw", "--fps", "100", "--photocurrent", "1pA", "--quiet")
    refused(pecs_program("sense", tmp_path, *words), 4, "a.ppm", "no picture that OpenCV can read")


# --- outputs ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["evt3", "csv", "dat"])
def test_a_device_is_written_through(pecs_program, recording, tmp_path, format):
    null = device(tmp_path / "null", 1, 3)
    pecs_program("convert", recording, null, "--format", format, check=True)
    assert stat.S_ISCHR(null.stat().st_mode)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.raw", "null"]  # no record of a device


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
    for name in ("o.raw", "o.raw.run.json", "o.raw.partial"):  # with the run record, which came last
        words = ["-o", tmp_path / "o.raw", "--gain", 1e-15, "--labels", tmp_path / name]
        refused(pecs_program("sense", stack, *words), 2, "two outputs")
        with pytest.raises(pecs.PecsInputError, match="two outputs"):
            pecs.sense(stack, tmp_path / "o.raw", gain=1e-15, labels=tmp_path / name)
        assert not (tmp_path / "o.raw").exists()
    assert before == {p.name: p.read_bytes() for p in stack.iterdir()}
    assert pecs_program("sense", stack, "-o", stack / "o.raw", "--gain", 1e-15).returncode == 0
    assert pecs_program("sense", stack, "-o", stack / "o.raw", "--gain", 1e-15).returncode == 0  # over its own last


def test_the_video_of_a_view_is_an_output(pecs_program, tmp_path):
    (tmp_path / "v.mp4").write_bytes(b"mine")
    for output, more, got in (("v", [], "the input itself"), ("w", ["--labels", tmp_path / "w.mp4"], "two outputs")):
        words = ["-o", tmp_path / output, "--format", "evt3", "--view", *more]
        refused(pecs_program("sense", tmp_path / "v.mp4", *words), 2, got)
    assert (tmp_path / "v.mp4").read_bytes() == b"mine"


@pytest.mark.parametrize("name", ["o.npz", "o.h5", "o.hdf5"])
def test_the_same_events_are_the_same_bytes(pecs_program, recording, tmp_path, name):
    for folder, zone in (("a", "UTC-9"), ("b", "UTC+7")):  # it moves the local time of a ZIP
        (tmp_path / folder).mkdir()
        pecs_program("convert", recording, tmp_path / folder / name, env={**os.environ, "TZ": zone})
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    if name == "o.npz":
        with zipfile.ZipFile(tmp_path / "a" / name) as archive:
            assert {i.date_time for i in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    else:
        times = set()
        with h5py.File(tmp_path / "a" / name) as file:
            file.visititems(lambda _, item: times.add(h5py.h5g.get_objinfo(item.id).mtime))
        assert times == {0}


@pytest.mark.parametrize("name", ["o.h5", "o.hdf5", "o.npz", "o.raw", "o.aedat4"])
def test_a_full_disk_is_one_line(pecs_program, small_disk, tmp_path, name):
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
    heard = lambda: signal.signal(sent, signal.SIG_DFL)  # noqa: E731  where we run in the background, SIGINT is ignored
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heard)
    with open(tmp_path / "pipe", "rb") as pipe:  # opened by both: the program runs, and waits for us to read
        pipe.read(1)
        process.send_signal(sent)
        assert process.wait(timeout=60) == code
    assert process.stderr.read() == "pecs: interrupted\n"


@pytest.mark.parametrize("args", [["--help"], ["--version"], ["info", "IN"], ["info", "IN", "--json"]], ids=str)
def test_a_standard_output_that_fails(root, recording, tmp_path, args):
    full = device(tmp_path / "full", 1, 7)
    command = [root / "build/release/bin/pecs", *(str(recording) if a == "IN" else a for a in args)]
    with open(full, "wb") as stdout:
        result = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True)
    refused(result, 5, "standard output", "space")


@pytest.mark.skipif("asan" in os.environ.get("LD_PRELOAD", ""), reason="the sanitizer reserves terabytes of addresses")
def test_out_of_memory_is_one_line(pecs_program, tmp_path):
    pecs.write(tmp_path / "in.raw", events(3_000_000), 64, 48)
    limit = dict(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (400 << 20, 400 << 20)))
    refused(pecs_program("compare", tmp_path / "in.raw", tmp_path / "in.raw", **limit), 7, "memory")


@pytest.mark.parametrize(
    "option",
    [
        ["--gain", "nan"],
        ["--gain", "inf"],
        ["--gain", "-0"],
        ["--fnumber", "nan"],
        ["--fps", "nan"],
        ["--seed", "-1"],
        ["--seed", "18446744073709551616"],
    ],
    ids=" ".join,
)
def test_odd_numbers_are_refused_by_name(pecs_program, stack, tmp_path, option):
    result = pecs_program("sense", stack, "-o", tmp_path / "o.raw", *option)
    refused(result, 2, f"{option[0]}: ", f" {option[1]}")
    assert len(result.stderr) < 200


def test_a_time_beyond_all_recordings(pecs_program, recording, tmp_path):
    """It became another number: `--from 1e30s` drew everything."""
    for option in ("--from", "--to"):
        result = pecs_program("view", recording, "-o", tmp_path / "o.png", option, "1e30s")
        refused(result, 2, option, "1e30s")


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (["--fps", "1e-308"], "--fps: got 1e-308, wanted 2e-09 to 1e+09 for 3 frames"),
        (["--fps", "1e300"], "--fps: got 1e+300, wanted 2e-09 to 1e+09"),
        (["--fps", "9", "--bias", "diff_on=3", "--bias", "bias_diff_on=5"], "diff_on is set twice; set it once"),
    ],
    ids=lambda value: value[-1] if isinstance(value, list) else "",
)
def test_values_that_made_other_values(pecs_program, tmp_path, option, said):
    for i in range(3):
        (tmp_path / f"{i}.pgm").write_bytes(b"P5\n8 4\n255\n" + bytes(range(i, i + 32)))
    refused(pecs_program("sense", tmp_path, "-o", tmp_path / "o.raw", *option), 2, said)
    with pytest.raises(pecs.PecsError, match="each bias once"):
        pecs.Sensor(8, 4, photocurrent_a=1e-12, biases={"diff_on": 3, "bias_diff_on": 5})


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (["--t-start", "9us", "--t-end", "9us"], "--t-end: got 9 us, wanted later than --t-start, 9 us"),
        (["--decimate", "96"], "--decimate: got 96, wanted at most 95 for 64x48 pixels"),
    ],
    ids=["times", "pixels"],
)
def test_a_selection_of_nothing(pecs_program, recording, tmp_path, option, said):
    refused(pecs_program("convert", recording, tmp_path / "o.raw", *option), 2, said)
    assert pecs_program("convert", recording, tmp_path / "o.raw", "--decimate", 95).returncode == 0


@pytest.mark.parametrize("option", ["--duration", "--start"])
def test_an_output_without_end_is_refused(pecs_program, stack, tmp_path, option):
    result = pecs_program("sense", stack, "-o", tmp_path / "o.raw", option, 2**63 - 1)
    assert result.returncode == 2 and option in result.stderr
    with pytest.raises(pecs.PecsInputError, match=f"{option[2:]}_us"):
        pecs.sense(stack, tmp_path / "o.raw", gain=1e-15, **{f"{option[2:]}_us": 2 * 86_400_000_000})


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
    other_user = {"user": 65534, "group": 65534, "cwd": "/"} if os.geteuid() == 0 else {}
    if subprocess.run([pecs_program("--version").args[0], "--version"], capture_output=True, **other_user).returncode:
        pytest.skip("the program is closed to others")
    (stack / "frame_000000.exr").chmod(0)
    refused(pecs_program("info", stack, **other_user), 3, "frame_000000.exr")
    stack.chmod(0)
    refused(pecs_program("info", stack, **other_user), 3, str(stack))
    stack.chmod(0o755)


# --- words of files in our lines ------------------------------------------------------------------------------------


def test_bytes_of_files_in_errors_and_answers(pecs_program, tmp_path):
    path = tmp_path / os.fsdecode(b"\xff\x1b[31m.raw")
    path.write_bytes(raw_text("evt 3.0", "format EVT3;height=4;width=4", "sensor_name A\xff\x1bB", body=b"\0\x80"))
    result = pecs_program("info", path, "--json", errors="surrogateescape", check=True)
    assert json.loads(result.stdout)["camera"] == "A\\xff\\x1bB"
    assert pecs_program("convert", path, tmp_path / "o.csv", errors="surrogateescape").returncode == 0
    path.write_bytes(raw_text("format EVT\x1b9"))
    result = pecs_program("info", path)
    refused(result, 4, r"\xff\x1b[31m.raw", r"EVT\x1b9")
    assert "\x1b" not in result.stderr


def test_names_that_are_not_utf8_in_python(stack, tmp_path):
    folder = tmp_path / os.fsdecode(b"\xff")
    stack.rename(folder)
    assert pecs.StackReader(folder).info["width"] > 0
    report = pecs.sense(folder, folder / os.fsdecode(b"\xfe.raw"), gain=1e-15)
    assert report["results"]["events"] == len(pecs.read(os.fsencode(folder / os.fsdecode(b"\xfe.raw"))))
    with pytest.raises(ValueError, match="NUL"):
        pecs.read(str(folder / "o.raw") + "\0")


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
        ('{"name": 1, "name": 2}', ["name", "duplicate key"]),
        ('{"a": {"b": [{"c": 1}, {"c": 1, "c": 2}]}}', ["a.b[1].c", "duplicate key"]),
        ('{"name": "\udcff"}', ["not UTF-8"]),
        ('{"' + "k" * 400_000 + '": 1, "' + "k" * 400_000 + '": 2}', ["kkk..."]),
        ('{"a\\nb\\u001b\\u0000": 1, "a\\nb\\u001b\\u0000": 2}', ["a\\x0ab\\x1b\\x00"]),
    ],
    ids=["arrays", "objects", "number", "twice", "twice below", "utf-8", "long", "control"],
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
