# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON that is checked as it is read, with the errors of the C++ side (pecs/strict_json.h): each getter names file and
key when a value is missing, of the wrong type, not finite or out of range, and done() refuses keys that nobody asked
for. Keys that start with '_' are comments."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

from .errors import RenderError, bad_input
from .files import read_text

MAX_BYTES = 4 << 20
MAX_DEPTH = 64
_TEXT = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)


def read_json(path: Path, max_bytes: int = MAX_BYTES) -> Any:
    return parse_json(read_text(path, max_bytes, "JSON"), path)


def parse_json(text: str, file: object) -> Any:
    def number(digits: str) -> float:
        if not math.isfinite(value := float(digits)):
            raise bad_input(file, "", f"the number {digits[:40]}", "finite numbers")
        return value

    def integer(digits: str) -> int | float:
        return int(digits) if len(digits) < 20 else number(digits)

    def constant(word: str) -> None:
        raise bad_input(file, "", word, "finite numbers")

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in items:
            if key in found:
                raise bad_input(file, shown(key), "the key twice", "each key once")
            found[key] = value
        return found

    if _depth(text) > MAX_DEPTH:
        raise bad_input(file, "", f"more than {MAX_DEPTH} levels", "fewer levels")
    try:
        value = json.loads(
            text, parse_float=number, parse_int=integer, parse_constant=constant, object_pairs_hook=pairs
        )
        json.dumps(value, ensure_ascii=False).encode()
    except json.JSONDecodeError as e:
        raise bad_input(file, f"line {e.lineno} column {e.colno}", e.msg, "valid JSON") from None
    except UnicodeEncodeError:
        raise bad_input(file, "", "half of a surrogate pair", "text in Unicode") from None
    return value


def _depth(text: str) -> int:
    depth = deepest = 0
    for c in re.findall(r"[\[\]{}]", _TEXT.sub("", text)):
        depth += 1 if c in "[{" else -1
        deepest = max(deepest, depth)
    return deepest


def shown(value: Any) -> str:
    """A value in an error: one short line."""
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


class JsonObject:
    """`place` is the path inside the file; empty at the top."""

    def __init__(self, value: Any, file: object, place: str = ""):
        if not isinstance(value, dict):
            raise bad_input(file, place, shown(value), "an object")
        self._value, self._asked = value, set()
        self.file, self.place = file, place

    def fail(self, key: str, got: object, wanted: str) -> RenderError:
        return bad_input(self.file, f"{self.place}.{key}" if self.place else key, got, wanted)

    def keys(self) -> list[str]:
        """All but comments."""
        return [key for key in self._value if not key.startswith("_")]

    def has(self, key: str) -> bool:
        """Present and not null."""
        self._asked.add(key)
        return self._value.get(key) is not None

    def any(self, key: str) -> Any:
        if not self.has(key):
            raise self.fail(key, "nothing", "a value")
        return self._value[key]

    def number(self, key: str, low: float = -math.inf, high: float = math.inf) -> int | float:
        return self._number(key, self.any(key), low, high)

    def maybe_number(self, key: str, low: float = -math.inf, high: float = math.inf) -> int | float | None:
        return self.number(key, low, high) if self.has(key) else None

    def numbers(self, key: str, low: float = -math.inf, high: float = math.inf, count: int = 0) -> list[int | float]:
        """count 0: any."""
        value = self.any(key)
        if not isinstance(value, list) or (count and len(value) != count):
            raise self.fail(key, shown(value), f"a list of {count or ''} numbers".replace("  ", " "))
        return [self._number(f"{key}[{i}]", v, low, high) for i, v in enumerate(value)]

    def text(self, key: str) -> str:
        value = self.any(key)
        if not isinstance(value, str):
            raise self.fail(key, shown(value), "text")
        return value

    def object(self, key: str) -> JsonObject:
        return JsonObject(self.any(key), self.file, f"{self.place}.{key}" if self.place else key)

    def done(self) -> None:
        for key in self.keys():
            if key not in self._asked:
                raise self.fail(shown(key)[1:-1], "an unknown key", f"one of {', '.join(sorted(self._asked))}")

    def _number(self, key: str, value: Any, low: float, high: float) -> int | float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise self.fail(key, shown(value), wanted_number(low, high))
        return value


def wanted_number(low: float, high: float) -> str:
    if math.isinf(low) and math.isinf(high):
        return "a finite number"
    if math.isinf(high):
        return f"a number >= {low:g}"
    if math.isinf(low):
        return f"a number <= {high:g}"
    return f"a number in [{low:g}, {high:g}]"
