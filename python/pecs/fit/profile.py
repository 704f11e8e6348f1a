"""Chip profiles that a fit starts from and writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .._config import read_json
from .._errors import bad_input
from .._library import data_dir

MAX_BYTES = 1 << 22


def read(chip: str) -> dict[str, Any]:
    """A profile, by name or path."""
    file = Path(chip) if chip.endswith(".json") else data_dir("sensor/chips") / f"{chip}.json"
    profile: dict[str, Any] = read_json(file, MAX_BYTES)
    if not isinstance(profile, dict) or "values" not in profile:
        raise bad_input(file, "values", "none", "a chip profile")
    return profile


def pixel_map_path(profile: Path) -> Path:
    return profile.with_name(f"{profile.stem}_pixels.json")
