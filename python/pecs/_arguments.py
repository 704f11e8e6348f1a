"""Parsers of all Python commands: values with a unit, one form of --help, the nearest option; by the same rules as the
program (apps/pecs/units.cpp, help.cpp, usage.cpp)."""

from __future__ import annotations

import argparse
import difflib
import json
import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

from ._errors import ExitCode, PecsError

# Kind of quantity -> an example, and its units with their power of ten in SI units. The program reads it too.
_KINDS: dict[str, Any] = json.loads(Path(__file__).with_name("units.json").read_text("utf-8"))
_KIND = {unit: kind for kind, entry in _KINDS.items() for unit in entry["exponents"]}
_FLAGS = {"min_nm": "--min-wavelength", "max_nm": "--max-wavelength", "moving_px": "--moving-px"}
_VALUE = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) *(\D*)", re.ASCII)
WIDTH, COLUMN = 78, 28  # of --help, and where its second column begins
UNITS = "Values may carry a unit (20ms, 0.5m); a plain number is in the unit in brackets."


@dataclass(frozen=True)
class Quantity:
    """A type for `add_argument`: a number in `unit`, from "20ms", "0.5 m", "10kHz" or a plain number in `unit`."""

    unit: str
    above: float = -math.inf
    below: float = math.inf

    @property
    def kind(self) -> str:
        return _KIND[self.unit]

    def __call__(self, text: str) -> float:
        found, units = _VALUE.fullmatch(text.strip()), _KINDS[self.kind]["exponents"]
        if not found or (found[2] or self.unit) not in units:
            names = ", ".join(name for name in units if name.isascii())
            raise argparse.ArgumentTypeError(
                f"got {text!r}, wanted a number with a unit ({names}) such as {_KINDS[self.kind]['example']}, "
                f"or in {self.unit} without"
            )
        shift = units[found[2] or self.unit] - units[self.unit]
        value = float(found[1]) * 10**shift if shift >= 0 else float(found[1]) / 10**-shift
        value = float(f"{value:.15g}") if found[2] else value  # 1.1ms are 1100 us
        if not math.isfinite(value) or not self.above < value < self.below:
            limits = [f"above {self.above:g}"] * (self.above > -math.inf)
            limits += [f"below {self.below:g}"] * (self.below < math.inf)
            raise argparse.ArgumentTypeError(f"got {text}, wanted {' and '.join(['a finite number', *limits])}")
        return value


@dataclass(frozen=True)
class Whole:
    """A type for `add_argument`: a whole number from `low` to `high`."""

    low: int
    high: int = 1 << 53
    kind = "N"

    def __call__(self, text: str) -> int:
        value = int(text) if re.fullmatch(r"[+-]?[0-9]{1,18}", text) else None
        if value is None or not self.low <= value <= self.high:
            wanted = f"{self.low} to {self.high}" if self.high < 1 << 53 else f"{self.low} on"
            raise argparse.ArgumentTypeError(f"got {text}, wanted a whole number from {wanted}")
        return value


THREADS = Whole(0, 1024)
SEED = Whole(0)


def flag(key: str) -> str:
    """The option of a key: --NAME without the unit, which values may carry."""
    bare, _, unit = key.rpartition("_")
    return _FLAGS.get(key) or "--" + (bare if bare and unit in _KIND else key).replace("_", "-")


def words(options: Mapping[str, Any]) -> list[str]:
    """Options by key as a command line has them; None and False are left out."""
    given = {flag(key): value for key, value in options.items() if value is not None and value is not False}
    return [name if value is True else f"{name}={value}" for name, value in given.items()]


def latest(command: Sequence[Any]) -> list[str]:
    """A command line without the values of options that are set again behind them; --set is a list, and what follows
    --sense is not ours."""
    line = [str(word) for word in command]
    end = line.index("--sense") if "--sense" in line else len(line)
    starts = [i for i in range(end) if re.match(r"--?[a-z]", line[i])]
    names = [line[i].partition("=")[0] for i in starts]
    kept = line[: starts[0]] if starts else line[:end]
    for number, (begin, after) in enumerate(zip(starts, [*starts[1:], end], strict=False)):
        if names[number] == "--set" or names[number] not in names[number + 1 :]:
            kept += line[begin:after]
    return kept + line[end:]


