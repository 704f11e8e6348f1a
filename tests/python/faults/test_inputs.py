"""Inputs of the Python commands: every file is read by `pecs._files` and `pecs._config`, and damage is one line."""

import ast
import copy
import pickle
import shutil
from functools import partial

import numpy as np
import pecs
import pytest
from pecs._arguments import Whole
from pecs._command import answer
from pecs.datasets import manifest, recipe
from pecs.datasets.files import read_array, read_numbers, read_rows
from pecs.learning.windows import MOST_WINDOWS
from support import ROOT, run_module
from support.faults import events, refused

learning = partial(run_module, "pecs.learning", check=False)
READERS = ("_files.py", "_config.py")
OWN = {  # a file of the package; answers of libpecs; lines of PECS's own programs
    "_arguments.py": {"read_text", "loads"},
    "_library.py": {"loads"},
    "_progress.py": {"loads"},
}
ROUND_TRIP = ("fit/estimate.py", "datasets/work.py", "learning/train.py")  # json.loads(json.dumps(...))


def readers(tree):
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = getattr(call.func, "attr", "")
        if name == "read_text" and isinstance(call.func, ast.Attribute):
            yield name
        elif name in ("loads", "load") and getattr(call.func.value, "id", "") in ("json", "pickle", "torch", "tomllib"):
            yield name


def test_every_file_is_read_by_one_module_of_its_kind():
    example = "json.loads(a.read_text()); torch.load(p); np.load(p)"
    assert sorted(readers(ast.parse(example))) == ["load", "loads", "read_text"]
    for path in sorted((ROOT / "python/pecs").rglob("*.py")):
        name = str(path.relative_to(ROOT / "python/pecs"))
        found = [*readers(ast.parse(path.read_text()))]
        if name in READERS or set(found) <= OWN.get(name, set()):
            continue
        allowed = ["load"] if name == "learning/tensors.py" else ["loads"] if name in ROUND_TRIP else []
        assert found == allowed, f"{name}: {found}: files are read by pecs._files, pecs._config and pecs.datasets.files"


def one_line(call, *words):
    with pytest.raises(pecs.PecsError) as error:
        call()
    assert "\n" not in str(error.value) and error.value.code in (2, 3, 4), str(error.value)
    for word in words:
        assert word in str(error.value), str(error.value)


def test_damaged_files_of_a_data_set(tmp_path):
    file = tmp_path / "f"
    for content in (b"", b"x", b"PK\3\4" + bytes(40), b"\x93NUMPY\1\0\x10\0{'descr': 1}   \n"):
        file.write_bytes(content)
        one_line(lambda: read_array(file, "an array", "<f4", (2,)), "f: not an NPY file")
    for content in (b"\xff", b"1 x", b"1 nan", b"1 inf"):
        file.write_bytes(content)
        one_line(lambda: read_numbers(file, "times"))
    for content in (b"\xff", b"a\n1,2\n", b"a\nx\n", b"a\n" + b"9" * 30, b"a\n" + b"9" * 5000):
        file.write_bytes(content)
        one_line(lambda: read_rows(file, ("a",), "rows"))
    for folder in (tmp_path, tmp_path / "none"):
        one_line(partial(read_numbers, folder, "times"), str(folder))
    file.write_text("a = " + "[" * 20_000)
    one_line(lambda: recipe.load(file), "f: ", "fewer levels")
    file.write_text(f"a = {'9' * 5000}")
    one_line(lambda: recipe.load(file), "wanted valid TOML")


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sealed") / "set/sequences/0000"
    (folder / "left").mkdir(parents=True)
    for name in ("checks.json", "poses.txt", "left/events.h5"):
        (folder / name).write_text("{}")
    manifest.seal(folder)
    return folder


DAMAGED = ("[]", "null", "5", '"x"', '{"poses.txt": 5}', "[1]", "[" * 100_000, "", "\xff", '{"poses.txt": [2]}')
DAMAGED += ('{"/etc/passwd": [1, "x"]}', '{"../x": [1, "x"]}', '{"a\\nb": [1, "x"]}', '{"poses.txt": ["2", "x"]}')


@pytest.mark.parametrize("content", DAMAGED)
def test_a_damaged_list_of_files(sealed, content, tmp_path):
    folder = shutil.copytree(sealed, tmp_path / "0000")
    assert manifest.faults(folder) == []
    (folder / "files.json").write_text(content, "latin-1")
    (line,) = manifest.faults(folder)
    assert "files.json" in line and "\n" not in line
    one_line(lambda: manifest.sealed(folder, "checks.json"), "files.json")


