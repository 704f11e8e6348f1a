"""Parsers of all Python commands: values with a unit, one form of --help, the nearest option; by the same rules as the
program (apps/pecs/units.cpp, help.cpp, usage.cpp)."""

from __future__ import annotations

import argparse
import difflib
import json
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from ._errors import ExitCode, PecsError

# Kind of quantity -> an example, and its units with their power of ten in SI units. The program reads it too.
_KINDS: dict[str, Any] = json.loads(Path(__file__).with_name("units.json").read_text("utf-8"))
_KIND = {unit: kind for kind, entry in _KINDS.items() for unit in entry["exponents"]}
_FLAGS = {"min_nm": "--min-wavelength", "max_nm": "--max-wavelength", "moving_px": "--moving-px"}
_VALUE = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) *(\D*)", re.ASCII)
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


class _Help(argparse.RawDescriptionHelpFormatter):
    def __init__(self, prog: str, **more: Any):
        super().__init__(prog, max_help_position=28, **more)

    def _format_usage(self, usage: object, actions: Sequence[argparse.Action], groups: object, prefix: object) -> str:
        """Arguments without the options, which are listed below."""
        arguments = [action for action in actions if not action.option_strings]
        words = [self._format_args(action, action.dest.upper()) for action in arguments]
        return f"usage: {' '.join([self._prog, '[options]', *words])}\n\n"

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        """Wraps all paragraphs but the examples."""
        parts = text.split("\n\n")
        return "\n\n".join(part if part.startswith("examples:") else textwrap.fill(part, width) for part in parts)

    def _get_default_metavar_for_positional(self, action: argparse.Action) -> str:
        return action.dest.upper()

    def _get_default_metavar_for_optional(self, action: argparse.Action) -> str:
        if isinstance(action.type, Quantity):
            return f"{action.type.kind}[{action.type.unit}]"
        if isinstance(action.type, Whole):
            return "N"
        return {int: "N", float: "NUMBER"}.get(action.type, action.dest.upper())  # type: ignore[arg-type]

    def _format_action_invocation(self, action: argparse.Action) -> str:
        """All names, then the value once."""
        if not action.option_strings:
            return super()._format_action_invocation(action)
        value = self._format_args(action, self._get_default_metavar_for_optional(action)) if action.nargs != 0 else ""
        unit = f"[{action.type.unit}]" if isinstance(action.type, Quantity) and action.metavar else ""
        return " ".join(filter(None, (", ".join(action.option_strings), value, unit)))

    def _get_help_string(self, action: argparse.Action) -> str:
        unit = action.type.unit if isinstance(action.type, Quantity) else ""
        usual, more = action.default, ["required"] if action.required and action.option_strings else []
        if usual not in (None, False, "", argparse.SUPPRESS) and usual != [] and usual != ():
            parts = usual if isinstance(usual, (list, tuple)) else [usual]
            more.append("default: " + " ".join(f"{f'{p:g}' if isinstance(p, float) else p}{unit}" for p in parts))
        said = (action.help or "").replace("%", "%%")
        return f"{said} ({'; '.join(more)})".lstrip() if more and "(default" not in said else said


class Parser(argparse.ArgumentParser):
    """A parser whose --help ends with examples. Every command has --quiet and --verbose; an unknown option is an error
    that names the nearest one. Errors are raised as PecsError "COMMAND: …"."""

    def __init__(self, *, examples: Sequence[str] = (), **more: Any):
        more.setdefault("formatter_class", _Help)
        if examples:
            more["epilog"] = "\n  ".join(["examples:", *examples])
        super().__init__(allow_abbrev=False, **more)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # -0.5mm is a value
        self._positionals.title, self._optionals.title = "arguments", "options"
        self._talks = False
        self._given: set[argparse.Action] = set()
        self.hint = ""  # at an unknown option
        self._rest = ""  # the option that took all words behind it

    def error(self, message: str) -> NoReturn:
        if found := re.match(r"argument ([-\w/]+): ", message):  # argparse's; the long name of an option suffices
            names = found[1].split("/")
            message = f"{next((n for n in names if n.startswith('--')), names[0])}: {message[found.end() :]}"
        if found := re.match(r"unrecognized arguments: (\S+)", message):
            message = f"{found[1]}: {'each KEY=VALUE needs a --set' if '=' in found[1] else 'an argument too many'}"
        if message.startswith("the following arguments are required") and self._rest:
            message += f" before {self._rest}"
        command = self.prog.partition(" ")[2]
        raise PecsError(f"{command}: {message}" if command else message, ExitCode.USAGE)

    def add_commands(self, **more: Any) -> argparse._SubParsersAction:
        return self.add_subparsers(
            title="commands", metavar="COMMAND", dest="command", required=True, prog=self.prog, **more
        )

    def _add_talk(self) -> None:
        """Adds --quiet and --verbose after a command's own options; a parser of commands has none."""
        if not self._talks and not any(isinstance(a, argparse._SubParsersAction) for a in self._actions):
            self._talks = True
            talk = self.add_mutually_exclusive_group()
            talk.add_argument("--quiet", action="store_true", help="nothing but errors and results")
            talk.add_argument("--verbose", action="store_true", help="also what was used, and how long it took")

    def format_help(self) -> str:
        self._add_talk()
        had = self.epilog
        if any(isinstance(action.type, Quantity) for action in self._actions):
            self.epilog = f"{UNITS}\n\n{had}" if had else UNITS
        text = super().format_help()
        self.epilog = had
        return text

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Reports unknown options before missing arguments."""
        self._add_talk()
        self._given.clear()
        known = {name: action for action in self._actions for name in action.option_strings}
        commands = [a for a in self._actions if isinstance(a, argparse._SubParsersAction)]
        for word in args or ():
            name = word.partition("=")[0]
            if word == "--" or (commands and not word.startswith("-")):
                break
            if name in known and known[name].nargs == argparse.REMAINDER:
                self._rest = name
                break
            if name.startswith("--") and name not in known:
                near = nearest(name, [n for n in known if n[:2] == "--"])
                self.error(f"{name}: no such option; nearest: {near}{self.hint}")
        if commands and (words := [w for w in args or () if not w.startswith("-")][:1]):
            if words[0] not in commands[0].choices:
                self.error(f"{words[0]}: no such command; nearest: {nearest(words[0], list(commands[0].choices))}")
        return super().parse_known_args(args, namespace)

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        """Refuses a second value of an option that is no list; a flag may come twice, as in the program."""
        if action.option_strings and action.nargs != 0 and not isinstance(action, argparse._AppendAction):
            if action in self._given:
                self.error(f"{action.option_strings[-1]}: is set twice; set it once")
            self._given.add(action)
        return super()._get_values(action, arg_strings)


def account(command: str, args: Mapping[str, Any], took_s: float) -> str:
    """Printed by --verbose at the end: a line for each option that has a value, and the time."""
    hidden = ("command", "verbose")
    used = {k: v for k, v in args.items() if k not in hidden and not callable(v) and v not in (None, False, "", [], ())}
    lines = [f"{command}: {name.replace('_', '-')}: {value}\n" for name, value in used.items()]
    return "".join([*lines, f"{command}: done after {took_s:.3f} s\n"])


def nearest(word: str, names: Sequence[str]) -> str:
    return difflib.get_close_matches(word, names, n=1, cutoff=0)[0]
