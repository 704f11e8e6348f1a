# SPDX-License-Identifier: GPL-3.0-or-later
"""Files: read as text of a bounded size, written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import NOT_FOUND, RenderError, bad_input


def read_text(path: Path, max_bytes: int, wanted: str) -> str:
    """wanted: what it shall hold, for errors."""
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as e:
        raise RenderError(NOT_FOUND, f"{path}: {e.strerror or e}") from None
    if len(data) > max_bytes:
        raise bad_input(path, "", f"more than {max_bytes} bytes", "a smaller file")
    try:
        return data.decode()
    except UnicodeDecodeError as e:
        raise bad_input(path, f"byte {e.start}", "no UTF-8", f"{wanted} in UTF-8") from None


@contextmanager
def whole(path: Path) -> Iterator[BinaryIO]:
    """To write into; the file gets its name when all is on the disk, and nothing stays behind of one that fails."""
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
