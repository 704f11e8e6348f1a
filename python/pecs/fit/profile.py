"""The chip profile that a fit writes: the starting profile with the fitted values, their intervals and sources."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._errors import bad_input
from .._files import read_text, write_json
from .._library import data_dir

if TYPE_CHECKING:
    from .estimate import Fitted

MAX_BYTES = 1 << 22


def chip_file(chip: str) -> Path:
    """The file of a profile, by name or path."""
    return Path(chip) if chip.endswith(".json") else data_dir("sensor/chips") / f"{chip}.json"


def _rounded(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")


def write(found: Fitted, path: Path) -> None:
    """Raises PecsOutputError."""
    start = chip_file(found.chip)
    profile: dict[str, Any] = json.loads(read_text(start, MAX_BYTES, "JSON"))
    if not isinstance(profile, dict) or "values" not in profile:
        raise bad_input(start, "values", "none", "a chip profile")
    files = ", ".join(Path(f).name for f in found.files)
    profile["description"] = f"fitted by pecs fit to {files}; starting profile: {profile['name']}"
    profile["name"] = path.stem
    for key in ("trade_names", "pixel_map"):
        profile.pop(key, None)
    if found.pixel_map:
        file = path.with_name(f"{path.stem}_pixels.json")
        found.pixel_map.write(file, f"measured by pecs fit from {files}")
        profile["pixel_map"] = file.name
    for key, of in found.values.items():
        entry = profile["values"].get(key)
        if entry is None or not of.fitted:
            continue
        low, high = entry["range"]
        entry["value"] = _rounded(min(max(of.value, low), high))
        entry["interval"] = [_rounded(min(max(v, low), high)) for v in of.interval]
        entry["source"] = f"fitted by pecs fit to {files}: 95 % interval"
    write_json(path, profile)