def test_what_a_list_does_not_have_is_a_fault(sealed, tmp_path):
    folder = shutil.copytree(sealed, tmp_path / "0000")
    digest = manifest.sha256(folder / "files.json")
    assert manifest.faults(folder, digest) == [] and manifest.sealed(folder, "checks.json") == {}
    (folder / "left/more.npy").touch()
    assert manifest.faults(folder) == [f"{folder}/left/more.npy: not listed in files.json"]
    (folder / "left/more.npy").unlink()
    (folder / "files.json").write_text("{}")
    assert len(manifest.faults(folder)) == 3
    assert "wanted SHA-256" in manifest.faults(folder, digest)[0]
    (folder / "checks.json").write_text("[1]")
    one_line(lambda: manifest.sealed(folder, "checks.json"), "checks.json: got other content")


# Values without a limit


@pytest.mark.parametrize("words", [("--threads", "100000"), ("--threads", "-1"), ("--size", "99999x99999")])
def test_options_have_limits(recording, words, tmp_path):
    refused(
        learning("reconstruct", recording, "-o", tmp_path / "v.mp4", "--method", "filter", *words), 2, words[0], "got"
    )


def test_whole_numbers():
    assert Whole(0, 9)("7") == 7 and Whole(-1)("-1") == -1
    for text in ("", "1.0", "1e3", "²", "10", "-1", "9" * 5000):
        with pytest.raises(Exception, match="wanted a whole number from 0 to 9"):
            Whole(0, 9)(text)


def test_one_wrong_time_makes_no_endless_video(tmp_path):
    far = events(2, size=(4, 4))
    for last, fps in ((2**62, 1000), (MOST_WINDOWS * 1000 + 2000, 1000)):
        far["t"][1] = last
        pecs.write(tmp_path / "far.csv", far)
        result = learning(
            "reconstruct",
            tmp_path / "far.csv",
            "-o",
            tmp_path / "v.mp4",
            "--fps",
            fps,
            "--size",
            "4x4",
            "--method",
            "filter",
        )
        refused(result, 4, f"wanted at most {MOST_WINDOWS}")
    assert [p.name for p in tmp_path.iterdir()] == ["far.csv"]


def test_no_memory_is_one_line(capsys):
    from pecs._arguments import Parser

    code = answer(Parser(prog="pecs test"), lambda args: np.zeros(1 << 60, "u1"), [])
    said = capsys.readouterr().err
    assert code == 7 and len(said.splitlines()) == 1 and said.startswith("pecs: not enough memory: Unable to allocate")


# Python's objects


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_handle_is_not_copied(copied, recording):
    kinds = [pecs.Sensor(8, 8), pecs.Chip("imx636"), pecs.EventReader(recording)]
    for handle in kinds:
        with pytest.raises(TypeError, match=f"cannot copy or pickle {type(handle).__name__}"):
            copied(handle)
    assert len(kinds[0].push(np.zeros((8, 8)), 0.0)) == 0 and kinds[1].width > 0


@pytest.mark.parametrize("kind", ["u1", "u2", "f4", "f8", "f2"])
def test_the_order_of_frames_in_memory_does_not_matter(kind):
    top = 1 if kind[0] == "f" else np.iinfo(kind).max
    frames = (top * np.random.default_rng(1).random((12, 20, 30))).astype(kind)
    wanted = pecs.simulate(frames, 1000.0 * np.arange(12))
    assert len(wanted) > 100
    video = np.ascontiguousarray(frames.transpose(1, 2, 0))
    for other in (np.asfortranarray(frames), video.transpose(2, 0, 1), frames[::-1][::-1]):
        np.testing.assert_array_equal(pecs.simulate(other, 1000.0 * np.arange(12)), wanted)


def test_options_that_are_no_numbers():
    frames, times = np.zeros((2, 8, 8)), [0.0, 1000.0]
    for words, options in (
        ("photocurrent_a: got nan, wanted a finite number", {"photocurrent_a": float("nan")}),
        ("overrides.leak_rate_hz: got inf", {"overrides": {"leak_rate_hz": float("inf")}}),
        ("overrides: got 5, wanted numbers by name", {"overrides": 5}),
        ("biases: got", {"biases": {"diff_on": "x"}}),
        ("afk_hz: got nan", {"afk_hz": (float("nan"), 1.0)}),
    ):
        one_line(lambda options=options: pecs.simulate(frames, times, **options), words)
    with pytest.raises(ValueError):
        pecs.simulate(np.zeros((2, 8, 0)), times)