def _value(row: argparse.Action) -> str:
    """The values of an argument or an option as --help names them; of a flag none."""
    if row.nargs in (0, argparse.REMAINDER):
        return "..." if row.nargs else ""
    kind = getattr(row.type, "kind", {int: "N", float: "NUMBER"}.get(row.type, row.dest.upper()))  # type: ignore
    name = row.metavar or (f"{{{','.join(map(str, row.choices))}}}" if row.choices else kind)
    name = (name if isinstance(name, str) else " ".join(name)) + _unit(row)
    return {"?": f"[{name}]", "+": f"{name} [{name} ...]"}.get(str(row.nargs), name)


def _unit(row: argparse.Action) -> str:
    return f"[{row.type.unit}]" if isinstance(row.type, Quantity) else ""


def _about(row: argparse.Action) -> str:
    """What it is, whether it is required, and its default."""
    unit = _unit(row)[1:-1]
    usual, more = row.default, ["required"] if row.required and row.option_strings else []
    if usual not in (None, False, "", argparse.SUPPRESS) and usual != [] and usual != ():
        parts = usual if isinstance(usual, (list, tuple)) else [usual]
        more.append("default: " + " ".join(f"{f'{p:g}' if isinstance(p, float) else p}{unit}" for p in parts))
    said = row.help or ""
    return f"{said} ({'; '.join(more)})".lstrip() if more and "(default" not in said else said


def _line(name: str, about: str) -> str:
    """A row of --help; the second column begins at COLUMN."""
    first, lines = f"  {name}", textwrap.wrap(about, WIDTH - COLUMN)
    if lines and len(first) + 2 <= COLUMN:
        first = f"{first:{COLUMN}}{lines.pop(0)}"
    return "\n".join([first, *(" " * COLUMN + line for line in lines)])


