"""Pictures of a reconstruction: [H, W] in, MP4 or PNG out."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import KINDS, PecsError, PecsNotFoundError, PecsOutputError
from .._files import whole_folder, write_whole
from .._pages import png_bytes
from .._program import program

LOW, HIGH = 1.0, 99.0  # percentiles that become black and white
FOLLOW = 0.2  # weight of a new picture in the moving average of the range


class Range:
    """Scales values of any range to 0 … 1. The range is a moving average, so that a video does not flicker."""

    def __init__(self) -> None:
        self._ends: NDArray[np.float64] | None = None

    def __call__(self, picture: NDArray[Any]) -> NDArray[np.float64]:
        now = np.percentile(picture, (LOW, HIGH))
        self._ends = now if self._ends is None else (1 - FOLLOW) * self._ends + FOLLOW * now
        low, high = self._ends
        return np.clip((picture - low) / max(high - low, 1e-9), 0, 1)


class VideoWriter:
    """`NAME.mp4`, or a folder of PNG. It gets its name when the `with` block ends without an exception, and what was
    written can be read."""

    def __init__(self, path: Path, width: int, height: int, fps: float):
        self.path, self.count = path, 0
        self._size, self._fps = (width, height), fps
        self._open = ExitStack()

    def write(self, picture: NDArray[np.uint8]) -> None:
        """[H, W]."""
        self._write(picture)
        self.count += 1

    def __enter__(self) -> VideoWriter:
        self._write = self._open.enter_context(self._video() if self.path.suffix else self._folder())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)

    @contextmanager
    def _folder(self) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
        with whole_folder(self.path) as partial:
            yield lambda picture: write_whole(partial / f"{self.count:06d}.png", png_bytes(picture))

    @contextmanager
    def _video(self) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
        if self.path.suffix.lower() != ".mp4":
            raise PecsOutputError(f"{self.path}: got {self.path.suffix}, wanted .mp4, or a folder for PNG")
        try:
            command = [program(), "video", "-o", self.path]
        except FileNotFoundError as e:
            raise PecsNotFoundError(f"{self.path}: MP4 requires the program pecs: {e}") from None
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        assert child.stdin and child.stderr
        try:
            child.stdin.write(f"{self._size[0]} {self._size[1]} {self._fps:.17g}\n".encode())
            yield lambda picture: child.stdin.writelines((b"P", np.ascontiguousarray(picture)))
            child.stdin.write(b"E")  # without it, the program writes no file
        except BrokenPipeError:  # the program has ended; its error follows
            pass
        finally:
            with suppress(BrokenPipeError):
                child.stdin.close()
            error = child.stderr.read().decode(errors="replace").strip().removeprefix("pecs: ")
            child.stderr.close()
            child.wait()
        if child.returncode:
            raise KINDS.get(child.returncode, PecsError)(error.removeprefix("video: "), child.returncode)
