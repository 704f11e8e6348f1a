"""What every subcommand promises: --help, one-line errors, documented exit codes. Subcommands are found by listing."""

import argparse
import errno
import json
import os
import re
import sys

import numpy as np
import pecs
import pytest
from pecs import _command, _platform, demo
from pecs._arguments import Parser, Quantity
from pecs._progress import Line, Progress
from support import load_script, run_module, small_stacks


def events_of_a_bar():
    events = np.zeros(100, pecs.EVENT_DTYPE)
    events["t"], events["x"], events["p"] = 1000 * np.arange(100), np.arange(100) % 10, 1
    return events


def test_version_and_help(pecs_program, root):
    version = (root / "VERSION").read_text().strip()
    assert pecs_program("--version").stdout.strip() == f"pecs {version}"
    assert pecs_program("--help").returncode == 0


def test_usage_errors_exit_2(pecs_program, helps):
    commands = [name.split()[1:] for name in helps if name.startswith("pecs ")]
    assert ["sense"] in commands and ["lens", "info"] in commands
    for args in ([], ["nonsense"], *([*c, "--no-such-option"] for c in commands)):
        result = pecs_program(*args)
        assert result.returncode == 2, args
        assert re.fullmatch(r"pecs: [^\n]+\n", result.stderr) and not result.stdout, args


@pytest.mark.parametrize("more", [[], ["--help"], ["x.raw", "-o", "y"]], ids=lambda more: " ".join(more) or "alone")
@pytest.mark.parametrize(
    ("command", "line"),
    [
        (["sens"], "pecs: sens: no such command; nearest: sense\n"),
        (["covnert"], "pecs: covnert: no such command; nearest: convert\n"),
        (["lens", "inof"], "pecs: lens: inof: no such command; nearest: info\n"),
    ],
)
def test_an_unknown_command_is_named(pecs_program, command, line, more):
    result = pecs_program(*command, *more)
    assert (result.returncode, result.stderr, result.stdout) == (2, line, "")


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (["sense", "x", "-o", "y", "--durtion", 5], "pecs: sense: --durtion: no such option; nearest: --duration\n"),
        (["lens", "info", "--fucos=2m"], "pecs: lens info: --fucos: no such option; nearest: --focus\n"),
        (["reconstruct", "--cuttof", 5], "pecs: reconstruct: --cuttof: no such option; nearest: --cutoff\n"),
        (["dataset", "x", "--plna"], "pecs: dataset: --plna: no such option; nearest: --plan\n"),
        (["sense", "x", "-o", "y", "--set", "a=1", "b=2"], "pecs: sense: b=2: each KEY=VALUE needs a --set\n"),
        (["run", "x", "-o", "y", "--set", "a=1", "b=2"], "pecs: run: b=2: each KEY=VALUE needs a --set\n"),
        (
            ["run", "x", "--sense", "-o", "y"],
            "pecs: run: the following arguments are required: -o/--output before --sense\n",
        ),
    ],
    ids=lambda value: str(value[0]) if isinstance(value, list) else "",
)
def test_a_mistyped_option_is_named_with_the_nearest(pecs_program, command, line):
    result = pecs_program(*command)
    assert (result.returncode, result.stderr, result.stdout) == (2, line, "")


VALUES = ["20", "+20", "20us", "+1.5ms", "20ms", "0.02 s", "20µs", "1.1ms", "1e3us", "-3ms"]
WRONG = ["20min", "+-20ms", "20mm", "ms", "", "1e", "0x10us", "nanms", "20 m s"]
FRACTIONS = ["1e3", "0.5", "1.5us", "1ns"]


