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
        assert pecs_program(*args).returncode == 2, args


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
