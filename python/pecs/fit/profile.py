"""The chip profile that a fit writes: the starting profile with the fitted values, their intervals and sources."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._config import read_json
from .._errors import bad_input
from .._files import write_json
from .._library import data_dir

if TYPE_CHECKING:
    from .estimate import Fitted
    from .pixel_map import PixelMap

MAX_BYTES = 1 << 22


def _rounded(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")


def read(chip: str) -> dict[str, Any]:
    """A profile, by name or path."""
    file = Path(chip) if chip.endswith(".json") else data_dir("sensor/chips") / f"{chip}.json"
    profile: dict[str, Any] = read_json(file, MAX_BYTES)
    if not isinstance(profile, dict) or "values" not in profile:
        raise bad_input(file, "values", "none", "a chip profile")
    return profile


def pixel_map_path(profile: Path) -> Path:
    return profile.with_name(f"{profile.stem}_pixels.json")


def write_pixel_map(found: PixelMap, path: Path, source: str) -> None:
    """Raises PecsOutputError."""
    out: dict[str, Any] = {"pecs_pixel_map": 1, "source": source, "region": found.region}
    for key in ("threshold_on", "threshold_off"):
        out[key] = [round(v, 4) for v in getattr(found, key).ravel().tolist()]
    if found.hot_pixels is not None:
        out["hot_pixels"] = found.hot_pixels
    write_json(path, out)


def write(found: Fitted, path: Path) -> None:
    """The profile, and a pixel map in NAME_pixels.json. Raises PecsOutputError."""
    profile = read(found.chip)
    files = ", ".join(Path(f).name for f in found.files)
    profile["description"] = f"fitted by pecs fit to {files}; starting profile: {profile['name']}"
    profile["name"] = path.stem
    for key in ("trade_names", "pixel_map"):
        profile.pop(key, None)
    if found.pixel_map:
        file = pixel_map_path(path)
        write_pixel_map(found.pixel_map, file, f"measured by pecs fit from {files}")
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