def test_the_program_and_python_read_units_alike(pecs_program, tmp_path):
    """`pecs convert --t-start`, which may be negative, says in its record what it understood."""
    pecs.write(tmp_path / "e.csv", events_of_a_bar())
    for text in VALUES:
        pecs_program("convert", tmp_path / "e.csv", tmp_path / "o.csv", f"--t-start={text}", check=True)
        record = json.loads((tmp_path / "o.csv.run.json").read_text())
        assert record["config"]["t_start_us"] == Quantity("us")(text), text
    assert Quantity("us")("1.1ms") == 1100 and Quantity("A")("2pA") == 2e-12 and Quantity("mm")("5 cm") == 50


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_unit_is_one_line(pecs_program, text):
    result = pecs_program("view", "x.raw", "-o", "x.png", f"--from={text}")
    assert result.returncode == 2 and re.fullmatch(r"pecs: view: --from: [^\n]+\n", result.stderr), result.stderr
    with pytest.raises(argparse.ArgumentTypeError):
        Quantity("us")(text)


@pytest.mark.parametrize(
    "words, error",
    [
        *(("convert x.raw y.raw --t-start " + text, "--t-start: got {}, wanted a whole number") for text in FRACTIONS),
        ("lens info x.json --fnumber 2.8x", "--fnumber: got 2.8x, wanted a number"),
        ("sense x --warmup-loops 2.5", "--warmup-loops: got 2.5, wanted a whole number from 0 to 1000000"),
        ("view x.raw -o y.mp4 --fps 0", "--fps: got 0, wanted a number from 1 to 240"),
        ("view x.raw -o y.png --theme blue", "--theme: got blue, wanted light or dark"),
        ("view x.raw -o y.png --fps 1 --fps 2", "--fps: is set twice; set it once"),
    ],
)
def test_a_wrong_value_is_one_line_of_got_and_wanted(pecs_program, words, error):
    result = pecs_program(*words.split())
    pattern = r"pecs: (lens )?\w+: " + re.escape(error).replace(r"\{\}", "[0-9.e]+") + "\n"
    assert result.returncode == 2 and re.fullmatch(pattern, result.stderr), result.stderr


@pytest.fixture(scope="module")
def helps(root):
    """Command -> its --help, `pecs` and `pecs_blender` alike."""
    found = load_script(root / "scripts/docs/commands.py").all_commands()
    return {name.removeprefix("python -m "): text for name, text in found if not name.startswith("scripts/")}


def test_every_help_ends_with_examples_of_its_own(helps):
    assert len(helps) > 25
    for name, text in helps.items():
        assert text.startswith("usage: pecs"), name
        lines = text.split("\nexamples:\n")[-1].splitlines()
        assert text.count("\nexamples:\n") == 1 and lines, name
        for line in lines:
            command = max((c for c in helps if re.search(rf"(^|[ |(]){c} ", f"{line} ")), key=len, default=None)
            assert command and (
                command == name
                or name
                in ("pecs", "pecs_blender", "pecs chip", "pecs lens", "pecs align", "pecs run", "pecs_blender run")
            ), f"{name}: {line}"
            for option in re.findall(r" (--?[a-z][\w-]*)", line.split("#")[0].split("--sense")[0]):
                assert re.search(rf"{option}(?![\w-])", helps[command]), f"{name}: {line}: no {option}"


def test_what_the_demo_says_comes_next_is_there(helps):
    lines = re.findall(r" (pecs [^\n]+)|(python -m pecs_blender [^\n]+)", demo.NEXT + " " + demo.BLENDER_NEXT)
    assert len(lines) > 5
    for line in map("".join, lines):
        command = max((c for c in helps if f"{line} ".removeprefix("python -m ").startswith(f"{c} ")), key=len)
        for option in re.findall(r" (--?[a-z][\w-]*)", line.removeprefix("python -m")):
            assert re.search(rf"{option}(?![\w-])", helps[command]), f"{line}: no {option}"


def in_python(helps):
    """Commands that are Python modules, by what `pecs --help` says of them."""
    text = re.sub(r"\n {10,}", " ", helps["pecs"])
    found = re.findall(r"^ +(\w+) .*\(Python\)", text, re.MULTILINE)
    assert len(found) == 7, found
    return found


