"""Typed reading of JSON and TOML. Each error is one line with file and key: `FILE: PLACE.KEY: got X, wanted Y`.

    top = Fields(read_json(path), path)
    size = top.integer("width", low=1), top.integer("height", low=1)
    name = top.text("name", default="")
    top.done()                             # rejects unknown keys

JSON is read as strictly as by the C++ side (pecs/strict_json.h): no duplicate keys, finite numbers only, bounded size.
Keys that start with '_' are comments; null counts as absent.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ._errors import PecsInputError, bad_input, shown
from ._files import read_text
from ._text import MOST_BYTES, is_file_name, is_plain

if TYPE_CHECKING:
    from typing import Concatenate, ParamSpec

    import numpy as np
    from numpy.typing import NDArray
    from typing_extensions import Self

    P = ParamSpec("P")

T = TypeVar("T")
MAX_BYTES = 4 << 20
MAX_INTEGER = 1 << 53  # exact as a 64-bit float


def read_json(path: Path, max_bytes: int = MAX_BYTES) -> Any:
    return parse_json(read_text(path, max_bytes, "JSON"), path)


def parse_json(text: str, file: object) -> Any:
    def integer(digits: str) -> int | float:
        return int(digits) if len(digits) < 20 else float(digits)

    def constant(word: str) -> None:
        raise bad_input(file, "", word, "finite numbers")

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in items:
            if key in found:
                raise bad_input(file, shown(key), "the key twice", "each key once")
            found[key] = value
        return found

    try:
        value = json.loads(text, parse_int=integer, parse_constant=constant, object_pairs_hook=pairs)
        json.dumps(value, ensure_ascii=False, allow_nan=False).encode()
    except json.JSONDecodeError as e:
        raise bad_input(file, f"line {e.lineno} column {e.colno}", e.msg, "valid JSON") from None
    except RecursionError:
        raise bad_input(file, "", "too many levels", "fewer levels") from None
    except UnicodeEncodeError:
        raise bad_input(file, "", "half of a surrogate pair", "text in Unicode") from None
    except PecsInputError:
        raise
    except ValueError:
        raise bad_input(file, "", "a number beyond the range of 64-bit floats", "finite numbers") from None
    return value


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    if sys.version_info < (3, 11):
        import tomli as tomllib
    else:
        import tomllib
    try:
        found: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as e:
        raise PecsInputError(f"{path}: {e}, wanted valid TOML") from None
    except RecursionError:
        raise bad_input(path, "", "too many levels", "fewer levels") from None
    except ValueError as e:  # whole numbers of more than 4300 digits, and dates
        raise PecsInputError(f"{path}: {e}, wanted valid TOML") from None
    return found


def is_number(value: Any) -> bool:
    """A number that a 64-bit float can represent."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


