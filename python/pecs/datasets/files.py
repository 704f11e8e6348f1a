"""Files that appear whole or not at all, with the same bytes for the same content; arrays and pictures as bytes."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._library import PecsInputError, PecsOutputError
from ._check import library


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


def npy_bytes(array: NDArray[Any]) -> bytes:
    out = io.BytesIO()
    np.save(out, array, allow_pickle=False)
    return out.getvalue()


def png_bytes(picture: NDArray[Any], level: int | None = None) -> bytes:
    """uint8 or uint16, [H, W] or [H, W, 3] RGB. level: of compression, OpenCV's own if None."""
    cv2 = library("cv2", "opencv-python-headless", "writing pictures")
    options = [] if level is None else [cv2.IMWRITE_PNG_COMPRESSION, level]
    ok, data = cv2.imencode(".png", picture[..., ::-1] if picture.ndim == 3 else picture, options)
    assert ok
    return bytes(data)


def read_picture(path: Path) -> NDArray[np.uint8]:
    """[H, W, 3] RGB, 8 bit."""
    cv2 = library("cv2", "opencv-python-headless", "reading pictures")
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise PecsInputError(f"{path}: got no picture that can be read, wanted PNG", 4)
    return np.asarray(picture[..., ::-1])
