# SPDX-License-Identifier: GPL-3.0-or-later
"""The stack that a render writes: new, continued or overwritten, each frame by one process; and its layers."""

from __future__ import annotations

import itertools
import json
import re
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pecs
from pecs._errors import PecsError, PecsOutputError
from pecs._platform import lock_bytes


def as_written(light: np.ndarray) -> np.ndarray:
    """Light as it is read back: 12 bits of the mantissa, rounded to nearest even (docs/reference/exr_stack.md)."""
    bits = np.ascontiguousarray(light, np.float32).view(np.uint32)
    rounded = ((bits + 0x3FF + ((bits >> 11) & 1)) & ~np.uint32(0x7FF)).view(np.float32)
    return np.where(np.isfinite(light), rounded, light)


class Output:
    """Opens the stack in `folder` and locks the frames that this process renders (`only`; None: all). overwrite:
    removes an existing stack first."""

    def __init__(self, folder: Path, stack: dict[str, Any], only: slice | None, overwrite: bool):
        self.folder = folder
        json_path = folder / "stack.json"
        if overwrite and json_path.is_file():
            with self._locked(json_path, slice(0, 0)):
                _remove_stack(folder)
        try:
            self._writer = pecs.StackWriter(folder, stack)
        except pecs.PecsError as e:
            hint = "; --overwrite replaces the stack, --new-version writes one with the next free name"
            edited = " (the scene was edited)" if "content_sha256" in str(e) else ""
            raise PecsError(f"{e}{edited}{hint if json_path.is_file() else ''}", e.code) from None
        self._lock = self._locked(json_path, only or slice(0, len(stack["times_ns"])))
        self.has_layer, self.write_layer = self._writer.has_layer, self._writer.write_layer
        self.write_between = self._writer.write_between
        self.times_ns: list[int] = stack["times_ns"]

    def _locked(self, path: Path, frames: slice) -> BinaryIO:
        """stack.json, open and locked. Byte i stands for frame i; slice(0, 0): all bytes."""
        file = path.open("r+b")
        if not lock_bytes(file.fileno(), frames.start, frames.stop - frames.start):
            file.close()
            raise PecsOutputError(
                f"{self.folder}: another process renders these frames; use another folder, or other frames (--only)"
            )
        return file

    def __enter__(self) -> Output:
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()
        self._writer.close()


class Layer(ABC):
    """A picture for each instant (`at` is "instant") or for each interval between neighbouring instants ("interval").
    name, channels, unit: as stack.json lists them."""

    name: str
    channels: tuple[str, ...]
    unit: str
    at: str

    @abstractmethod
    def render(self, *t_s: float) -> np.ndarray:
        """[channels, height, width] of the instant t_s, to which the scene has been moved; or of the interval between
        two times, over which this method moves the scene."""

    def is_written(self, output: Output, index: int) -> bool:
        return output.has_layer(self.name, index)

    def write(self, output: Output, index: int, *t_s: float) -> None:
        output.write_layer(self.name, index, self.render(*t_s))

    def finish(self, output: Output) -> None:  # noqa: B027 (most layers have nothing to do)
        """Called when all frames of this process are written."""

    @classmethod
    def entry(cls) -> dict[str, Any]:
        """The layer in stack.json."""
        files = f"{cls.name}_%06d.exr"
        return {"name": cls.name, "files": files, "channels": list(cls.channels), "unit": cls.unit, "at": cls.at}


def free_folder(folder: Path, stack: dict[str, Any]) -> Path:
    """`folder`, folder_002, …: the first that does not exist or contains this very stack."""
    for number in itertools.count(1):
        one = folder if number == 1 else folder.with_name(f"{folder.stem}_{number:03}{folder.suffix}")
        if not (one / "stack.json").is_file() or is_stack(one, stack):  # if not free, the writer reports it
            return one


def is_stack(folder: Path, stack: dict[str, Any]) -> bool:
    """Whether the folder contains this very stack."""
    try:
        return bool(json.loads((folder / "stack.json").read_bytes()) == json.loads(json.dumps(stack)))
    except (OSError, ValueError):  # none of PECS
        return False


def _remove_stack(folder: Path) -> None:
    for path in folder.iterdir():
        if re.fullmatch(r"[A-Za-z0-9_-]+_\d{6,}\.exr|objects(_\d{6,})?\.json", path.name):
            path.unlink()
    (folder / "stack.json").unlink()
