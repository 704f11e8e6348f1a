"""Files that appear whole or not at all, with the same bytes for the same content."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from .._library import PecsOutputError


def write_whole(path: Path, content: bytes) -> None:
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as e:
        raise PecsOutputError(f"{e.filename or path}: cannot be written: {e.strerror}", 5) from None


def write_json(path: Path, value: Any) -> None:
    write_whole(path, (json.dumps(value, indent=1) + "\n").encode())


def write_text(path: Path, text: str) -> None:
    write_whole(path, text.encode())


def write_array(path: Path, array: np.ndarray[Any, Any]) -> None:
    """NPY."""
    out = io.BytesIO()
    np.save(out, np.ascontiguousarray(array), allow_pickle=False)
    write_whole(path, out.getvalue())
