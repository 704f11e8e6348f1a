"""The lock of a sequence and the request that it is made from, without rendering."""

import json
import shutil
import sys
from pathlib import Path

import pecs
import pytest
from pecs.datasets import recipe, run, work
from pecs.datasets.blender import blender
from pecs.datasets.plan import Plan
from support import ROOT

RECIPE = """
seed = 3
sequences = 1
duration_s = 0.1
[[scene]]
path = "scene"
[scene.set]
lamp_spectrum = "lamp.csv"
[[scene.place]]
files = "thing.blend"
textures = "wood.png"
low_m = [0, 0, 0]
high_m = [1, 1, 1]
size_m = 0.1
[scene.trajectory]
kind = "recorded"
file = "path.txt"
[[rig.camera]]
name = "left"
kind = "events"
chip = "chip.json"
lens = "cmount_8mm_f2p8"
fnumber = [4, 8]
[rig.camera.set]
contrast_threshold_on = 0.2
"""
FILES = ("lamp.csv", "thing.blend", "wood.png", "path.txt")
STEPS = ("_move", "_render", "_describe", "_sense", "_drop")


@pytest.fixture
def set_(tmp_path, monkeypatch):
    """A recipe with a file of every kind, and steps that make nothing."""
    shutil.copytree(ROOT / "scenes/rotating_disk", tmp_path / "scene")
    shutil.copy(ROOT / "sensor/chips/davis346.json", tmp_path / "chip.json")
    for name in FILES:
        (tmp_path / name).write_text(name)
    (tmp_path / "r.toml").write_text(RECIPE)
    for step in STEPS:
        monkeypatch.setattr(run, step, lambda *_: None)
    monkeypatch.setattr(run.recipe_check, "see_corners", lambda *_: None)
    monkeypatch.setattr(run, "Sequence", lambda _: None)
    monkeypatch.setattr(run.report, "write", lambda _: None)
    return tmp_path


def make(folder):
    run.make(Plan(recipe.load(folder / "r.toml")).sequence(0), folder / "set", 1, lambda _: None)
    return folder / "set/sequences/0000"


def stop(*_):
    raise KeyboardInterrupt


def test_the_lock_is_held_until_the_folder_has_its_name(set_, monkeypatch):
    """A second process must not find neither the sequence nor its lock."""
    renamed, rename = [], Path.rename

    def rename_and_look(path, target):
        if path.name == "0000.partial":
            with pytest.raises(work.Busy, match="another process"), work.locked(path):
                pass
            renamed.append(path)
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", rename_and_look)
    assert make(set_).is_dir() and len(renamed) == 1


def test_a_lock_file_stays(set_):
    lock = make(set_).parent / ".0000.partial.lock"
    before = lock.stat().st_ino
    with work.locked(lock.parent / "0000.partial"):
        assert lock.stat().st_ino == before
    assert lock.exists()


def test_a_sequence_that_another_process_makes_is_busy(set_):
    (set_ / "set/sequences").mkdir(parents=True)
    with work.locked(set_ / "set/sequences/0000.partial"), pytest.raises(work.Busy):
        make(set_)
    assert not (set_ / "set/sequences/0000.partial").exists()


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("name", [*FILES, "chip.json", "scene/scene.json"])
def test_another_content_does_not_continue(set_, monkeypatch, name, finished):
    with monkeypatch.context() as patch:
        if not finished:
            patch.setattr(run, "_move", stop)
            with pytest.raises(KeyboardInterrupt):
                make(set_)
        else:
            make(set_)
    make(set_)  # the same again
    if not finished:
        (set_ / "set/sequences/0000").rename(set_ / "set/sequences/0000.partial")
    path = set_ / name
    path.write_text(path.read_text() + " ")
    named = name if "/" not in name else "scene"
    with pytest.raises(pecs.PecsOutputError, match=rf"files \({named}.*\) changed since"):
        make(set_)


def test_another_version_does_not_continue(set_, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(run, "_move", stop)
        with pytest.raises(KeyboardInterrupt):
            make(set_)
        patch.setattr(work, "version", lambda: "9.9")
        with pytest.raises(pecs.PecsOutputError, match=r"versions \(pecs\) changed since it was begun"):
            make(set_)
    made = make(set_)
    monkeypatch.setattr(work, "version", lambda: "9.9")
    make(set_)  # a finished one stays
    assert json.loads((made / "drawn.json").read_text())["versions"]["pecs"] == pecs.version()


@pytest.mark.parametrize("crashes", [1, 2])
def test_a_renderer_that_crashes_is_started_once_more(tmp_path, monkeypatch, crashes):
    """Blender crashed in one of thousands of renders."""
    python, count = tmp_path / "python", tmp_path / "count"
    python.write_text(
        f'#!/bin/sh\necho start >> "{count}"\n'
        f'[ "$(wc -l < "{count}")" -gt {crashes} ] || kill -SEGV $$\nexec "{sys.executable}" "$@"\n'
    )
    python.chmod(0o755)
    monkeypatch.setenv("PECS_BLENDER_PYTHON", str(python))
    if crashes == 1:
        blender("--help", folder=tmp_path, log="a.log")
        assert "usage: pecs_blender" in (tmp_path / "a.log").read_text()
    else:
        with pytest.raises(pecs.PecsError, match=r"was ended by signal 11 \(Segmentation fault\) \(.*a\.log\)"):
            blender("--help", folder=tmp_path, log="a.log")
    assert count.read_text() == "start\nstart\n"


def test_progress_is_read_from_json_lines(tmp_path, monkeypatch):
    """The log has the other lines, and an error the last of standard error."""
    python = tmp_path / "python"
    lines = ('{"progress": "render", "done": 3, "total": 17, "left_s": 199.7}', '{"progress": "motion", "done": 1}')
    lines += ("{no JSON", "render: 9/17, 1 s left", "pecs_blender: disk: full")
    said = "".join(f"echo '{line}' >&2\n" for line in lines)
    python.write_text(f'#!/bin/sh\n[ "$PECS_PROGRESS" = json ] || exit 9\necho noise\n{said}exit 5\n')
    python.chmod(0o755)
    monkeypatch.setenv("PECS_BLENDER_PYTHON", str(python))
    told = []
    with pytest.raises(pecs.PecsError, match=r"^pecs_blender: disk: full \(.*a\.log\)$") as error:
        blender("--help", folder=tmp_path, log="a.log", tell=told.append)
    assert error.value.code == 5 and told == ["3/17, 200 s left"]
    assert sorted((tmp_path / "a.log").read_text().splitlines()) == sorted(["noise", *lines[2:]])


def test_two_files_of_one_name_in_two_folders(tmp_path):
    """Each counts, and so does which is which."""
    paths = [tmp_path / folder / "lamp.csv" for folder in "ab"]
    for path in paths:
        path.parent.mkdir()
        path.write_text(path.parent.name)
    files = {str(path): path for path in paths}
    before = work._sums(files)
    assert list(before) == ["lamp.csv"] and len(before["lamp.csv"]) == 2
    for path, text in zip(paths, "ba", strict=True):
        path.write_text(text)
        assert work._sums(files) != before
    assert work._sums({"lamp.csv": paths[0]}) == {"lamp.csv": work.content_sha256(paths[0])}
