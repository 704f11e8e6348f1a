"""Results as JSON, and tables of them as Markdown."""

import json
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path


def write_results(path: Path, report: dict) -> None:
    """JSON with one value a line; a list of numbers is one value."""
    text = json.dumps(report, indent=1)
    path.write_text(re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda m: f"[{' '.join(m[1].split())}]", text) + "\n")


def table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (head, ["---"] * len(head), *rows))


def cell(value: float | None) -> str:
    return "–" if value is None or not math.isfinite(value) else f"{value:.3g}"


def with_interval(row: dict, key: str) -> str:
    low_high = row.get(f"{key}_interval")
    return cell(row[key]) + (" ({}…{})".format(*map(cell, low_high)) if low_high else "")
