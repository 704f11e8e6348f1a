"""scene.json and aligned.json, wrong in a thousand ways: one clear line each, never a traceback."""

import json
import random
import shutil

import pytest
from pecs import PecsError
from pecs._errors import ExitCode
from pecs_blender.scene.scene_file import load_scene
from support import in_bpy
from support.mutants import mutant

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
    except PecsError as e:
        assert e.code in (ExitCode.BAD_INPUT, ExitCode.NOT_FOUND) and "\n" not in str(e)
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
    with pytest.raises(PecsError, match="pecs_aligned: got 2, wanted"):
        load_scene(board, [f"@{path}"])
    path.write_text(json.dumps({key: value for key, value in ALIGNED.items() if key != "pecs_aligned"}))
    assert outcome(board, [f"@{path}"]).camera["rotation_deg"] == [90.0, 0.1, -0.2]


BUILD = """
import sys, random
from pathlib import Path
import bpy
from support.mutants import mutant
from pecs import PecsError
from pecs_blender.scene.scene_file import load_scene
from pecs_blender.scene.folder import FolderScene
path = Path(sys.argv[1], "scene.json")
rng, text, built = random.Random(3), path.read_text(), 0
for _ in range(100):
    path.write_bytes(mutant(text, rng))
    try:
        FolderScene(load_scene(path.parent, []))
        built += 1
    except PecsError as e:
        assert "\\n" not in str(e)
print("built", built, flush=True)
"""


def test_what_is_taken_builds_or_says_why(board):
    """A parameter that scene.py asks for and scene.json lacks, above all."""
    in_bpy(BUILD, board)


def test_files_that_are_none(board):
    (board / "scene.json").write_bytes(b'{"camera": "\xff"}')
    with pytest.raises(PecsError, match="UTF-8"):
        load_scene(board, [])
    (board / "scene.json").write_bytes(b" " * (5 << 20))
    with pytest.raises(PecsError, match="bytes"):
        load_scene(board, [])
    with pytest.raises(PecsError) as e:
        load_scene(board.parent, [f"@{board}"])
    assert e.value.code == ExitCode.NOT_FOUND
