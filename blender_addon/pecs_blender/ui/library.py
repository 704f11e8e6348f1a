# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists of lenses, chips, spectra and glasses, of PECS and of the user; cached data of lens and chip files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import bpy
import pecs

from . import disk
from .preferences import own_folder

_FOLDERS = {"lens": "lens_data/lenses", "chip": "sensor/chips"}
FILES = {"lens": (".json", ".zmx", ".dat"), "chip": (".json",)}
SCENES_CAMERA = "none"  # value of the lens setting for the scene's own camera


@cache
def _shipped(kind: str) -> Path:
    return pecs.data_dir(_FOLDERS[kind])


def names(kind: str) -> list[tuple[str, str]]:
    """Names and descriptions. kind: "lens" or "chip"."""
    own = own_folder(kind)
    folders = [_shipped(kind), *([own] if own else [])]
    found = (path for folder in folders for path in folder.glob("*") if path.suffix in FILES[kind])
    files = {path.stem if path.suffix == ".json" else path.name: path for path in found}
    return [(name, _description(path, path.stat().st_mtime_ns)) for name, path in sorted(files.items())]


def title(kind: str, name: str) -> str:
    """The name that the maker gives it: a lens file's name, the start of a chip's description, or the file's name."""
    path, when = version(kind, name)
    text = _description(Path(path) if when else _shipped(kind) / f"{name}.json", when)
    return (text if kind == "lens" else re.split("[,;:(]", text)[0].strip()) or Path(name).stem


@lru_cache(maxsize=256)
def _description(path: Path, _version: int) -> str:
    try:
        content = json.loads(path.read_text(encoding="utf-8", errors="replace"))
        return str(content.get("description") or content.get("name", ""))
    except (OSError, ValueError, AttributeError):  # checks.py reports the error if this one is chosen
        return ""


@lru_cache
def _stems(folder: str, pattern: str = "*.json") -> list[str]:
    folder = pecs.data_dir(folder)
    return sorted(path.relative_to(folder).with_suffix("").as_posix() for path in folder.glob(pattern))


def spectra() -> list[str]:
    named = [*_stems("lens_data/spectra", "*.csv"), *_stems("lens_data/spectra", "colorchecker/*.csv")]
    return [*named, "blackbody:2856", "daylight:6500"]


def glasses() -> list[str]:
    return sorted(name.rpartition("/")[2] for name in _stems("lens_data/glasses", "*/*.json"))


def lenses(film_mm: tuple[float, float] | None) -> list[tuple[str, str]]:
    """`names` of lenses with the field of view on a film of this width and height. The first call takes 0.5 s."""
    return [(name, ", ".join(filter(None, (text, _field(name, film_mm))))) for name, text in names("lens")]


def _field(name: str, film_mm: tuple[float, float] | None) -> str:
    if not film_mm:
        return ""
    try:
        info = lens_info(name, film_width_mm=film_mm[0], film_height_mm=film_mm[1], field_rows=2)
    except RuntimeError:  # checks.py reports the error if this one is chosen
        return ""
    return f"{info['hfov_deg']:.3g}° x {info['vfov_deg']:.3g}°"


def search(names_of: Callable[[], Iterable[str | tuple[str, str]]]) -> Callable[..., list]:
    """Search callback of a StringProperty, over names or pairs of name and description; searches both."""

    def matching(_self, _context, text: str) -> list:
        return [one for one in names_of() if text.lower() in " ".join([one] if isinstance(one, str) else one).lower()]

    return matching


def find(kind: str, name: str) -> str:
    """Argument for the program: a path of the user's file, or a name of the library."""
    if name.endswith(".json") or name.startswith("//"):
        return bpy.path.abspath(name)
    own = own_folder(kind)
    files = [own / f"{name}.json", own / name] if own and name else []
    return str(next((file for file in files if disk.is_file(file)), name))


def chip(name: str) -> pecs.Chip:
    """Raises pecs.PecsError."""
    return _chip(*version("chip", name))


def sensor_error(name: str, size: tuple[int, int], options: dict[str, Any], mask: int) -> str:
    """The error of pecs.Sensor with a chip and these options; empty if it can be made. mask: time of its mask file."""
    return _sensor_error(*version("chip", name), size, json.dumps(options), mask)


@lru_cache(maxsize=64)
def _sensor_error(path: str, _version: int, size: tuple[int, int], options: str, _mask: int) -> str:
    try:
        with pecs.Sensor(*size, path, **json.loads(options)):
            return ""
    except RuntimeError as e:
        return str(e)


def lens_info(name: str, **setting: float | int | None) -> dict[str, Any]:
    """As pecs.Lens.info; raises pecs.PecsError."""
    return _lens_info(*version("lens", name), tuple(sorted(setting.items())))


def version(kind: str, name: str) -> tuple[str, int]:
    """Path and modification time: the cache key of a file. 0 if it does not exist."""
    path = find(kind, name)
    return path, disk.modified_ns(path)


@lru_cache(maxsize=16)
def _chip(path: str, _version: int) -> pecs.Chip:
    return pecs.Chip(path)


@lru_cache(maxsize=64)
def _lens_info(path: str, _version: int, setting: tuple) -> dict[str, Any]:
    with pecs.Lens(path) as lens:
        return lens.info(**dict(setting))
