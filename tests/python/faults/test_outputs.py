"""Outputs of the Python commands keep the rules of docs/reference/exit_codes.md, as those of the program do
(test_faults.py): every command against every kind of path that must not be replaced."""

import ast
import json
import os
import shutil
import stat
import subprocess
import sys
from functools import partial

import numpy as np
import pecs
import pytest
from pecs import PecsError
from pecs._files import MARK, check_outputs, lock_file, whole_folder, write_text
from pecs.datasets import Sequence, writers
from pecs.learning.video import VideoWriter
from support import ROOT, run_module
from support.faults import device, events, fill, refused

learning = partial(run_module, "pecs.learning", check=False)
page = partial(run_module, "pecs.fit.page", check=False)
datasets = partial(run_module, "pecs.datasets", check=False)
COMMANDS = {  # of files: name of the output, command
    "stimulus": ("o.html", lambda recording, output: page("-o", output)),
    "reconstruct": (
        "o.mp4",
        lambda recording, output: learning("reconstruct", recording, "-o", output, "--method", "filter"),
    ),
}


@pytest.fixture
def case(request, recording, tmp_path):
    name, run = COMMANDS[request.param]
    return tmp_path / name, lambda output: run(recording, output)


def partial_of(output):
    """Libraries choose the format of a video by the extension."""
    return output.with_name(f".{output.stem}.partial.mp4" if output.suffix == ".mp4" else f"{output.name}.partial")


every_command = pytest.mark.parametrize("case", COMMANDS, indirect=True)


@every_command
def test_a_device_is_not_replaced(case):
    output, run = case
    result = run(device(output, 1, 3))
    assert stat.S_ISCHR(output.stat().st_mode)
    if output.suffix == ".mp4":
        refused(result, 5, "it is a pipe or a device; this format needs a seekable file")
    else:
        assert result.returncode == 0


@every_command
def test_a_full_disk_is_one_line(case, small_disk):
    output, run = case
    fill(small_disk)
    refused(run(small_disk / output.name), 5, output.name)
    assert not (small_disk / output.name).exists()


@every_command
def test_a_partial_that_is_a_link_is_not_followed(case, tmp_path):
    output, run = case
    (tmp_path / "precious").write_text("mine")
    partial_of(output).symlink_to("precious")
    refused(run(output), 5, "symbolic link")
    assert (tmp_path / "precious").read_text() == "mine" and not output.exists()


@every_command
def test_a_link_to_a_file_stays_a_link(case, tmp_path):
    output, run = case
    (tmp_path / "to").mkdir()
    (tmp_path / "to/file").write_bytes(b"old")
    output.symlink_to("to/file")
    assert run(output).returncode == 0
    assert output.is_symlink() and (tmp_path / "to/file").stat().st_size > 100
    output.unlink()
    output.symlink_to("nowhere")
    refused(run(output), 5, "dangling symbolic link")


@every_command
def test_the_second_of_two_writers_is_refused(case):
    output, run = case
    with lock_file(partial_of(output), output):
        partial_of(output).write_bytes(b"first")
        refused(run(output), 5, "another process is writing it")
    assert partial_of(output).read_bytes() == b"first" and not output.exists()


@every_command
def test_a_folder_is_not_replaced(case):
    output, run = case
    output.mkdir()
    refused(run(output), 5, f"{output}: cannot be written: it is a directory")


