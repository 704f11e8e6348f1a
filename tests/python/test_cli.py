"""What every subcommand promises: --help, one-line errors, documented exit codes. Subcommands are found by listing."""

import re

import pytest


def subcommands(program, *path):
    """All command paths of the program, found from its help: ["sense"], ["lens", "info"], …"""
    text = program(*path, "--help").stdout
    names = []
    if "Subcommands:" in text:
        for line in text.split("Subcommands:")[1].splitlines():
            if match := re.match(r"  (\S+)", line):
                names.append(match[1])
    return [[*path, n] for n in names] + [c for n in names for c in subcommands(program, *path, n)]


def test_version_and_help(pecs_program, root):
    version = (root / "VERSION").read_text().strip()
    assert pecs_program("--version").stdout.strip() == f"pecs {version}"
    assert pecs_program("--help").returncode == 0


def test_every_subcommand_answers_help(pecs_program):
    commands = subcommands(pecs_program)
    assert ["sense"] in commands
    for command in commands:
        result = pecs_program(*command, "--help")
        assert result.returncode == 0, command
        assert result.stdout.strip() and not result.stderr, command


def test_usage_errors_exit_2(pecs_program):
    for args in ([], ["nonsense"], *([*c, "--no-such-option"] for c in subcommands(pecs_program))):
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


def test_a_time_without_unit_is_named(pecs_program):
    result = pecs_program("view", "x.raw", "-o", "x.png", "--from", "20")
    assert result.returncode == 2 and result.stderr.startswith(
        "pecs: view: --from: got '20', wanted a time with its unit"
    )


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
