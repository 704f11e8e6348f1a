"""The table of error messages in docs/howto/troubleshooting.md: each one is printed by a command, with that code."""

import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from support import ROOT
from support.small_stacks import stack_json

PAGE = (ROOT / "docs/howto/troubleshooting.md").read_text()
ROWS = re.findall(r"^\| `([^`]+)` \((\d+|Python)\) \|", PAGE, re.MULTILINE)
PROGRAM = str(ROOT / "build/release/bin/pecs")
SENSE = ("sense", "pics", "--fps", "100", "-o", "a.raw")
RENDER = ("render", "scenes/room", "-o", "s", "--frames", "0:2", "--width", "16")
ARRAYS = "import numpy as np, pecs; pecs.simulate(np.zeros({}), {})"
COMMANDS = [
    ("sense", "pics", "-o", "a.raw"),
    ("sense", "my.stack", "--fps", "100", "-o", "a.raw", "--chip", "davis346"),
    ("sense", "rad.stack", "-o", "a.raw"),
    ("sense", "out.raw", "-o", "a.raw"),
    (*SENSE[:-1], "x.xyz"),
    ("compare", "out.raw", "g.raw"),
    ("info", "bad.raw"),
    ("info", "a.csv"),
    ("info", "s.txt"),
    ("convert", "late.csv", "o.csv"),
    ("convert", "out.raw", "out.raw"),
    (*SENSE, "--set", "nokey=1"),
    (*SENSE, "--set", "contrast_threshold_on=30"),
    (*SENSE, "--bias", "fo=10"),
    (*SENSE, "--preset", "v2e_noisy", "--labels", "l.npy"),
    (*SENSE, "--chip", "evk4"),
    (*SENSE[:-1], "nofolder/a.raw"),
    (*SENSE, "--fnumbr", "2"),
    ("sense", "empty", "--fps", "10", "-o", "a.raw"),
    ("lens", "info", "nolens"),
    ("fit", "--still", "out.raw=1", "-o", "c.json"),
    ("reconstruct", "out.raw", "-o", "v.mp4"),
    ARRAYS.format("(3, 4, 4, 3)", "[0, 1, 2]"),
    ARRAYS.format("(3, 4, 4), int", "[0, 1, 2]"),
    ARRAYS.format("(3, 4, 4)", "[0, 0.001, 0.002]"),
    ("render", "none.blend", "-o", "s"),
    (*RENDER, "--device", "METAL"),
    (*RENDER, "--lens", "cmount_8mm_f2p8", "--fnumber", "1"),
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the commands take; without onnxruntime."""
    folder = tmp_path_factory.mktemp("messages")
    (folder / "scenes").symlink_to(ROOT / "scenes")
    for name, size in (("pics", (8, 8)), ("my.stack", (640, 360)), ("empty", None)):
        (folder / name).mkdir()
        for i in range(3 if size else 0):
            Image.fromarray(np.full(size[::-1], 60 * i + 60, np.uint8)).save(folder / name / f"{i}.png")
    import pecs

    stack = stack_json(8, 8, [0, 1000], quantity="radiance", pixel_pitch_m=None)
    with pecs.StackWriter(folder / "rad.stack", stack) as writer:
        for i in range(2):
            writer.write_frame(i, np.ones((1, 8, 8), np.float32))
    for name, width, height in (("out", 320, 240), ("g", 640, 360)):
        events = np.zeros(200, pecs.events.EVENT_DTYPE)
        events["t"] = 10 * np.arange(200)
        pecs.write(folder / f"{name}.raw", pecs.Events(events, width, height))
    (folder / "bad.raw").write_bytes((folder / "out.raw").read_bytes() + b"\0")
    (folder / "a.csv").write_text("t,x,y,p\n1,2,3,1\n")
    (folder / "s.txt").write_text("".join(f"{t}.0 2 3 1\n" for t in range(9)))  # microseconds
    (folder / "late.csv").write_text("t_us,x,y,p\n5,2,3,1\n20,2,3,1\n10,2,3,1\n")
    (folder / "onnxruntime.py").write_text("raise ImportError('no module')\n")
    return folder


def run(command, folder):
    """Last line and exit code."""
    if isinstance(command, str):
        command = [sys.executable, "-c", command]
    elif command[0] == "render":
        command = [sys.executable, "-m", "pecs_blender", *command]
    else:
        command = [PROGRAM, *command]
    env = {
        "PATH": "/usr/bin:/bin",
        "PYTHONPATH": f"{folder}:{ROOT}/python:{ROOT}/blender_addon",
        "PECS_PYTHON": sys.executable,
    }
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True)
    return done.stderr.strip().splitlines()[-1] if done.stderr else "", done.returncode


def test_each_message_of_the_page_is_printed(folder):
    left = {message: code for message, code in ROWS}
    assert len(left) == len(ROWS) >= 24
    for command in COMMANDS:
        line, code = run(command, folder)
        for message, wanted in list(left.items()):
            pattern = re.escape(message).replace("…", ".*")
            if (
                wanted == "Python"
                and re.search(rf"Error: {pattern}", line)
                or (wanted == str(code) and re.fullmatch(rf"{pattern}.*", line))
            ):
                del left[message]
                break
        else:
            pytest.fail(f"{command}: the page does not list: {line} ({code})")
    assert not left