def test_a_pipe_is_written_directly(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    reader = subprocess.Popen(["cat", tmp_path / "pipe"], stdout=subprocess.PIPE)
    assert page("-o", tmp_path / "pipe").returncode == 0
    assert reader.communicate()[0].startswith(b"<!doctype") and stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_six_writers_of_one_output(tmp_path):
    """One error is documented; the output is that of a writer."""
    command = [sys.executable, "-m", "pecs.fit.page", "-o", tmp_path / "same.html"]
    running = [
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for _ in range(6)
    ]
    for process in running:
        said = process.communicate()[1]
        assert process.returncode == 0 or (process.returncode == 5 and "another process" in said), said
    assert 0 in {process.returncode for process in running} and os.listdir(tmp_path) == ["same.html"]


def test_an_output_that_is_an_input_is_refused(recording, tmp_path):
    link, table = tmp_path / "link.mp4", tmp_path / "events.csv"
    link.symlink_to(recording)
    pecs.write(table, events(), 64, 48)
    before = recording.read_bytes(), table.read_bytes()
    refused(learning("reconstruct", recording, "-o", link), 2, "the input itself")
    fit = partial(run_module, "pecs.fit", "--steps", f"{table}=1,0.1", check=False)
    a, b = tmp_path / "a.json", tmp_path / "b.html"
    for words, got in (
        (("-o", table), "the input itself"),
        (("-o", a, "--report", table), "the input itself"),
        (("-o", a, "--report", b, "--numbers", b), "two outputs"),
        (("-o", a, "--numbers", tmp_path / "a_pixels.json", "--pixel-map"), "two outputs"),
    ):
        refused(fit(*words), 2, got)
    assert before == (recording.read_bytes(), table.read_bytes()) and not a.exists()
    check_outputs([tmp_path, None], [a, b, None])
    a.touch()
    with pytest.raises(pecs.PecsInputError, match="a file of the input folder"):
        check_outputs([tmp_path], [a])


def test_a_folder_that_is_not_writable_is_refused_first(recording, small_disk):
    """Before a fit of minutes."""
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    for name in ("a.json", "new/a.json"):
        fit = run_module("pecs.fit", "--disk", recording, "-o", small_disk / name, check=False)
        refused(fit, 5, f"{name}: cannot be written: {small_disk} is no folder that is writable")


# Folders


def folders(recording, sequence, tmp_path):
    """Commands that write a folder."""
    set_ = sequence.folder.parents[1]
    yield lambda output: learning("reconstruct", recording, "-o", output, "--method", "filter")
    yield lambda output: datasets(set_, "--export", "coco", "-o", output)


def test_the_partial_folder_of_others_stays(recording, sequence, tmp_path):
    for run in folders(recording, sequence, tmp_path):
        precious = tmp_path / "o.partial/precious"
        precious.parent.mkdir(exist_ok=True)
        precious.write_text("mine")
        refused(run(tmp_path / "o"), 5, "o.partial exists and is not of PECS; remove or rename it")
        assert precious.read_text() == "mine"
        precious.unlink()
        precious.parent.rmdir()
        precious.parent.symlink_to(tmp_path)
        refused(run(tmp_path / "o"), 5, "o.partial exists and is not of PECS")
        precious.parent.unlink()


def test_an_earlier_partial_folder_of_ours_is_emptied(recording, sequence, tmp_path):
    for run in folders(recording, sequence, tmp_path):
        with pytest.raises(ZeroDivisionError), whole_folder(tmp_path / "o") as partial:
            write_text(partial / "inside/old", "old")
            raise ZeroDivisionError
        assert partial.is_dir() and not (tmp_path / "o").exists()
        assert run(tmp_path / "o").returncode == 0
        assert not {"old", "inside", MARK} & set(os.listdir(tmp_path / "o")) and not partial.exists()
        (tmp_path / "o").rename(tmp_path / f"done{os.urandom(4).hex()}")


def test_a_folder_that_another_process_writes(recording, sequence, tmp_path):
    for run in folders(recording, sequence, tmp_path):
        with whole_folder(tmp_path / "o") as partial:
            write_text(partial / "first", "first")
            refused(run(tmp_path / "o"), 5, "another process is writing it")
        assert os.listdir(tmp_path / "o") == ["first"]
        refused(run(tmp_path / "o"), 5, "o: exists")
        (tmp_path / "o/first").unlink()
        (tmp_path / "o").rmdir()


def test_three_exports_to_one_folder_lose_nothing(sequence, tmp_path):
    command = [sys.executable, "-m", "pecs.datasets", sequence.folder.parents[1], "--export", "ecd", "-o"]
    writers.write("ecd", [sequence], tmp_path / "alone")
    running = [subprocess.Popen([*command, tmp_path / "o"], stderr=subprocess.PIPE, text=True) for _ in range(3)]
    codes = []
    for process in running:
        said = process.communicate()[1]
        codes.append(process.returncode)
        assert process.returncode in (0, 5), said
    assert codes.count(0) == 1, codes
    alone, made = ({p.relative_to(f) for p in f.rglob("*")} for f in (tmp_path / "alone", tmp_path / "o"))
    assert made == alone and not (tmp_path / "o.partial").exists()


@pytest.mark.parametrize(("key", "value"), [("name", "../../../ESCAPED"), ("split", "{tmp}/ESCAPED"), ("split", "..")])
def test_an_export_stays_in_its_folder(sequence, key, value, tmp_path):
    """In every layout: names are checked where sequence.json is read."""
    folder = shutil.copytree(sequence.folder, tmp_path / "set/sequences/0000")
    content = json.loads((folder / "sequence.json").read_text()) | {key: value.format(tmp=tmp_path)}
    (folder / "sequence.json").write_text(json.dumps(content))
    refused(datasets(tmp_path / "set", "--export", "dsec", "-o", tmp_path / "x"), 4, f"sequence.json: {key}: got")
    assert os.listdir(tmp_path) == ["set"]


def test_names_that_give_one_file(sequence, tmp_path):
    other = Sequence(sequence.folder)
    other.name = f"{sequence.name}_left"
    with pytest.raises(pecs.PecsInputError, match="got a name twice in 0000, 0000_left, or with those of cameras"):
        writers.write("coco", [sequence, other], tmp_path / "t")


# Video


def test_a_video_without_its_pictures_is_an_error(tmp_path):
    picture = np.zeros((48, 64), "u1")
    with VideoWriter(tmp_path / "good.mp4", 64, 48, 50) as video:
        video.write(picture)
    with pytest.raises(PecsError, match="standard input: picture 1"):
        with VideoWriter(tmp_path / "a.mp4", 64, 48, 50) as video:
            video.write(picture)
            video.write(picture[:2, :2])
    with pytest.raises(ZeroDivisionError):
        with VideoWriter(tmp_path / "b.mp4", 64, 48, 50) as video:
            video.write(picture[: 1 // 0])
    assert [p.name for p in tmp_path.glob("*.mp4") if "partial" not in p.name] == ["good.mp4"]


# The kind


WAYS = {"write_bytes", "write_text", "rename", "unlink", "rmtree", "copyfile", "copytree", "move", "symlink_to"}
INSIDE = ("datasets/writers/",)  # they write in the folder that `whole_folder` gave them
OWN = {  # in a sequence's folder, under its lock
    "datasets/work.py": {"rename", "open"},
    "datasets/run.py": {"unlink", "rmtree"},
    "datasets/pictures.py": {"rmtree"},
    "datasets/cli.py": {"rename", "unlink"},
    "datasets/blender.py": {"open"},
    "ros.py": {"open", "move"},  # in an archive, and in the folder of `whole_folder`
}


def ways(tree):
    """Methods and functions that write, rename or delete files."""
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name, is_method = getattr(call.func, "attr", ""), isinstance(call.func, ast.Attribute)
        constants = [a.value for a in call.args if isinstance(a, ast.Constant)]
        modes = [c for c in constants if isinstance(c, str) and set(c) <= set("rwaxbt+") and set(c) & set("wax+")]
        if name in WAYS or (name == "replace" and len(call.args) == 1 and not call.keywords):
            yield name
        elif modes and (name == "open" or (not is_method and call.func.id == "open")):
            yield "open"


def test_every_output_comes_from_one_room():
    example = "a.open('wb'); open(p, 'w'); a.write_bytes(b''); a.replace(b); 'ab'.replace('a', 'b'); a.open('r')"
    assert list(ways(ast.parse(example))) == ["open", "open", "write_bytes", "replace"]
    for path in sorted((ROOT / "python/pecs").rglob("*.py")):
        name = str(path.relative_to(ROOT / "python/pecs"))
        if name not in ("_files.py", "_platform_unix.py", "_platform_windows.py") and not name.startswith(INSIDE):
            found = set(ways(ast.parse(path.read_text()))) - OWN.get(name, set())
            assert not found, f"{name}: {found}: outputs come from pecs._files"