def test_an_option_that_is_set_twice_is_refused(helps, pecs_program):
    """In every command with an output; lists such as --still are none."""
    commands = [name.split()[1:] for name, text in helps.items() if name[:5] == "pecs " and "--output" in text]
    assert len(commands) > 12
    for command in commands:
        result = pecs_program(*command, "-o", "a", "--output=b")
        assert result.returncode == 2 and re.fullmatch(r"pecs: [^\n]+\n", result.stderr), (command, result.stderr)
        if command[0] in in_python(helps):
            assert result.stderr == f"pecs: {command[0]}: --output: is set twice; set it once\n"
    lists = pecs_program("fit", "-o", "a.json", "--still", "a=1", "--still", "b=2", "--quiet", "--quiet")
    assert "twice" not in lists.stderr and "a" in lists.stderr


def test_a_python_without_numpy_is_one_line(helps, pecs_program, root, tmp_path):
    (tmp_path / "numpy.py").write_text("raise ModuleNotFoundError(\"No module named 'numpy'\", name='numpy')\n")
    paths = f"{tmp_path}:{root}/python:{root}/blender_addon"
    environment = (
        os.environ | {"PYTHONPATH": paths} | dict.fromkeys(("PECS_PYTHON", "PECS_BLENDER_PYTHON"), sys.executable)
    )
    install = f"{sys.executable}: the package numpy is missing; run {sys.executable} -m pip install numpy, or set PECS_"
    for command in in_python(helps):
        result = pecs_program(command, "x", "-o", "y.json", env=environment, cwd=tmp_path)
        assert result.returncode == 6 and result.stderr.count("\n") == 1, (command, result.stderr)
        assert install in result.stderr
    for module in ("pecs.datasets", "pecs.fit", "pecs.learning"):  # the package's names load their modules later
        result = run_module(module, "x", "-o", "y.json", check=False, env=environment, cwd=tmp_path)
        assert result.returncode == 6 and result.stderr == f"pecs: {install}PYTHON to a Python that has it\n"


def test_version_in_full(pecs_program, root):
    said = pecs_program("--version", "--verbose").stdout
    assert said.startswith(f"pecs {(root / 'VERSION').read_text().strip()}\nbuild ")
    for name in (
        r"libraries +(\w+ \d[\d.]*, )+\w+ \d[\d.]*$",
        "instructions +(AVX|SSE|NEON|SVE|EMU128)",
        "threads +\\d",
        "program +/",
        "data +/",
    ):
        assert re.search(rf"^{name}", said, re.MULTILINE), name


def test_quiet_and_verbose(pecs_program, tmp_path):
    pecs.write(tmp_path / "e.csv", events_of_a_bar())
    convert = ["convert", tmp_path / "e.csv", tmp_path / "e.npz"]
    assert pecs_program(*convert, "--quiet").stderr == ""
    said = pecs_program(*convert, "--verbose").stderr
    assert "convert: format: npz\n" in said and f"convert: input: {convert[1]}\n" in said
    assert pecs_program(*convert, "--quiet", "--verbose").returncode == 2
    # Warnings are neither errors nor results.
    bars = [tmp_path / "e.csv", tmp_path / "f.csv"]
    pecs.write(bars[1], events_of_a_bar()[9:10])
    assert "pecs: warning: " in pecs_program("compare", *bars[::-1]).stderr
    assert pecs_program("compare", *bars[::-1], "--quiet").stderr == ""


