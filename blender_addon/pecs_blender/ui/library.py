# SPDX-License-Identifier: GPL-3.0-or-later
"""Lenses, chips, spectra and glasses to choose from, those of PECS and the user's own; and what their files say."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ..render.chip import Chip, load_chip
from .preferences import own_folder

_ROOMS = {"lens": "lens_data/lenses", "chip": "sensor/chips"}
SCENES_CAMERA = "none"  # instead of a lens


def names(kind: str) -> list[tuple[str, str]]:
    """Each with what its file says it is. kind: "lens" or "chip"."""
    import pecs

    own = own_folder(kind)
    folders = [pecs.data_dir(_ROOMS[kind]), *([own] if own else [])]
    files = {path.stem: path for folder in folders for path in folder.glob("*.json")}
    return [(name, _said(path, path.stat().st_mtime_ns)) for name, path in sorted(files.items())]


@lru_cache(maxsize=256)
def _said(path: Path, _version: int) -> str:
    try:
        said = json.loads(path.read_text(errors="replace"))
        return str(said.get("description") or said.get("name", ""))
    except (OSError, ValueError, AttributeError):  # chosen, checks.py says what is wrong with it
        return ""


@lru_cache
def _stems(room: str, pattern: str = "*.json") -> list[str]:
    import pecs

    folder = pecs.data_dir(room)
    return sorted(path.relative_to(folder).with_suffix("").as_posix() for path in folder.glob(pattern))


def spectra() -> list[str]:
    named = [*_stems("lens_data/spectra", "*.csv"), *_stems("lens_data/spectra", "colorchecker/*.csv")]
    return [*named, "blackbody:2856", "daylight:6500"]


def glasses() -> list[str]:
    return sorted(name.rpartition("/")[2] for name in _stems("lens_data/glasses", "*/*.json"))


def lenses(film_mm: tuple[float, float] | None) -> list[tuple[str, str]]:
    """`names`, with the field of view on a film of that width and height. The first time takes half a second."""
    return [(name, ", ".join(filter(None, (said, _field(name, film_mm))))) for name, said in names("lens")]


def _field(name: str, film_mm: tuple[float, float] | None) -> str:
    if not film_mm:
        return ""
    try:
        info = lens_info(name, film_width_mm=film_mm[0], film_height_mm=film_mm[1], field_rows=2)
    except RuntimeError:  # chosen, checks.py says what is wrong with it
        return ""
    return f"{info['hfov_deg']:.3g}° x {info['vfov_deg']:.3g}°"


def search(names_of: Callable[[], Iterable[str | tuple[str, str]]]) -> Callable[..., list]:
    """Of a StringProperty: names, or names with a text beside them, which is looked through, too."""

    def found(_self, _context, text: str) -> list:
        return [one for one in names_of() if text.lower() in " ".join([one] if isinstance(one, str) else one).lower()]

    return found


def find(kind: str, name: str) -> str:
    """What the program takes: a path of the user's own, or a name of the library."""
    if name.endswith(".json") or name.startswith("//"):
        return bpy.path.abspath(name)
    own = own_folder(kind)
    return str(own / f"{name}.json") if own and (own / f"{name}.json").is_file() else name


def chip(name: str) -> Chip:
    """Raises pecs.PecsError."""
    return _chip(*version("chip", name))


def lens_info(name: str, **setting: float | int | None) -> dict[str, Any]:
    """As pecs.Lens.info; raises pecs.PecsError."""
    return _lens_info(*version("lens", name), tuple(sorted(setting.items())))


def version(kind: str, name: str) -> tuple[str, int]:
    """A file that has changed, or has gone, is read anew."""
    path = find(kind, name)
    try:
        return path, Path(path).stat().st_mtime_ns
    except OSError:
        return path, 0


@lru_cache(maxsize=16)
def _chip(path: str, _version: int) -> Chip:
    return load_chip(path)


@lru_cache(maxsize=64)
def _lens_info(path: str, _version: int, setting: tuple) -> dict[str, Any]:
    import pecs

    with pecs.Lens(path) as lens:
        return lens.info(**dict(setting))
