"""Tables of results, as Markdown."""

import math
from collections.abc import Iterable, Sequence


def table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (head, ["---"] * len(head), *rows))


def cell(value: float | None) -> str:
    return "–" if value is None or not math.isfinite(value) else f"{value:.3g}"


def with_interval(row: dict, key: str) -> str:
    low_high = row.get(f"{key}_interval")
    return cell(row[key]) + (" ({}…{})".format(*map(cell, low_high)) if low_high else "")
