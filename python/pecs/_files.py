"""Whole files: read as text of a bounded size, written under a temporary name and renamed when complete."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from ._errors import PecsNotFoundError, PecsOutputError, bad_input


def read_text(path: Path, max_bytes: int, wanted: str = "text") -> str:
    """UTF-8 text. `wanted` names the expected content in errors."""
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as e:
        raise PecsNotFoundError(f"{path}: {e.strerror or e}") from None
    if len(data) > max_bytes:
        raise bad_input(path, "", f"more than {max_bytes} bytes", "a smaller file")
    try:
        return data.decode()
    except UnicodeDecodeError as e:
        raise bad_input(path, f"byte {e.start}", "invalid UTF-8", f"{wanted} in UTF-8") from None


def existing_folder(path: Path) -> Path:
    """The path, or the nearest folder above it that exists."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


def sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


@contextmanager
def whole(path: Path) -> Iterator[BinaryIO]:
    """Opens a file for writing. It gets its name when the block ends without an exception and all data are on disk;
    otherwise the temporary file is removed. Creates the folder. Raises PecsOutputError."""
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with partial.open("wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as e:
        raise PecsOutputError(f"{e.filename or path}: cannot be written: {e.strerror or e}") from None


def write_whole(path: Path, content: bytes) -> None:
    with whole(path) as file:
        file.write(content)


def write_text(path: Path, text: str) -> None:
    write_whole(path, text.encode())


def write_json(path: Path, value: Any) -> None:
    write_text(path, json.dumps(value, indent=1) + "\n")
