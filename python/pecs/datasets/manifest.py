"""Checksums: SEQUENCE/files.json, and SET/dataset.json over all sequences."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from .._config import Fields
from .._errors import PecsError, PecsOutputError, bad_input, existing, shown
from .._files import read_text, sha256, write_json
from .._library import version
from .._text import is_plain
from .files import MAX_BYTES, OWN, read_object
from .recipe import Recipe

SET = "dataset.json"
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


def _listed(folder: Path) -> dict[str, tuple[int, str]]:
    """files.json: size and SHA-256 by path. Raises PecsInputError."""
    fields = Fields(read_object(folder / OWN, "the checksums of a sequence"), folder / OWN)
    listed = {}
    for name, entry in fields.content.items():
        path = PurePosixPath(name)
        match entry:
            case [int(size), str(digest)] if not path.is_absolute() and ".." not in path.parts and is_plain(name):
                listed[name] = size, digest
            case _:
                raise fields.fail(shown(name), entry, "[bytes, SHA-256] of a file in the folder")
    return listed


def sealed(folder: Path, name: str) -> dict[str, Any]:
    """The top of a JSON file of a sequence, as seal() found it. Raises PecsInputError for a changed one."""
    if _listed(folder).get(name, (0, ""))[1] != sha256(existing(folder / name, "a file of a sequence")):
        raise bad_input(folder / name, "", "other content", f"that of {OWN} (--check lists changed files)")
    return read_object(folder / name, "a file of a sequence")


def sums(output: Path) -> dict[str, str]:
    """SHA-256 of each sequence's files.json by dataset.json; none before the set is complete. Raises
    PecsInputError."""
    path = output / SET
    if not path.exists():
        return {}
    rows = Fields(read_object(path, "the sequences of a set"), path).tables("sequences")
    return {row.text("name"): row.text("sha256") for row in rows}


def faults(folder: Path, digest: str | None = None) -> list[str]:
    """Lost, changed and added files since seal(), one line each. digest: of files.json, by `sums`."""
    try:
        listed = _listed(folder)
    except PecsError as e:
        return [str(e)]
    if digest and sha256(folder / OWN) != digest:
        return [f"{folder / OWN}: got other content, wanted SHA-256 {digest[:12]}… of {SET}"]
    found = [f"{path}: not listed in {OWN}" for path in _files(folder) if str(path.relative_to(folder)) not in listed]
    for name, (size, digest) in listed.items():
        path = folder / name
        if not path.is_file():
            found.append(f"{path}: no such file")
        elif path.stat().st_size != size:
            found.append(f"{path}: got {path.stat().st_size} bytes, wanted {size}")
        elif sha256(path) != digest:
            found.append(f"{path}: got other content, wanted SHA-256 {digest[:12]}…")
    return found


def check_count(recipe: Recipe, output: Path) -> None:
    """Raises PecsOutputError for a sequence beyond the recipe's number, which readers of the set would find."""
    for folder in sorted(sequence_folder(output, 0).parent.glob("*")):
        if folder.name.isdecimal() and int(folder.name) >= recipe.sequences:
            count = f"the recipe has {recipe.sequences} sequences"
            raise PecsOutputError(f"{folder}: {count}; remove the folder, or make the set in another folder")


def missing(recipe: Recipe, output: Path) -> list[int]:
    return [i for i in range(recipe.sequences) if not sequence_folder(output, i).is_dir()]


def _numbers(found: dict[str, Any]) -> dict[str, Any]:
    """The numbers of an event camera's checks by which a set is selected."""
    events, motion = found["events"], found.get("motion") or {}
    shares = ("noise_share", "render_noise_share", "camera_noise_share", "dropped_share")
    row = {"events": events["count"], "rate_per_pixel_hz": events["rate_per_pixel_hz"]}
    row |= {f"motion_{key}": value for key, value in motion.items()}
    return row | {key: events[key] for key in shares if key in events}


def write(recipe: Recipe, output: Path) -> dict[str, Any]:
    """Writes dataset.json; requires all sequences."""
    rows = []
    for index in range(recipe.sequences):
        folder = sequence_folder(output, index)
        info, checks = sealed(folder, "sequence.json"), sealed(folder, "checks.json")
        row = {key: info[key] for key in ("name", "split", "scene")} | {"sha256": sha256(folder / OWN)}
        row |= {"duration_s": info["duration_us"] * 1e-6, "speed_m_s": checks["motion"]["speed_median_m_s"]}
        row["cameras"] = {name: _numbers(found) for name, found in checks["cameras"].items() if "events" in found}
        rows.append(row | {"outside_limits": checks["outside_limits"]})
    manifest = {
        "format": 1,
        "name": recipe.name,
        "recipe": ABSOLUTE.sub(lambda path: f'"{Path(path[1]).name}"', read_text(recipe.path, MAX_BYTES)),
        "recipe_sha256": recipe.sha256,
        "about": recipe.about,
        "versions": {"pecs": version()},
        "sequences": rows,
    }
    write_json(output / SET, manifest)
    return manifest
