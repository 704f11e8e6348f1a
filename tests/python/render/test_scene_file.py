"""scene.json and aligned.json, wrong in a thousand ways: one clear line each, never a traceback."""

import json
import random
import shutil

import pytest
from support import in_bpy
from support.mutants import mutant

pytest.importorskip("pecs")
from pecs_blender.render.errors import BAD_INPUT, NOT_FOUND, RenderError
from pecs_blender.render.scene_file import load_scene
from pecs_blender.render.strict_json import JsonObject, parse_json

MUTANTS = 500
ALIGNED = {
    "pecs_aligned": 1,
    "scene": "board",
    "camera": {"rotation_deg": [90.0, 0.1, -0.2]},
    "parameters": {"speed_m_per_s": 0.9, "board_distance_mm": 1600.0},
    "clock": {"offset_us": 12.0, "rate": 1.0},
    "warnings": [],
}


def outcome(folder, overrides=()):
    """Whether it is taken; else the error, which is one line that names a file."""
    try:
        return load_scene(folder, list(overrides))
    except RenderError as e:
        assert e.code in (BAD_INPUT, NOT_FOUND) and "\n" not in str(e)
        assert ".json" in str(e) and len(str(e)) < 1000
        return None


@pytest.fixture
def board(root, tmp_path):
    return shutil.copytree(root / "scenes/board", tmp_path / "board")


def test_mutants_of_scene_json(board):
    rng, text = random.Random(1), (board / "scene.json").read_text()
    taken = 0
    for _ in range(MUTANTS):
        (board / "scene.json").write_bytes(mutant(text, rng))
        taken += outcome(board) is not None
    assert taken < MUTANTS / 2


def test_mutants_of_aligned_json(board, tmp_path):
    rng, path = random.Random(2), tmp_path / "aligned.json"
    path.write_text(json.dumps(ALIGNED, indent=1))
    assert outcome(board, [f"@{path}"]).camera["rotation_deg"] == [90.0, 0.1, -0.2]
    taken = 0
    for _ in range(MUTANTS):
        path.write_bytes(mutant(json.dumps(ALIGNED, indent=1), rng))
        taken += outcome(board, [f"@{path}"]) is not None
    assert taken < MUTANTS / 2


def test_another_version_of_aligned_json_is_refused(board, tmp_path):
    path = tmp_path / "aligned.json"
    path.write_text(json.dumps(ALIGNED | {"pecs_aligned": 2}))
    with pytest.raises(RenderError, match="pecs_aligned: got 2, wanted"):
        load_scene(board, [f"@{path}"])
    path.write_text(json.dumps({key: value for key, value in ALIGNED.items() if key != "pecs_aligned"}))
    assert outcome(board, [f"@{path}"]).camera["rotation_deg"] == [90.0, 0.1, -0.2]


BUILD = """
import sys, random
from pathlib import Path
import bpy
from support.mutants import mutant
from pecs_blender.render.errors import RenderError
from pecs_blender.render.scene_file import load_scene
from pecs_blender.render.folder import FolderScene
path = Path(sys.argv[1], "scene.json")
rng, text, built = random.Random(3), path.read_text(), 0
for _ in range(100):
    path.write_bytes(mutant(text, rng))
    try:
        FolderScene(load_scene(path.parent, []))
        built += 1
    except RenderError as e:
        assert "\\n" not in str(e)
print("built", built, flush=True)
"""


def test_what_is_taken_builds_or_says_why(board):
    """A parameter that scene.py asks for and scene.json lacks, above all."""
    in_bpy(BUILD, board)


@pytest.mark.parametrize(
    "text, says",
    [
        ('{"a": 1, "a": 2}', "a"),
        ("[" * 100_000, "levels"),
        ('{"a": 1e999}', "1e999"),
        ('{"a": NaN}', "NaN"),
        ('{"a": -Infinity}', "-Infinity"),
        (f'{{"a": {"9" * 5000}}}', "999"),
        ('{"a": "\\ud800"}', "surrogate"),
        ('{"a": 1', "line 1 column 8"),
        ("[1]", "an object"),
        ('{"a": "x"}', 'a: got "x", wanted a number in [0, 5]'),
        ('{"a": true}', "a: got true"),
        ('{"a": 6}', "a: got 6"),
        ('{"a": 1, "b": 2}', "b: got an unknown key"),
        ("{}", "a: got nothing"),
    ],
)
def test_the_strict_reader(text, says):
    with pytest.raises(RenderError) as e:
        o = JsonObject(parse_json(text, "file.json"), "file.json")
        o.number("a", 0, 5)
        o.done()
    assert str(e.value).startswith("file.json: ") and says in str(e.value)


def test_files_that_are_none(board):
    (board / "scene.json").write_bytes(b'{"camera": "\xff"}')
    with pytest.raises(RenderError, match="UTF-8"):
        load_scene(board, [])
    (board / "scene.json").write_bytes(b" " * (5 << 20))
    with pytest.raises(RenderError, match="bytes"):
        load_scene(board, [])
    with pytest.raises(RenderError) as e:
        load_scene(board.parent, [f"@{board}"])
    assert e.value.code == NOT_FOUND
