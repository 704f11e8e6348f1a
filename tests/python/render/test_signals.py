"""SIGINT and SIGTERM: a render ends with its documented exit code, leaves a stack that continues and nothing else."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pecs._arguments import latest
from support import ROOT
from support.faults import device

SMALL = ("--bands", 3, "--fps", 1000, "--width", 32, "--lens", "none")
SHM = Path("/dev/shm")


def command(root, output, *args):
    words = ("-m", "pecs_blender", "render", root / "scenes/rotating_disk", "-o", output, *SMALL, *args)
    return [sys.executable, *latest(words)]


def leftovers():
    return {p.name for p in SHM.glob("pecs_????????")} if SHM.is_dir() else set()


def stopped(root, folder, number, until, *args, again=False):
    """A render that gets a signal as soon as `until` exists."""
    scratch = folder.parent / "scratch"
    scratch.mkdir(exist_ok=True)
    process = subprocess.Popen(
        command(root, folder, *args),
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"TMPDIR": str(scratch)},
    )
    while not (folder / until).exists():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.01)
    process.send_signal(number)
    if again:
        process.send_signal(number)
    _, text = process.communicate(timeout=120)  # a regression would hang here
    assert process.returncode == 128 + number, text
    assert "Traceback" not in text and text.count("stopped; finished frames are kept") == 1, text
    assert not list(scratch.iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_render_continues(root, tmp_path, number):
    before = leftovers()
    for i, until in enumerate(("stack.json", "frame_000001.exr")):
        stopped(root, tmp_path / str(i), number, until, "--frames", 2000, "--samples", 2)
        assert not list((tmp_path / str(i)).glob("*.part*"))
    assert leftovers() == before
    frames = len(list((tmp_path / "1").glob("frame_*")))
    assert 2 <= frames < 2000
    stopped(root, tmp_path / "1", number, f"frame_{frames:06d}.exr", "--frames", 2000, "--samples", 2)


def test_a_pass_that_takes_long_is_left(root, tmp_path):
    """Half an hour here: the signal's grace is two seconds, and a second signal has none."""
    for again in (False, True):
        args = ("--frames", 1, "--samples", 65536, "--width", 640, "--threads", 1)
        stopped(root, tmp_path / f"s{again}", signal.SIGTERM, "stack.json", *args, again=again)


def test_a_render_leaves_nothing_behind(root, tmp_path):
    before = leftovers()
    for lens in ("none", "pecs_lab_15mm"):
        args = ("--frames", 1, "--samples", 1, "--lens", lens)
        environment = os.environ | {"TMPDIR": str(tmp_path / "scratch")}
        (tmp_path / "scratch").mkdir(exist_ok=True)
        subprocess.run(command(root, tmp_path / lens, *args), check=True, env=environment, capture_output=True)
        assert not list((tmp_path / "scratch").iterdir())
    assert leftovers() == before


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)], ids=str)
def test_closed_descriptors(root, tmp_path, closed):
    """Blender would open its own files under their numbers."""

    def close():
        for fd in closed:
            os.close(fd)

    words = command(root, tmp_path / "s", "--frames", 1, "--samples", 1)
    done = subprocess.run(words, preexec_fn=close, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in (tmp_path / "s").iterdir()) == ["frame_000000.exr", "stack.json"]


@pytest.mark.parametrize(
    "args", [("--help",), ("light", str(ROOT / "scenes/rotating_disk")), ("render", "--help")], ids=lambda args: args[0]
)
def test_a_standard_output_that_fails(tmp_path, args):
    with open(device(tmp_path / "full", 1, 7), "wb") as full:
        words = [sys.executable, "-m", "pecs_blender", *args]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 5
    assert done.stderr == "pecs_blender: standard output: cannot be written: No space left on device\n"


def test_two_renders_into_one_folder(root, tmp_path):
    """The second is refused in one line, unless it renders other frames; the first goes on."""
    output = tmp_path / "s"
    long = ("--frames", 3000, "--samples", 2)
    first = subprocess.Popen(command(root, output, *long, "--only", "0:2900"), stderr=subprocess.DEVNULL)
    while not (output / "frame_000000.exr").exists():
        assert first.poll() is None
        time.sleep(0.01)
    second = subprocess.run(command(root, output, *long, "--only", "2899:3000"), capture_output=True, text=True)
    assert second.returncode == 5 and second.stderr.count("\n") == 1, second.stderr
    assert "renders these frames" in second.stderr
    overwriting = subprocess.run(command(root, output, *long, "--overwrite"), capture_output=True, text=True)
    assert overwriting.returncode == 5 and "renders these frames" in overwriting.stderr
    other = subprocess.run(command(root, output, *long, "--only", "2998:3000"), capture_output=True, text=True)
    assert other.returncode == 0, other.stderr
    assert first.poll() is None
    first.terminate()
    assert first.wait() == 143


@pytest.mark.parametrize(
    "option, value",
    [
        ("--light-scale", "nan"),
        ("--light-scale", "-1"),
        ("--light-scale", "inf"),
        ("--noise-events", "0"),
        ("--noise-events", "101%"),
        ("--fps", "inf"),
        ("--fps", "0"),
        ("--focus", "-2m"),
        ("--focus", "nan"),
        ("--fnumber", "0"),
        ("--width", "3.5"),
        ("--samples", "0"),
        ("--seed", "-1"),
        ("--width", "20000"),
        ("--film-shift", "nan"),
        ("--bands", "many"),
        ("--frames", "1000000000"),
    ],
)
def test_a_wrong_number_names_its_option(root, tmp_path, option, value):
    values = (value, "0") if option == "--film-shift" else (value,)
    result = subprocess.run(command(root, tmp_path / "s", option, *values), capture_output=True, text=True)
    assert result.returncode == 2, result.stderr
    assert option in result.stderr and len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "s").exists()
