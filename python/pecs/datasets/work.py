"""A sequence that is being made: its folder and lock, and the request that it is made from."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from .._errors import PecsOutputError
from .._files import lock_file, sha256, write_json
from .._library import version
from .files import read_object
from .manifest import sequence_folder
from .plan import SequencePlan

REQUEST = "drawn.json"
RUNS = "runs.log"  # when each process began to work on the sequence, in seconds since 1970


class Busy(PecsOutputError):
    """Another process is making the sequence."""


@dataclass(frozen=True)
class Work:
    """A sequence being made. folder: SET/sequences/NNNN.partial. say(step) reports a step, say(step, progress) how far
    it is."""

    plan: SequencePlan
    folder: Path
    say: Callable[..., None]


@contextmanager
def sequence_work(plan: SequencePlan, output: Path, say: Callable[..., None]) -> Iterator[Work | None]:
    """The work on a sequence of output/sequences, for this process alone; None if the sequence exists. The folder
    gets its name when the block ends without an exception, while the lock is still held. Raises Busy, and
    PecsOutputError if the sequence was begun or made from another request."""
    final = sequence_folder(output, plan.index)
    work = Work(plan, final.with_name(f"{final.name}.partial"), say)
    if not final.is_dir():
        final.parent.mkdir(parents=True, exist_ok=True)
        with locked(work.folder):
            if not final.is_dir():  # may have appeared before the lock was taken
                work.folder.mkdir(exist_ok=True)
                now = request(plan)
                _compare(work.folder, now, finished=False)
                write_json(work.folder / REQUEST, now)
                with (work.folder / RUNS).open("a") as runs:
                    runs.write(f"{time.time():.3f}\n")
                yield work
                work.folder.rename(final)
                return
    _compare(final, request(plan), finished=True)
    yield None


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Holds FOLDER's lock file."""
    busy = Busy(f"{folder}: another process is making this sequence")
    with lock_file(folder.parent / f".{folder.name}.lock", folder, busy):
        yield


def request(plan: SequencePlan) -> dict[str, Any]:
    """Everything that determines a sequence: drawn values, options, the content of its files, and versions."""
    recipe = plan.recipe
    decides = {
        "seed": recipe.seed,
        "drawn": plan.drawn,
        "scene": plan.scene.options,
        "cameras": recipe.cameras,
        "imu": recipe.imu,
        "limits": recipe.limits,
        "render": recipe.render | recipe.permission,
        "truth": recipe.truth,
        "files": _sums(plan.files),
        "versions": {"pecs": version(), "bpy": _bpy_version(os.environ.get("PECS_BLENDER_PYTHON", sys.executable))},
    }
    found: dict[str, Any] = portable(json.loads(json.dumps(decides, default=_finite, allow_nan=False)))
    return found


def _finite(entry: Any) -> dict[str, Any]:
    """Fields of a dataclass; JSON has no infinite limits."""
    return {key: value for key, value in vars(entry).items() if value not in (math.inf, -math.inf)}


def portable(value: Any) -> Any:
    """JSON without folders of this machine: absolute paths become names."""
    if isinstance(value, dict):
        return {portable(key): portable(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [portable(entry) for entry in value]
    return Path(value).name if isinstance(value, str) and value.startswith("/") else value


def _sums(files: dict[str, Path]) -> dict[str, Any]:
    """SHA-256 by portable name; a list, by the full names' order, of files that have one portable name."""
    sums: dict[str, list[str]] = {}
    for name, path in sorted(files.items()):
        sums.setdefault(portable(name), []).append(content_sha256(path))
    return {name: found if len(found) > 1 else found[0] for name, found in sums.items()}


def content_sha256(path: Path) -> str:
    """Digest of a file, or of all files of a folder with their names; without what Python compiles."""
    if path.is_file():
        return _file_sha256(path, path.stat().st_mtime_ns)
    digest = hashlib.sha256()
    for file in sorted(p for p in path.rglob("*") if p.is_file() and p.parent.name != "__pycache__"):
        digest.update(f"{file.relative_to(path)}\0{_file_sha256(file, file.stat().st_mtime_ns)}\0".encode())
    return digest.hexdigest()


@cache
def _file_sha256(path: Path, changed_ns: int) -> str:
    return sha256(path)


@cache
def _bpy_version(python: str) -> str | None:
    """Version of the module bpy of a Python."""
    if python != sys.executable:
        code = "import importlib.metadata as m; print(m.version('bpy'))"
        done = subprocess.run([python, "-c", code], capture_output=True, text=True)
        return done.stdout.strip() or None
    try:
        return importlib.metadata.version("bpy")
    except importlib.metadata.PackageNotFoundError:
        return None


def _compare(folder: Path, now: dict[str, Any], finished: bool) -> None:
    """Raises PecsOutputError if the folder was begun or made from another request. A finished sequence may be of an
    older version."""
    if not (folder / REQUEST).exists():
        return
    before = read_object(folder / REQUEST, "what a sequence is made from")
    for key in now:
        if before.get(key) != now[key] and not (finished and key == "versions"):
            what = _difference(before.get(key), now[key])
            changed = f"{key}{what} changed since it was {'made' if finished else 'begun'}"
            raise PecsOutputError(f"{folder}: {changed}; restore it, or make the set in another folder")


def _difference(before: Any, now: Any) -> str:
    """(NAMES), the keys that differ."""
    if not isinstance(before, dict) or not isinstance(now, dict):
        return ""
    return f" ({', '.join(sorted(k for k in before | now if before.get(k) != now.get(k)))})"
