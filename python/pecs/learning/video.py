"""Pictures of a reconstruction: [H, W] in, MP4 or PNG out."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsOutputError, optional_module
from .._files import PartialFile, lock_file, whole_folder, write_whole
from .._pages import png_bytes

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
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # errors are one line, and it is ours
        cv2 = optional_module("cv2", "opencv-python-headless", "writing video", "learning")
        if hasattr(cv2, "setLogLevel"):
            cv2.setLogLevel(0)
        # OpenCV chooses the format by the extension, and opens a file by its name; .NAME.partial.mp4 is ours as well.
        with PartialFile(self.path) as output, ExitStack() as held:
            unfinished = output.path.with_name(f".{output.path.stem}.partial.mp4")
            held.enter_context(lock_file(unfinished, self.path))
            video = cv2.VideoWriter(str(unfinished), cv2.VideoWriter_fourcc(*"mp4v"), self._fps, self._size)
            try:
                if not video.isOpened():
                    what = f"{self._size[0]} x {self._size[1]} pixels at {self._fps:g} pictures per second"
                    raise PecsOutputError(
                        f"{self.path}: cannot be written: no video encoder could be opened for {what}"
                    )
                yield lambda picture: video.write(np.repeat(picture[..., None], 3, axis=2))
                video.release()
                self._check(cv2, unfinished)
                output.commit(unfinished)
            finally:
                video.release()
                unfinished.unlink(missing_ok=True)

    def _check(self, cv2: Any, unfinished: Path) -> None:
        """OpenCV reports neither a full disk nor a picture of another size."""
        video = cv2.VideoCapture(str(unfinished))
        size = tuple(int(video.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        count = 0
        while video.grab():
            count += 1
        video.release()
        wanted = tuple(n // 2 * 2 for n in self._size)  # the encoder cuts off an odd row or column
        if (size, count) != (wanted, self.count):
            got = f"got {count} readable pictures of {size[0]} x {size[1]}"
            why = f"{got}, wanted {self.count} of {wanted[0]} x {wanted[1]} (disk full?)"
            raise PecsOutputError(f"{self.path}: cannot be written: {why}")
