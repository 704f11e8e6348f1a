"""What try_windows.sh runs in a Python for Windows that has the wheel: events in memory and in files, the package's
half of the operating system (pecs/_platform_windows.py), and the extension in Blender.
    try_python.py EXTENSION.zip ARGUMENTS_OF_RENDER..."""

import os
import subprocess
import sys
import time
from contextlib import suppress
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
_command.GRACE_S = 0.5
def run(args):
    print("\\u5317", flush=True)
    threading.Timer(1, signal.raise_signal, [signal.SIGBREAK]).start()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
sys.exit(_command.answer(_command.Parser(prog="pecs test"), run, []))"""
PIPE = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE}


def started(*arguments, **options):
    """A Python that has printed its first line, and the line."""
    process = subprocess.Popen([sys.executable, "-c", *map(str, arguments)], **PIPE, **options)
    return process, process.stdout.readline()


def try_events() -> None:
    phase = 0.1 * np.arange(64) - 0.08 * np.arange(20)[:, None]
    frames = np.repeat((0.5 + 0.4 * np.sin(phase))[:, None, :], 48, axis=1)
    events = pecs.simulate(frames, 1000.0 * np.arange(20), chip="imx636", photocurrent_a=1e-12, seed=1)
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
    with suppress(OSError):  # Wine before 9 has no junctions
        _platform.link_folder(Path("link"), Path("there").resolve())
        assert Path("link").resolve() == Path("there").resolve()


def try_extension(archive: str, *render: str) -> None:
    """Blender's module for Windows installs the extension; the panel renders a cube through a lens and simulates its
    events; the command `render` writes `stack`, which try_windows.sh compares."""
    import bpy

    assert bpy.ops.extensions.package_install_files(repo="user_default", filepath=archive) == {"FINISHED"}
    bpy.ops.wm.save_userpref()  # a Blender without them removes the wheel
    from bl_ext.user_default import pecs_blender
    from bl_ext.user_default.pecs_blender.ui import background

    folder = Path(pecs_blender.__file__).parents[1]
    wheels = folder.parent.glob(".local/lib/python*/site-packages")
    os.environ["PYTHONPATH"] = os.pathsep.join(map(str, (folder, *wheels)))  # of Python that is no Blender
    bpy.ops.wm.save_as_mainfile(filepath=str(Path("Würfel 北.blend").resolve()))
    scene, settings = bpy.context.scene, bpy.context.scene.pecs
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    settings.lens, settings.samples, settings.frames, settings.whole_range = "pecs_lab_15mm", 1, 3, False
    assert bpy.ops.pecs.run() == {"FINISHED"}
    while background.poll() is not None:
        time.sleep(0.1)
    assert not background.state.is_error, background.state.message
    assert Path("Würfel 北_events/Würfel 北.raw").is_file()
    subprocess.run([sys.executable, "-m", "pecs_blender", "render", *render, "-o", "stack", "--quiet"], check=True)
    print("    try_extension", flush=True)
    os._exit(0)  # Blender's own exit may hang


if __name__ == "__main__":
    place = Path("try python")
    place.mkdir()
    os.chdir(place)
    for check in (try_events, try_files, try_processes, try_system):
        check()
        print(f"    {check.__name__}", flush=True)
    try_extension(*sys.argv[1:])