@pytest.mark.parametrize(
    ("command", "used"),
    [
        (["bands", "-n", 3], "bands: chip: imx636"),
        (["info", "e.csv"], "info: FILE: e.csv"),
        (["lens", "info", "pecs_lab_15mm", "--focus", "50cm"], "lens info: focus: 0.5m"),
        (["view", "e.csv", "-o", "e.png"], "view: input: e.csv"),
        (
            ["reconstruct", "e.csv", "-o", "light.mp4", "--size", "64x32", "--method", "filter"],
            "reconstruct: method: filter",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_every_command_can_be_quiet_or_verbose(pecs_program, tmp_path, command, used):
    """Before the command or behind it; the results stay."""
    pecs.write(tmp_path / "e.csv", events_of_a_bar())
    plain = pecs_program(*command, cwd=tmp_path)
    quiet = pecs_program("--quiet", *command, cwd=tmp_path)
    verbose = pecs_program(*command, "--verbose", cwd=tmp_path)
    assert (quiet.stdout, verbose.stdout, quiet.stderr) == (plain.stdout, plain.stdout, "")
    lines = verbose.stderr.splitlines()
    assert used in lines and re.fullmatch(rf"{used.split(':')[0]}: done after [\d.]+ s", lines[-1]), verbose.stderr


def test_a_reader_that_goes_away_is_named(monkeypatch, capsys):
    def run(args):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr(_platform, "exit_when_terminated", lambda: None)
    assert _command.answer(Parser(prog="pecs demo"), run, []) == 5
    assert capsys.readouterr().err == "pecs: standard output: Broken pipe\n"


@pytest.mark.parametrize(("talk", "lines"), [({}, 5), ({"quiet": True}, 0), ({"verbose": True}, 100)], ids=str)
def test_progress_of_commands_in_python(talk, lines, capsys):
    """Not on a terminal: a line of every twentieth, of none, of each."""
    said = Line(20, **talk)
    for step in range(1, 101):
        said(f"step {step}", step)
    said.end()
    assert capsys.readouterr().err.count("\n") == lines
    progress = Progress("render", 100, **talk)
    for step in range(1, 101):
        progress.at(step)
    assert capsys.readouterr().err.count("\n") == {5: 21}.get(lines, lines)


def test_progress_for_a_calling_program(pecs_program, tmp_path, monkeypatch, capsys):
    """PECS_PROGRESS=json, in Python and in the program: JSON lines, at most ten a second and the last one."""
    monkeypatch.setenv("PECS_PROGRESS", "json")
    progress = Progress("render", 1000)
    for step in range(1, 1001):
        progress.at(step)
    small_stacks.write(tmp_path / "stack")
    sense = pecs_program("sense", tmp_path / "stack", "-o", tmp_path / "events.raw", "--chip", "ideal").stderr
    for task, text in (("render", capsys.readouterr().err), ("sense", sense)):
        lines = [json.loads(line) for line in text.splitlines()]
        assert 1 <= len(lines) < 50 and lines[-1]["done"] == lines[-1]["total"] > 0, lines
        assert all(line.keys() == {"progress", "done", "total", "left_s"} for line in lines), lines
        assert {line["progress"] for line in lines} == {task}
    assert not pecs_program("sense", tmp_path / "stack", "-o", tmp_path / "events.raw", "--quiet").stderr


def test_nothing_is_coloured_in_a_pipe(helps, pecs_program):
    for text in [*helps.values(), pecs_program("sens").stderr, pecs_program("--version", "--verbose").stdout]:
        assert "\x1b" not in text


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("scene.blend", b"BLENDER-v405RENDH", "render it first"),
        ("events.csv", b"t_us,x,y,p\n1,2,3,1\n", "got events (csv)"),
        ("notes.mp4", b"not a video, but words\n" * 50, "wanted a video"),
    ],
)
def test_sense_names_what_is_no_light(pecs_program, tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    result = pecs_program("sense", name, "-o", "x.raw", cwd=tmp_path)
    assert result.returncode == 4 and words in result.stderr
    assert re.fullmatch(rf"pecs: {re.escape(name)}: [^\n]+\n", result.stderr)


@pytest.mark.parametrize(
    "args",
    [
        ["sense", "/nonexistent", "-o", "OUT/x.raw"],
        ["info", "/nonexistent"],
        ["convert", "/nonexistent.raw", "OUT/x.csv"],
        ["view", "/nonexistent.raw", "-o", "OUT/x.png"],
        ["compare", "/nonexistent.raw", "/nonexistent.raw"],
        ["lens", "info", "/nonexistent.json"],
        ["report", "--sim", "/nonexistent.raw", "-o", "OUT/x.html"],
    ],
    ids=lambda args: " ".join(args[:2]),
)
def test_a_missing_input_is_one_line_and_exit_3(pecs_program, tmp_path, args):
    result = pecs_program(*(a.replace("OUT", str(tmp_path)) for a in args))
    assert result.returncode == 3, result.stderr
    assert re.fullmatch(r"pecs: [^\n]*/nonexistent[^\n]*\n", result.stderr)
    assert not list(tmp_path.iterdir())
