"""Recordings of a DAVIS with frames: an AEDAT4 file, a ROS bag, or a folder with events.* and pictures, whose times are
in images.txt (Event Camera Dataset: "t_s file", an instant) or exposures.csv (frame, begin and end in us)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError, existing, optional_module, shown
from .._files import read_text
from ..events import Events, read
from ..ros import is_bag, read_bag, read_images

MAX_BYTES = 1 << 24  # of a table of times
LEAST_FRAMES = 4

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Davis:
    """A recording of a DAVIS with frames: a file or a folder."""

    file: str | Path


@dataclass(frozen=True)
class DavisEvents:
    """`frames`: [N, H, W], 0 to 1. `begin_us`, `end_us`: of each exposure; equal if only an instant is known."""

    name: str
    events: Events
    frames: NDArray[np.float32]
    begin_us: Floats
    end_us: Floats

    @property
    def shape(self) -> tuple[int, int]:
        return self.frames.shape[1], self.frames.shape[2]

    @property
    def period_us(self) -> float:
        return float(np.median(np.diff(self.begin_us)))


def load_davis(of: Davis) -> DavisEvents:
    """Raises PecsInputError for a recording without frames, or with frames of another size than the events."""
    path = existing(Path(of.file), "a recording")
    if is_bag(path):
        events, (pictures, begin_us) = read_bag(path, late="sort"), read_images(path)
        end_us = begin_us
    elif path.is_dir():
        events, pictures, begin_us, end_us = _folder(path)
    else:
        events, (pictures, begin_us, end_us) = read(path, late="sort"), _aedat4(path)
    if len(pictures) < LEAST_FRAMES or not len(events):
        got = f"{len(events)} events and {len(pictures)} frames"
        raise PecsInputError(f"{path}: got {got}, wanted events and at least {LEAST_FRAMES} frames")
    frames = np.stack([_grey(path, picture) for picture in pictures])
    size = events.width or int(events["x"].max()) + 1, events.height or int(events["y"].max()) + 1
    if frames.shape[:0:-1] != size and (events.width or (np.array(size) > frames.shape[:0:-1]).any()):
        got = f"frames of {frames.shape[2]}x{frames.shape[1]} pixels and events of {size[0]}x{size[1]}"
        raise PecsInputError(f"{path}: got {got}, wanted frames and events of the same pixels")
    if not ((np.diff(begin_us) > 0).all() and (end_us >= begin_us).all() and np.isfinite(end_us).all()):
        raise PecsInputError(f"{path}: got frames whose times do not rise, wanted rising ones")
    first_us, last_us = events["t"].min(), events["t"].max()
    if end_us[-1] < first_us or begin_us[0] > last_us:
        got = f"frames from {begin_us[0]:.0f} to {end_us[-1]:.0f} us and events from {first_us} to {last_us} us"
        raise PecsInputError(f"{path}: got {got}, wanted both at the same time (images.txt has seconds)")
    return DavisEvents(path.name, events, frames, begin_us, end_us)


def _grey(path: Path, picture: NDArray[Any]) -> NDArray[np.float32]:
    """0 to 1."""
    if picture.ndim == 3:
        if (picture != picture[..., :1]).any():
            raise PecsInputError(f"{path}: got frames in colours, wanted grey ones (values of the ADC)")
        picture = picture[..., 0]
    if picture.dtype.kind != "u":
        raise PecsInputError(f"{path}: got frames of {picture.dtype}, wanted 8 or 16 bits")
    return picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)


def _aedat4(path: Path) -> tuple[list[NDArray[Any]], Floats, Floats]:
    dv = optional_module("dv_processing", "dv-processing", "frames of AEDAT4", "aedat4")
    try:
        recording = dv.io.MonoCameraRecording(str(path))
        has_frames = recording.isFrameStreamAvailable()
    except RuntimeError:
        raise PecsInputError(f"{path}: got no recording with frames, wanted AEDAT4, a ROS bag or a folder") from None
    pictures, begin_us, length_us = [], [], []
    while has_frames and (frame := recording.getNextFrame()) is not None:
        pictures.append(np.array(frame.image))
        begin_us.append(frame.timestamp)
        length_us.append(frame.exposure.total_seconds() * 1e6)
    begin = np.array(begin_us, float)
    return pictures, begin, begin + np.array(length_us, float)


def _folder(path: Path) -> tuple[Events, list[NDArray[Any]], Floats, Floats]:
    files = sorted(path.glob("events.*"))
    files = [file for file in files if not file.name.endswith(".run.json")]
    if len(files) != 1:
        raise PecsInputError(f"{path}: got {len(files)} files events.*, wanted one")
    events = read(files[0], late="sort")
    for folder in (path, path / "frames"):
        names, times_us = _images(folder)
        exposures = sorted(folder.glob("exposures*.csv"))
        if exposures:
            table = _table(exposures[0], 3)
            names = names or _numbered(path, table[:, 0])
            if len(names) != len(table):
                raise PecsInputError(f"{exposures[0]}: got {len(table)} rows for {len(names)} frames, wanted as many")
            return events, _pictures(folder, path, names), table[:, 1], table[:, 2]
        if names:
            return events, _pictures(folder, path, names), times_us, times_us
    raise PecsInputError(f"{path}: got no times of frames, wanted images.txt or exposures.csv (frame,begin_us,end_us)")


def _images(folder: Path) -> tuple[list[str], Floats]:
    file = folder / "images.txt"
    if not file.is_file():
        return [], np.empty(0)
    rows = [line.split() for line in read_text(file, MAX_BYTES).splitlines() if line.strip() and line[0] != "#"]
    try:
        return [row[1] for row in rows], np.array([1e6 * float(row[0]) for row in rows])
    except (ValueError, IndexError):
        raise PecsInputError(f"{file}: got another line than a time in seconds and a file, wanted both") from None


def _table(file: Path, columns: int) -> Floats:
    header, *lines = read_text(file, MAX_BYTES).splitlines() or [""]
    if not all(name.strip().endswith("_us") for name in header.split(",")[1:]):  # another unit, or no header
        raise PecsInputError(f"{file}: got the header {shown(header)}, wanted frame,begin_us,end_us")
    try:
        table = np.array([[float(v) for v in line.split(",")] for line in lines if line.strip()])
    except ValueError:
        table = np.empty(0)
    if table.ndim != 2 or table.shape[1] != columns or not np.isfinite(table).all():
        raise PecsInputError(f"{file}: got no table of {columns} columns of numbers, wanted frame,begin_us,end_us")
    return table


def _numbered(path: Path, numbers: Floats) -> list[str]:
    """frames/0010.png of number 10."""
    have = {
        int(file.stem): f"frames/{file.name}" for file in sorted(path.glob("frames/*.png")) if file.stem.isdecimal()
    }
    missing = [int(n) for n in numbers if int(n) not in have]
    if missing:
        raise PecsInputError(f"{path}: got no frame {missing[0]}, wanted frames/{missing[0]:04}.png")
    return [have[int(n)] for n in numbers]


def _pictures(folder: Path, path: Path, names: list[str]) -> list[NDArray[Any]]:
    cv2 = optional_module("cv2", "OpenCV", "frames as PNG", "datasets")
    out = []
    for name in names:
        file = folder / name if (folder / name).is_file() else path / name
        picture = cv2.imread(str(existing(file, "a frame")), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise PecsInputError(f"{file}: got no picture, wanted PNG")
        out.append(picture)
    return out