class Parser(argparse.ArgumentParser):
    """A parser whose --help ends with examples. Every command has --quiet and --verbose; an unknown option is an error
    that names the nearest one. Errors are raised as PecsError "COMMAND: …"."""

    def __init__(self, *, examples: Sequence[str] = (), **more: Any):
        self.rows: list[argparse.Action] = []  # arguments and options
        self.lists: list[argparse.Action] = []  # options that may come again
        self.commands: dict[str, str] = {}  # what each does
        self.hint = ""  # at an unknown option
        self._rest = ""  # the option that takes all words behind it
        self._examples, self._talks = examples, False
        super().__init__(allow_abbrev=False, exit_on_error=False, **more)

    def add_argument(self, *names: str, **more: Any) -> argparse.Action:
        return self._record(super().add_argument, *names, **more)

    def add_mutually_exclusive_group(self, **more: Any) -> Any:
        group = super().add_mutually_exclusive_group(**more)
        group.add_argument = partial(self._record, group.add_argument)  # type: ignore[method-assign]
        return group

    def _record(self, add: Callable[..., argparse.Action], *names: str, **more: Any) -> argparse.Action:
        self.rows.append(add(*names, **more))
        self.lists += self.rows[-1:] * (more.get("action", "store") != "store")
        return self.rows[-1]

    def add_commands(self) -> SimpleNamespace:
        """`add_parser` of the result adds one."""
        commands = self.add_subparsers(metavar="COMMAND", dest="command", required=True, prog=self.prog)

        def add_parser(name: str, *, help: str, **more: Any) -> Any:
            self.commands[name] = help
            return commands.add_parser(name, **more)

        return SimpleNamespace(add_parser=add_parser)

    def _add_talk(self) -> None:
        """Adds --quiet and --verbose after a command's own options; a parser of commands has none."""
        if not self._talks and not self.commands:
            self._talks = True
            talk = self.add_mutually_exclusive_group()
            talk.add_argument("--quiet", action="store_true", help="nothing but errors and results")
            talk.add_argument("--verbose", action="store_true", help="also what was used, and how long it took")

    def format_help(self) -> str:
        self._add_talk()
        arguments = [row for row in self.rows if not row.option_strings]
        names = {row: " ".join([", ".join(row.option_strings), _value(row)]) for row in self.rows if row.option_strings}
        groups = {
            "arguments": [(row.dest.upper(), _about(row)) for row in arguments],
            "options": [(name.rstrip(), _about(row)) for row, name in names.items()],
            "commands": list(self.commands.items()),
        }
        words = ["usage:", self.prog, "[options]", *map(_value, arguments), *["COMMAND ..."] * bool(self.commands)]
        parts = [" ".join(words), *(textwrap.fill(part, WIDTH) for part in (self.description or "").split("\n\n"))]
        parts += ["\n".join([f"{title}:", *(_line(*row) for row in rows)]) for title, rows in groups.items() if rows]
        if any(map(_unit, self.rows)):
            parts.append(textwrap.fill(UNITS, WIDTH))
        parts += ["\n  ".join(["examples:", *self._examples])] * bool(self._examples)
        return "\n\n".join(filter(None, parts)) + "\n"

    def error(self, message: str) -> NoReturn:
        if message.startswith("the following arguments are required") and self._rest:
            message += f" before {self._rest}"
        command = self.prog.partition(" ")[2]
        raise PecsError(f"{command}: {message}" if command else message, ExitCode.USAGE)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Reports unknown options before missing arguments."""
        self._add_talk()
        try:
            found, rest = super().parse_known_args(self._checked(list(args or ())), namespace)
        except argparse.ArgumentError as e:
            names = (e.argument_name or "").split("/")  # the long name of an option suffices
            name = next((n for n in names if n.startswith("--")), names[0])
            self.error(f"{name}: {e.message}" if name else e.message)
        if rest:
            self.error(f"{rest[0]}: {'each KEY=VALUE needs a --set' if '=' in rest[0] else 'an argument too many'}")
        return found, rest

    def _checked(self, words: list[str]) -> list[str]:
        """The words as argparse takes them: a value that begins with a minus, such as -0.5mm, is behind "=", those of a
        pair are behind a space. Refuses unknown commands and options, and a second value of an option."""
        known = {name: row for row in self.rows for name in row.option_strings}
        out: list[str] = []
        given: list[argparse.Action] = []
        missing = 0  # values of the option before
        for i, word in enumerate(words):
            name = word.partition("=")[0] if word[:2] == "--" else word[:2]
            row = known.get(name)
            if self.commands and word[:1] != "-" and word not in self.commands:
                self.error(f"{word}: no such command; nearest: {nearest(word, list(self.commands))}")
            if row and row.nargs == argparse.REMAINDER:
                self._rest = name
            if word == "--" or word in self.commands or (row and self._rest == name):
                return out + words[i:]
            if name[:2] == "--" and not row:
                near = nearest(name, [n for n in known if n[:2] == "--"])
                self.error(f"{name}: no such option; nearest: {near}{self.hint}")
            if row and row in given:
                self.error(f"{row.option_strings[-1]}: is set twice; set it once")
            if missing and re.match(r"-\.?\d", word):
                word = f"{out.pop()}={word}" if out[-1] in known and missing == 1 else f" {word}"
            if row:
                missing = 0 if word != name else 1 if row.nargs is None else int(row.nargs)
                given += [row] * (row not in self.lists)
            missing -= not row
            out.append(word)
        return out


def account(command: str, args: Mapping[str, Any], took_s: float) -> str:
    """Printed by --verbose at the end: a line for each option that has a value, and the time."""
    hidden = ("command", "verbose")
    used = {k: v for k, v in args.items() if k not in hidden and not callable(v) and v not in (None, False, "", [], ())}
    lines = [f"{command}: {name.replace('_', '-')}: {value}\n" for name, value in used.items()]
    return "".join([*lines, f"{command}: done after {took_s:.3f} s\n"])


def nearest(word: str, names: Sequence[str]) -> str:
    return difflib.get_close_matches(word, names, n=1, cutoff=0)[0]
