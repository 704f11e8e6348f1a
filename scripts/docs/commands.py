#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Writes the page of all commands from what they say to --help.

.venv/bin/python scripts/docs/commands.py -o out/docs/commands.md
"""

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "build/release/bin/pecs"
TOOLS = sorted(p for p in (ROOT / "scripts/tools").glob("*.py"))
HEAD = """# Commands

This page lists the `--help` of all commands. `scripts/docs/commands.py` writes it. Every command ends with an
[exit code](exit_codes.md) and, on an error, with one line on standard error. Values may carry their unit, such as
`20ms`, `0.5m`, `10kHz` or `2pA`; a plain number is in the unit in brackets.

With `--quiet`, a command prints only errors (on standard error) and results (on standard output): no progress, no
warnings. With `--verbose` it also prints what it used, how long it took, and each step of progress.

"""


def help_of(command: list[str]) -> str:
    env = os.environ | {"COLUMNS": "80", "PYTHONPATH": f"{ROOT / 'python'}:{ROOT / 'blender_addon'}"}
    done = subprocess.run([*command, "--help"], capture_output=True, text=True, env=env, cwd=ROOT)
    if done.returncode:
        sys.exit(f"commands.py: {' '.join(command)} --help: got code {done.returncode}, wanted 0\n{done.stderr}")
    return done.stdout.strip()


def subcommands(text: str) -> list[str]:
    section = re.search(r"^commands:\n((?:  .*\n?)+)", text, re.MULTILINE)
    return re.findall(r"^ {2,4}([a-z][\w-]*)(?= |$)", section[1], re.MULTILINE) if section else []


def commands(name: str, command: list[str]):
    """(name, help) of a command and of all below it."""
    text = help_of(command)
    yield name, text
    for sub in subcommands(text):
        yield from commands(f"{name} {sub}", [*command, sub])


def all_commands():
    yield from commands("pecs", [str(PROGRAM)])
    yield from commands("python -m pecs_blender", [sys.executable, "-m", "pecs_blender"])
    for tool in TOOLS:
        yield from commands(f"scripts/tools/{tool.name}", [sys.executable, str(tool)])


def page(helps) -> str:
    text = "\n".join(f"## {name}\n\n```text\n{text}\n```\n" for name, text in helps)
    return (HEAD + text).replace(str(ROOT) + "/", "")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.parse_args().output.write_text(page(all_commands()))


if __name__ == "__main__":
    main()
