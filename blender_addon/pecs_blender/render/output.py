# SPDX-License-Identifier: GPL-3.0-or-later
"""The stack that a render writes: begun, continued or begun anew, by one process per frame."""

from __future__ import annotations

import fcntl
import itertools
import json
import re
from pathlib import Path

import numpy as np

from . import objects_json
from .errors import BAD_OUTPUT, RenderError


def as_written(light: np.ndarray) -> np.ndarray:
    """As it is read back: 12 bits of the mantissa, to nearest even (docs/reference/exr_stack.md)."""
    bits = np.ascontiguousarray(light, np.float32).view(np.uint32)
    rounded = ((bits + 0x3FF + ((bits >> 11) & 1)) & ~np.uint32(0x7FF)).view(np.float32)
    return np.where(np.isfinite(light), rounded, light)


class Output:
    """Opens the stack, and locks those of its frames that this process renders (`only`; all if None). exists: what to
    do with one that is there: "continue", "overwrite", or "new", which takes the next name, folder_002 and so on, that
    is free or this very stack's."""

    def __init__(self, folder: Path, stack: dict, only: slice | None, exists: str = "continue"):
        import pecs

        if exists == "new":
            folder = _next(folder, stack)
        self.folder, self._only = folder, only or slice(0, len(stack["times_ns"]))
        json_path = folder / "stack.json"
        if exists == "overwrite" and json_path.is_file():
            with self._locked(json_path, slice(0, 0)):  # 0: all, to the file's end
                _remove_stack(folder)
        try:
            self._writer = pecs.StackWriter(folder, stack)
        except pecs.PecsError as e:
            hint = "; --overwrite begins the stack anew, --new-version another beside it" if json_path.is_file() else ""
            raise RenderError(e.code, f"{e}{hint}") from None
        self._lock = self._locked(json_path, self._only)
        self.write_layer, self.write_between = self._writer.write_layer, self._writer.write_between
        self._times_ns = stack["times_ns"]
        self._has_objects = any(entry["name"] == objects_json.LAYER for entry in stack.get("layers", ()))

    def has_layer(self, name: str, index: int) -> bool:
        beside = name != objects_json.LAYER or objects_json.one(self.folder, index).is_file()
        return beside and self._writer.has_layer(name, index)

    def write_objects(self, index: int, described: dict) -> None:
        """Before their layer."""
        objects_json.write_json(objects_json.one(self.folder, index), described)

    def read_layer(self, name: str, index: int) -> np.ndarray:
        import pecs

        with pecs.StackReader(self.folder) as stack:
            return stack.read_layer(name, index)

    def _locked(self, path: Path, frames: slice):
        """Byte i of stack.json stands for frame i: a lock may lie beyond a file's end, and dies with its process."""
        file = path.open("r+b")
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, frames.stop - frames.start, frames.start)
        except BlockingIOError:
            file.close()
            raise RenderError(
                BAD_OUTPUT,
                f"{self.folder}: got another process that renders these frames, wanted a folder of its own, "
                "or other frames (--only)",
            ) from None
        except OSError:  # a file system without locks
            pass
        return file

    def __enter__(self) -> Output:
        return self

    def __exit__(self, failed: object, *_: object) -> None:
        if self._has_objects and not failed:
            objects_json.join(self.folder, self._times_ns)
        self._lock.close()
        self._writer.close()


def _next(folder: Path, stack: dict) -> Path:
    this = json.loads(json.dumps(stack))
    for number in itertools.count(1):
        one = folder if number == 1 else folder.with_name(f"{folder.stem}_{number:03}{folder.suffix}")
        try:
            if json.loads((one / "stack.json").read_text()) == this:
                return one
        except ValueError:  # somebody else's
            continue
        except OSError:  # free; or the writer says what is wrong
            return one


def _remove_stack(folder: Path) -> None:
    for path in folder.iterdir():
        if re.fullmatch(r"[A-Za-z0-9_-]+_\d{6,}\.exr|objects(_\d{6,})?\.json", path.name):
            path.unlink()
    (folder / "stack.json").unlink()
