"""Checksums: SEQUENCE/files.json, and SET/dataset.json over all sequences."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .._files import sha256, write_json
from .._library import version
from .recipe import Recipe

OWN = "files.json"
ABSOLUTE = re.compile(r'"(/[^"\n]*)"')  # a path of this machine in a recipe
NOT_SUMMED = ".log"  # with times of day


def sequence_folder(output: Path, index: int) -> Path:
    return output / "sequences" / f"{index:04d}"


def _files(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name != OWN and not path.name.endswith(NOT_SUMMED):
            yield path


def seal(folder: Path) -> None:
    """Writes files.json: size and SHA-256 of every file."""
    write_json(folder / OWN, {str(p.relative_to(folder)): [p.stat().st_size, sha256(p)] for p in _files(folder)})


def faults(folder: Path) -> list[str]:
    """Lost or changed files since seal(), one line each."""
    try:
        listed: dict[str, tuple[int, str]] = json.loads((folder / OWN).read_text())
    except (OSError, ValueError) as e:
        return [f"{folder / OWN}: {e}"]
    found = []
    for name, (size, digest) in listed.items():
        path = folder / name
        if not path.is_file():
            found.append(f"{path}: no such file")
        elif path.stat().st_size != size:
            found.append(f"{path}: got {path.stat().st_size} bytes, wanted {size}")
        elif sha256(path) != digest:
            found.append(f"{path}: got other content, wanted SHA-256 {digest[:12]}…")
    return found


def missing(recipe: Recipe, output: Path) -> list[int]:
    return [i for i in range(recipe.sequences) if not sequence_folder(output, i).is_dir()]


def write(recipe: Recipe, output: Path) -> dict[str, Any]:
    """Writes dataset.json; requires all sequences."""
    rows = []
    for index in range(recipe.sequences):
        folder = sequence_folder(output, index)
        info = json.loads((folder / "sequence.json").read_text())
        checks = json.loads((folder / "checks.json").read_text())
        row = {key: info[key] for key in ("name", "split", "scene")} | {"sha256": sha256(folder / OWN)}
        rows.append(row | {"outside_limits": checks["outside_limits"]})
    manifest = {
        "format": 1,
        "name": recipe.name,
        "recipe": ABSOLUTE.sub(lambda path: f'"{Path(path[1]).name}"', recipe.path.read_text()),
        "recipe_sha256": recipe.sha256,
        "about": recipe.about,
        "versions": {"pecs": version()},
        "sequences": rows,
    }
    write_json(output / "dataset.json", manifest)
    return manifest
