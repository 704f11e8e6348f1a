"""Tables of a recipe: dataclasses whose fields are keys, and values that are fixed, or drawn for each sequence.

@dataclass(frozen=True)
class Truth:
    fps: float = key(Table.number, 20.0, low=1e-3)

truth = Table({"fps": 50}, "r.toml").into(Truth)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import numpy as np

from .._config import Fields, is_number, wanted_number

T = TypeVar("T")


def key(
    read: Callable[..., Any],
    *args: Any,
    name: str = "",
    only: Callable[[Table], bool] = lambda table: True,
    absent: Any = None,
    **limits: Any,
) -> Any:
    """A field of a dataclass that `read(table, key, ...)` gets from a table. name: of the key, by default the field's.
    only: whether the table may have the key; `absent` is the value if it may not."""

    def get(table: Table, key: str) -> Any:
        return read(table, name or key, *args, **limits) if only(table) else absent

    return field(metadata={"get": get})


def optional(read: Callable[..., Any], *args: Any, **more: Any) -> Any:
    """As `key`, of a key that may be absent: None."""

    def get(table: Table, key: str, *args: Any, **limits: Any) -> Any:
        return read(table, key, *args, **limits) if table.has(key) else None

    return key(get, *args, **more)


def without(key: str) -> Callable[[Table], bool]:
    """For `only`: tables that lack another key."""
    return lambda table: not table.has(key)


@dataclass(frozen=True)
class Value:
    """A number or text that is drawn for each sequence. kind: "fixed", "uniform", "log", "normal" or "choice"."""

    kind: str
    values: tuple[Any, ...]
    low: float = -math.inf
    high: float = math.inf

    @property
    def ends(self) -> tuple[Any, ...]:
        """Values that no drawn one is outside of, or all of a choice."""
        return (self.low, self.high) if self.kind == "normal" else self.values

    def draw(self, rng: np.random.Generator) -> Any:
        if self.kind == "fixed":
            return self.values[0]
        if self.kind == "choice":
            return self.values[int(rng.integers(len(self.values)))]
        a, b = self.values
        if self.kind == "uniform":
            return float(rng.uniform(a, b))
        if self.kind == "log":
            return float(math.exp(rng.uniform(math.log(a), math.log(b))))
        return self._normal(rng, *self.values)

    def _normal(self, rng: np.random.Generator, mean: float, sd: float) -> float:
        """A normal distribution within the range, by rejection: of normal proposals, or, if the range is narrower than
        sd, of uniform ones. At least 34 % of the proposals are accepted."""
        while True:
            if sd < self.high - self.low:
                found = float(rng.normal(mean, sd))
                accepted = self.low <= found <= self.high
            else:
                found = float(rng.uniform(self.low, self.high))
                accepted = (found - mean) ** 2 <= 2 * sd**2 * rng.exponential()
            if accepted:
                return found


class Table(Fields):
    def into(self, kind: type[T], **given: Any) -> T:
        """A dataclass of the table, which has no keys but its fields' and those that were read before; `given`: fields
        that are no keys."""
        found = {f.name: f.metadata["get"](self, f.name) for f in fields(kind) if f.metadata}  # type: ignore[arg-type]
        self.done()
        return kind(**found, **given)

    def part(self, key: str, kind: type[T]) -> T:
        """A table below this one, which may be absent, as a dataclass."""
        return self.table(key, {}).into(kind)

    def all(self, key: str, read: Callable[[Table, str], Any]) -> dict[str, Any]:
        """Each key of a table below this one, which may be absent, by `read(table, key)`."""
        table = self.table(key, {})
        return {name: read(table, name) for name in table.keys()}

    def value(self, key: str, default: Any = None, low: float = -math.inf, high: float = math.inf) -> Value:
        """A number, or a rule to draw it: [low, high], {log = [low, high]}, {normal = [mean, sd], range = [low, high]}
        or {choice = [...]}."""
        if default is not None and not self.has(key):
            return Value("fixed", (default,))
        rule = self.any(key)
        ends = "[low, high], {log = [low, high]}, {normal = [mean, sd], range = [low, high]} or {choice = [numbers]}"
        wanted = f"{wanted_number(low, high)}, {ends}"

        def numbers(values: Any, count: int = 0, rising: bool = False) -> tuple[float, ...]:
            good = isinstance(values, list) and values and (not count or len(values) == count)
            if not good or not all(is_number(v) and low <= v <= high for v in values):
                raise self.wrong(key, wanted)
            if rising and values[0] > values[1]:
                raise self.wrong(key, wanted)
            return tuple(values)

        if is_number(rule):
            return Value("fixed", numbers([rule]))
        if isinstance(rule, list):
            return Value("uniform", numbers(rule, 2, rising=True))
        match rule:
            case {"log": log, **rest} if not rest:
                ends_log = numbers(log, 2, rising=True)
                if ends_log[0] <= 0:
                    raise self.wrong(key, "{log = [low, high]} with low above 0")
                return Value("log", ends_log)
            case {"choice": choice, **rest} if not rest:
                return Value("choice", numbers(choice))
            case {"normal": [mean, sd], "range": limits, **rest} if not rest and is_number(mean) and is_number(sd):
                first, last = numbers(limits, 2, rising=True)
                if not (0 <= sd and first <= mean <= last):
                    raise self.wrong(key, "a mean within the range and sd of at least 0")
                return Value("normal", (mean, sd), first, last)
        raise self.wrong(key, wanted)

    def words(self, key: str) -> Value:
        """Text, or {choice = [texts]}."""
        match self.any(key):
            case str(word):
                return Value("fixed", (word,))
            case {"choice": [*words], **rest} if not rest and words and all(isinstance(w, str) for w in words):
                return Value("choice", tuple(words))
        raise self.wrong(key, "text or {choice = [texts]}")

    def drawn(self, key: str) -> Value:
        """Text or a number, by what the file has."""
        match self.any(key):
            case str() | {"choice": [str(), *_]}:
                return self.words(key)
        return self.value(key)
