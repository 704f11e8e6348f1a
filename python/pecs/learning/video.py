"""Pictures of a reconstruction: [H, W] in, MP4 or PNG out."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsOutputError, optional_module
from .._files import write_whole
from ..datasets.files import png_bytes

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
    """`NAME.mp4`, or a folder of PNG. It gets its name when the `with` block ends without an exception."""

    def __init__(self, path: Path, width: int, height: int, fps: float):
        self.path, self.count = path, 0
        self._video: Any = None
        if path.suffix.lower() == ".mp4":
            cv2 = optional_module("cv2", "opencv-python-headless", "writing video", "learning")
            self._partial = path.with_name(f"{path.stem}.partial.mp4")  # OpenCV derives the format from the extension
            self._video = cv2.VideoWriter(str(self._partial), cv2.VideoWriter_fourcc(*"mp4v"), fps, (width, height))
            if not self._video.isOpened():
                raise PecsOutputError(f"{path}: cannot be written")
        elif path.suffix:
            raise PecsOutputError(f"{path}: got {path.suffix}, wanted .mp4, or a folder for PNG")
        else:
            if path.exists():
                raise PecsOutputError(f"{path}: exists")
            self._partial = path.with_name(f"{path.name}.partial")
            shutil.rmtree(self._partial, ignore_errors=True)

    def write(self, picture: NDArray[np.uint8]) -> None:
        """[H, W]."""
        if self._video is not None:
            self._video.write(np.repeat(picture[..., None], 3, axis=2))
        else:
            write_whole(self._partial / f"{self.count:06d}.png", png_bytes(picture))
        self.count += 1

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._video is not None:
            self._video.release()
            if not self.count:
                self._partial.unlink(missing_ok=True)
        if kind is None:
            try:
                self._partial.replace(self.path)
            except OSError as e:
                raise PecsOutputError(f"{self.path}: cannot be written: {e.strerror}") from None
