"""Results of studies: tables as Markdown, files as JSON."""

import json
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

MOST_COLUMNS = 110  # of a table of values in JSON


def table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (head, ["---"] * len(head), *rows))


def cell(value: float | None) -> str:
    if isinstance(value, int):
        return str(value)
    return "–" if value is None or not math.isfinite(value) else f"{value:.3g}"


def with_interval(found: Sequence[float | None]) -> str:
    """Text of a value alone, or of a value and the ends of its interval."""
    value, *ends = map(cell, found)
    return value + (f" ({ends[0]}…{ends[1]})" if ends else "")


def write(path: Path, results: dict[str, Any]) -> None:
    """With seven digits; a list or a table of values is one line if it fits into MOST_COLUMNS."""

    def line(of: re.Match[str]) -> str:
        text = json.dumps(json.loads(of[0]))
        return text if of[0][0] == "[" or len(text) <= MOST_COLUMNS else of[0]

    def short(of: Any) -> Any:
        if isinstance(of, dict):
            return {key: short(value) for key, value in of.items()}
        if isinstance(of, (list, tuple)):
            return [short(value) for value in of]
        return float(f"{of:.7g}") if isinstance(of, float) else of

    text = json.dumps(short(results), indent=1)
    path.write_text(re.sub(r"[{[][^][{}]*[]}]", line, text) + "\n")
