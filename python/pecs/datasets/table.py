"""Tables of a recipe, checked as they are read: each getter names file and key when a value is missing, of the wrong
type or out of range, and done() refuses keys that nobody asked for."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._library import PecsInputError, PecsNotFoundError

BAD_INPUT, NOT_FOUND = 4, 3


def bad_input(file: object, place: str, got: object, wanted: str) -> PecsInputError:
    """One line: file, place, got, wanted."""
    text = got if isinstance(got, str) else shown(got)
    return PecsInputError(f"{file}: {place + ': ' if place else ''}got {text}, wanted {wanted}", BAD_INPUT)


def shown(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def read_toml(path: Path) -> dict[str, Any]:
    if sys.version_info < (3, 11):
        import tomli as tomllib
    else:
        import tomllib
    try:
        found: dict[str, Any] = tomllib.loads(path.read_bytes().decode())
    except OSError as e:
        raise PecsNotFoundError(f"{path}: {e.strerror or e}", NOT_FOUND) from None
    except UnicodeDecodeError as e:
        raise bad_input(path, f"byte {e.start}", "no UTF-8", "TOML in UTF-8") from None
    except tomllib.TOMLDecodeError as e:
        raise PecsInputError(f"{path}: {e}, wanted valid TOML", BAD_INPUT) from None
    return found


@dataclass(frozen=True)
class Value:
    """A number or word that is drawn for each sequence. kind: "fixed", "uniform", "log", "normal" or "choice"."""

    kind: str
    of: tuple[Any, ...]
    low: float = -math.inf
    high: float = math.inf

    def draw(self, rng: np.random.Generator) -> Any:
        if self.kind == "fixed":
            return self.of[0]
        if self.kind == "choice":
            return self.of[int(rng.integers(len(self.of)))]
        a, b = self.of
        if self.kind == "uniform":
            return float(rng.uniform(a, b))
        if self.kind == "log":
            return float(math.exp(rng.uniform(math.log(a), math.log(b))))
        while not self.low <= (found := float(rng.normal(a, b))) <= self.high:  # truncated
            pass
        return found


class Table:
    """place: where it stands in the file, for errors."""

    def __init__(self, content: dict[str, Any], file: object, place: str = ""):
        self.file, self.place, self._content, self._asked = file, place, content, set()

    def _at(self, key: str) -> str:
        return f"{self.place}.{key}" if self.place else key

    def fail(self, key: str, got: object, wanted: str) -> PecsInputError:
        return bad_input(self.file, self._at(key), got, wanted)

    def keys(self) -> list[str]:
        return list(self._content)

    def has(self, key: str) -> bool:
        return key in self._content

    def any(self, key: str) -> Any:
        self._asked.add(key)
        if key not in self._content:
            raise self.fail(key, "nothing", "a value")
        return self._content[key]

    def _typed(self, key: str, default: Any, kinds: tuple[type, ...], wanted: str) -> Any:
        if default is not None and not self.has(key):
            self._asked.add(key)
            return default
        value = self.any(key)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            raise self.fail(key, value, wanted)
        return value

    def text(self, key: str, default: str | None = None, choices: tuple[str, ...] = ()) -> str:
        wanted = f"one of {', '.join(choices)}" if choices else "text"
        value: str = self._typed(key, default, (str,), wanted)
        if choices and value not in choices:
            raise self.fail(key, value, wanted)
        return value

    def flag(self, key: str, default: bool) -> bool:
        value: bool = self._typed(key, default, (bool,), "true or false")
        return value

    def number(self, key: str, default: float | None = None, low: float = -math.inf, high: float = math.inf) -> float:
        wanted = _wanted(low, high)
        value = float(self._typed(key, default, (int, float), wanted))
        if not low <= value <= high:  # nor NaN
            raise self.fail(key, value, wanted)
        return value

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = 2**31 - 1) -> int:
        value: int = self._typed(key, default, (int,), f"a whole number, {low} to {high}")
        if not low <= value <= high:
            raise self.fail(key, value, f"a whole number, {low} to {high}")
        return value

    def numbers(self, key: str, count: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        value = self._typed(key, default, (list, tuple), f"a list of {count} numbers")
        if len(value) != count or not all(_is_number(v) for v in value):
            raise self.fail(key, value, f"a list of {count} numbers")
        return tuple(map(float, value))

    def table(self, key: str) -> Table:
        value = self._typed(key, {}, (dict,), "a table")
        return Table(value, self.file, self._at(key))

    def tables(self, key: str, least: int = 1) -> list[Table]:
        value = self._typed(key, [], (list,), f"[[{self._at(key)}]]")
        if len(value) < least or not all(isinstance(v, dict) for v in value):
            raise self.fail(key, "nothing" if not value else value, f"{least} or more [[{self._at(key)}]]")
        return [Table(v, self.file, f"{self._at(key)}[{i}]") for i, v in enumerate(value)]

    def value(self, key: str, default: Any = None, low: float = -math.inf, high: float = math.inf) -> Value:
        """A number, or a rule to draw it: [low, high], {log = [low, high]}, {normal = [mean, sd], range = [low, high]}
        or {choice = [...]}."""
        if default is not None and not self.has(key):
            self._asked.add(key)
            return Value("fixed", (default,))
        return self._value(key, self.any(key), low, high)

    def words(self, key: str, default: str | None = None) -> Value:
        """A word, or {choice = [words]}."""
        got = self._typed(key, default, (str, dict), "text or {choice = [...]}")
        words = got.get("choice") if isinstance(got, dict) and set(got) == {"choice"} else [got]
        if not isinstance(words, list) or not words or not all(isinstance(w, str) for w in words):
            raise self.fail(key, got, "text or {choice = [texts]}")
        return Value("choice" if len(words) > 1 else "fixed", tuple(words))

    def _value(self, key: str, got: Any, low: float, high: float) -> Value:
        wanted = (
            f"{_wanted(low, high)}, [low, high], {{log = [low, high]}}, {{normal = [mean, sd], range = [low, high]}}"
        )
        wanted += " or {choice = [numbers]}"

        def numbers(what: Any, count: int | None = None) -> tuple[float, ...]:
            if not isinstance(what, list) or not what or (count and len(what) != count):
                raise self.fail(key, got, wanted)
            if not all(_is_number(v) for v in what):
                raise self.fail(key, got, wanted)
            return tuple(what)

        def inside(what: tuple[float, ...], rising: bool = False) -> tuple[float, ...]:
            if not all(low <= v <= high for v in what) or (rising and what[0] > what[1]):
                raise self.fail(key, got, wanted)
            return what

        if _is_number(got):
            return Value("fixed", inside((got,)))
        if isinstance(got, list):
            return Value("uniform", inside(numbers(got, 2), rising=True))
        if not isinstance(got, dict):
            raise self.fail(key, got, wanted)
        match set(got):
            case names if names == {"log"}:
                ends = inside(numbers(got["log"], 2), rising=True)
                if ends[0] <= 0:
                    raise self.fail(key, got, "{log = [low, high]} with low above 0")
                return Value("log", ends)
            case names if names == {"choice"}:
                return Value("choice", inside(numbers(got["choice"])))
            case names if names == {"normal", "range"}:
                (mean, sd), ends = numbers(got["normal"], 2), inside(numbers(got["range"], 2), rising=True)
                if sd < 0 or not ends[0] <= mean <= ends[1]:
                    raise self.fail(key, got, "a mean within the range and sd of at least 0")
                return Value("normal", (mean, sd), *ends)
        raise self.fail(key, got, wanted)

    def done(self) -> None:
        for key in self._content:
            if key not in self._asked:
                raise self.fail(key, "an unknown key", f"one of {', '.join(sorted(self._asked))}")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _wanted(low: float, high: float) -> str:
    ends = [f"at least {low:g}"] if low > -math.inf else []
    ends += [f"at most {high:g}"] if high < math.inf else []
    return " and ".join(["a number", *ends]) if len(ends) < 2 else f"a number from {low:g} to {high:g}"
