"""What try_windows.sh runs in a Python for Windows that has the wheel: events in memory and in files, the package's
half of the operating system (pecs/_platform_windows.py), and the extension's modules with a stand-in for Blender's."""

import importlib
import os
import pkgutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pecs
from pecs import _platform
from pecs._errors import PecsOutputError
from pecs._files import partial_path, whole

CHILD_HOLDS = """import sys, time
from pathlib import Path
from pecs._files import whole
with whole(Path(sys.argv[1])) as file:
    print("ready", flush=True)
    time.sleep(60)"""
PARENT = """import subprocess, sys, time
from pecs._platform import die_with_parent
command = die_with_parent([sys.executable, "-c", sys.argv[1], sys.argv[2]])
child = subprocess.Popen(command, stdout=subprocess.PIPE)
child.stdout.readline()
print("ready", flush=True)
time.sleep(60)"""
BUSY = """import hashlib, signal, sys, threading
from pecs import _command
threading.Timer(1, signal.raise_signal, [signal.SIGBREAK]).start()
_command.GRACE_S = 0.5
def run(args):
    print("\\u5317", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
sys.exit(_command.answer(_command.Parser(prog="pecs test"), run, []))"""
STAND_INS = """bpy bpy.props bl_operators bl_operators.presets bl_ui bl_ui.utils bpy_extras bpy_extras.view3d_utils
blf gpu gpu_extras gpu_extras.batch gpu_extras.presets mathutils mathutils.bvhtree"""
PIPE = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE}


def started(*arguments, **options):
    """A Python that has printed its first line, and the line."""
    process = subprocess.Popen([sys.executable, "-c", *map(str, arguments)], **PIPE, **options)
    return process, process.stdout.readline()


def try_events() -> None:
    t_us = 1000.0 * np.arange(20)
    phase = 0.1 * np.arange(64) - 0.08 * np.arange(20)[:, None]
    frames = np.repeat((0.5 + 0.4 * np.sin(phase))[:, None, :], 48, axis=1)
    events = pecs.simulate(frames, t_us, chip="imx636", photocurrent_a=1e-12, seed=1)
    assert len(events) > 1000
    for format in (f for f in pecs.event_formats() if f["writes"]):
        extension = format["extensions"][0]
        name = format["name"] + ("" if extension in (".h5", ".hdf5") else " äöü 北") + extension  # limitations.md
        pecs.write(name, events, format=format["name"])
        back = pecs.read(name, format=format["name"])
        assert all(np.array_equal(back[k], events[k]) for k in "xyp"), name


def try_files() -> None:
    path = Path("held.bin")
    path.write_bytes(b"old")
    with whole(path) as file:
        file.write(b"new")
        assert path.read_bytes() == b"old"
        assert subprocess.run([sys.executable, "-c", CHILD_HOLDS, path], capture_output=True).returncode == 1
    assert path.read_bytes() == b"new" and not partial_path(path).exists()
    path.unlink()
    path.mkdir()
    try:
        with whole(path):
            raise AssertionError("a folder was opened")
    except PecsOutputError as e:
        assert "directory" in str(e), e


def try_processes() -> None:
    path = Path("child.bin")
    parent, _ = started(PARENT, CHILD_HOLDS, path)
    try:
        with whole(path):
            raise AssertionError("two processes hold one file")
    except PecsOutputError as e:
        assert "another process" in str(e), e
    parent.kill()
    for _ in range(100):  # the child ends with its parent
        time.sleep(0.1)
        try:
            with whole(path) as file:
                file.write(b"ours")
            break
        except PecsOutputError:
            pass
    assert path.read_bytes() == b"ours"
    assert parent.wait() in _platform.KILLED
    process, line = started(BUSY)
    assert line.decode().strip() == "北", line
    assert process.wait(60) == 143, process.returncode
    become = "from pecs._platform import become; import sys; become([sys.executable, '-c', 'raise SystemExit(7)'])"
    assert subprocess.run([sys.executable, "-c", become]).returncode == 7
    assert _platform.end_of(0xC0000005) and _platform.has_crashed(0xC0000005) and not _platform.has_crashed(1)


def try_system() -> None:
    assert 10 < _platform.resident_mb() <= _platform.resident_mb(peak=True) < 10_000
    pecs.version()
    assert _platform.loaded_library(_platform.library_file("pecs")).pecs_version
    Path("there").mkdir()
    try:
        _platform.link_folder(Path("link"), Path("there").resolve())
    except OSError as e:  # Wine before 9
        print(f"    no junction here: {e}")
    else:
        assert Path("link").resolve() == Path("there").resolve()


def try_extension(folder: str) -> None:
    """Imports every module; `bpy` and its relatives have whatever is asked of them."""
    sys.path.insert(0, folder)

    class Any(type):
        def __getattr__(cls, name):
            if name.startswith("__"):
                raise AttributeError(name)
            return Any(name, (), {"__init__": lambda *_, **__: None})

    for name in STAND_INS.split():
        sys.modules[name] = Any(name, (), {"__path__": []})
    sys.modules["bpy"].app = Any("app", (), {"version": (4, 5, 0)})
    package = importlib.import_module("pecs_blender")
    modules = [m.name for m in pkgutil.walk_packages(package.__path__, "pecs_blender.") if "__main__" not in m.name]
    for name in modules:
        importlib.import_module(name)
    assert len(modules) > 60
    print(f"    {len(modules)} modules of the extension")


if __name__ == "__main__":
    place = Path("try python")
    place.mkdir()
    os.chdir(place)
    for check in (try_events, try_files, try_processes, try_system):
        check()
        print(f"    {check.__name__}", flush=True)
    try_extension(sys.argv[1])