class Fields:
    """The keys of one JSON object or TOML table.

    Getters raise PecsInputError if the key is missing (unless `default` is given), of another type, or out of the range
    `low` to `high`; numbers are returned as the file has them. `place`: path of the object in the file, empty at the
    top.
    """

    def __init__(self, value: Any, file: object, place: str = ""):
        if not isinstance(value, dict):
            raise bad_input(file, place, shown(value), "an object")
        self.content, self.file, self.place = value, file, place
        self._read: set[str] = set()

    def at(self, key: str) -> str:
        """Path of a key in the file."""
        return f"{self.place}.{key}" if self.place else key

    def fail(self, key: str, got: object, wanted: str) -> PecsInputError:
        """An error at a key; `got` in words, or a value."""
        return bad_input(self.file, self.at(key), got, wanted)

    def wrong(self, key: str, wanted: str) -> PecsInputError:
        """An error at a key, with the value in the file."""
        return self.fail(key, "nothing" if self.content.get(key) is None else shown(self.content[key]), wanted)

    def keys(self) -> list[str]:
        """All but comments."""
        return [key for key in self.content if not key.startswith("_")]

    def has(self, key: str) -> bool:
        """Present and not null."""
        self._read.add(key)
        return self.content.get(key) is not None

    def any(self, key: str, wanted: str = "a value") -> Any:
        if not self.has(key):
            raise self.wrong(key, wanted)
        return self.content[key]

    def optional(
        self, read: Callable[Concatenate[str, P], T], key: str, /, *args: P.args, **limits: P.kwargs
    ) -> T | None:
        """`read(key, ...)`, or None if the key is absent: `fields.optional(fields.number, "fnumber", low=0.5)`."""
        return read(key, *args, **limits) if self.has(key) else None

    def _typed(self, key: str, default: Any, kinds: tuple[type, ...], wanted: str) -> Any:
        if default is not None and not self.has(key):
            return default
        value = self.any(key, wanted)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            raise self.wrong(key, wanted)
        return value

    def text(self, key: str, default: str | None = None, choices: tuple[str, ...] = (), *, lines: bool = False) -> str:
        """Text without control characters; `lines`: it may have several lines."""
        wanted = f"one of {', '.join(choices)}" if choices else "text"
        value: str = self._typed(key, default, (str,), wanted)
        if choices and value not in choices:
            raise self.wrong(key, wanted)
        if not is_plain(value, lines):
            raise self.wrong(key, "text without control characters")
        return value

    def file_name(self, key: str) -> str:
        """A name that becomes part of a path."""
        name = self.text(key)
        if not is_file_name(name):
            raise self.wrong(key, f"a name of a file, of at most {MOST_BYTES} bytes")
        return name

    def flag(self, key: str, default: bool | None = None) -> bool:
        value: bool = self._typed(key, default, (bool,), "true or false")
        return value

    def number(self, key: str, default: float | None = None, low: float = -math.inf, high: float = math.inf) -> float:
        wanted = wanted_number(low, high)
        value: float = self._typed(key, default, (int, float), wanted)
        if not (low <= value <= high and is_number(value)):
            raise self.wrong(key, wanted)
        return value

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = MAX_INTEGER) -> int:
        wanted = f"a whole number >= {low}" if high == MAX_INTEGER else f"a whole number in [{low}, {high}]"
        value: int = self._typed(key, default, (int,), wanted)
        if not low <= value <= high:
            raise self.wrong(key, wanted)
        return value

    def _each(self, key: str, default: Any, wanted: str, good: Callable[[Any], bool]) -> list[Any]:
        values = list(self._typed(key, default, (list, tuple), wanted))
        if not all(map(good, values)):
            raise self.wrong(key, wanted)
        return values

    def numbers(
        self,
        key: str,
        default: tuple[float, ...] | None = None,
        *,
        count: int = 0,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> list[float]:
        """A list of `count` numbers; 0: of any length."""
        each = "" if low == -math.inf and high == math.inf else f", each {wanted_number(low, high)}"
        wanted = f"a list of {count or ''} numbers{each}".replace("  ", " ")
        good = self._each(key, default, wanted, lambda v: is_number(v) and low <= v <= high)
        if count and len(good) != count:
            raise self.wrong(key, wanted)
        return good

    def texts(self, key: str, default: list[str] | None = None, choices: tuple[str, ...] = ()) -> list[str]:
        """A list of texts, each one of `choices` if there are any."""
        wanted = f"a list of {', '.join(choices) or 'texts'}"
        return self._each(
            key, default, wanted, lambda v: isinstance(v, str) and (v in choices if choices else is_plain(v))
        )

    def array(self, key: str, *shape: int) -> NDArray[np.float64]:
        """Finite numbers; -1 in `shape` is any length."""
        import numpy as np

        wanted = f"{' x '.join('n' if s < 0 else str(s) for s in shape)} finite numbers"
        try:
            listed = self.any(key, wanted)
            if not all(map(is_number, _leaves(listed))):  # NumPy also takes numbers in quotes, and booleans
                raise ValueError
            out = np.array(listed, np.float64)
        except (TypeError, ValueError):
            raise self.wrong(key, wanted) from None
        fits = out.ndim == len(shape) and all(s in (-1, n) for s, n in zip(shape, out.shape, strict=True))
        if not fits or not np.isfinite(out).all():
            raise self.wrong(key, wanted)
        return out

    def table(self, key: str, default: dict[str, Any] | None = None) -> Self:
        return type(self)(self._typed(key, default, (dict,), "an object"), self.file, self.at(key))

    def tables(self, key: str, default: list[Any] | None = None, *, least: int = 0) -> list[Self]:
        wanted = f"a list of {f'{least} or more ' if least else ''}objects"
        values = self._typed(key, default, (list,), wanted)
        if len(values) < least:
            raise self.wrong(key, wanted)
        return [type(self)(value, self.file, f"{self.at(key)}[{i}]") for i, value in enumerate(values)]

    def done(self) -> None:
        """Raises PecsInputError for a key that no getter has read."""
        for key in self.keys():
            if key not in self._read:
                raise self.fail(shown(key)[1:-1], "an unknown key", f"one of {', '.join(sorted(self._read))}")


def _leaves(value: Any) -> Iterator[Any]:
    if not isinstance(value, (list, tuple)):
        yield value
        return
    for item in value:
        yield from _leaves(item)


def wanted_number(low: float, high: float) -> str:
    if math.isinf(low) and math.isinf(high):
        return "a finite number"
    if math.isinf(high):
        return f"a number >= {low:g}"
    if math.isinf(low):
        return f"a number <= {high:g}"
    return f"a number in [{low:g}, {high:g}]"
