"""Chip profiles that a fit starts from and writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .._config import read_json
from .._errors import bad_input
from .._library import data_dir

MAX_BYTES = 1 << 22


def read(chip: str) -> dict[str, Any]:
    """A profile, by name or path, with the values of the one that it is based on."""
    file = Path(chip) if chip.endswith(".json") else data_dir("sensor/chips") / f"{chip}.json"
    profile: dict[str, Any] = read_json(file, MAX_BYTES)
    if isinstance(profile, dict) and "based_on" in profile:
        base, own = read(str(profile.pop("based_on"))), profile
        merged = {key: base[key] | own.get(key, {}) for key in ("values", "frames") if key in base}
        profile = base | own | merged
    if not isinstance(profile, dict) or "values" not in profile:
        raise bad_input(file, "values", "none", "a chip profile")
    return profile


def pixel_map_path(profile: Path) -> Path:
    return profile.with_name(f"{profile.stem}_pixels.json")
