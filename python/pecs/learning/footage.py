"""Events with pictures of the same pixels, in the layouts of others: what a reconstruction is compared with.

EVREAL (Ercan et al., CVPRW 2023), as `pecs.datasets.writers.evreal` writes it:
    events_ts.npy [n] s, events_xy.npy [n, 2], events_p.npy [n], images.npy u1 [N, H, W(, 1)], images_ts.npy [N(, 1)] s
HS-ERGB (Tulyakov et al., CVPR 2021):
    events_aligned/*.npz: x, y (whole numbers count 1/32 px), t or timestamp us, p or polarity
    images_corrected/*.png, and timestamp.txt there: a line of us for each; more pictures than lines are left out
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError, bad_input
from ..datasets.files import load, read_numbers, read_picture
from ..datasets.writers._files import grey
from ..events import EVENT_DTYPE
from .reconstruct import Window

SUBPIXELS = 32  # per pixel, in the integer coordinates of HS-ERGB
HS_ERGB_KEYS = ("t", "timestamp"), ("x",), ("y",), ("p", "polarity")


@dataclass(frozen=True)
class Footage:
    """events: with t [us], x, y, p, sorted by t; pictures [n, H, W] 8 bit at times_us [n]."""

    name: str
    events: NDArray[Any]
    times_us: NDArray[np.float64]
    pictures: NDArray[np.uint8]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.pictures.shape[2], self.pictures.shape[1]

    @property
    def windows(self) -> list[Window]:
        """The intervals between consecutive pictures."""
        cuts = np.searchsorted(self.events["t"], self.times_us)
        ends = zip(self.times_us[:-1], self.times_us[1:], cuts[:-1], cuts[1:], strict=True)
        return [Window(float(a), float(b), self.events[i:j]) for a, b, i, j in ends]


def read_footage(folder: str | PathLike[str]) -> Footage:
    """Raises PecsNotFoundError for missing files, PecsInputError for another layout or wrong values."""
    folder = Path(folder)
    if (folder / "events_ts.npy").is_file():
        return _evreal(folder)
    if (folder / "events_aligned").is_dir():
        return _hs_ergb(folder)
    raise PecsInputError(f"{folder}: got no events_ts.npy (EVREAL) and no events_aligned (HS-ERGB)")


def _evreal(folder: Path) -> Footage:
    def column(name: str, what: str) -> NDArray[Any]:
        return np.asarray(load(folder / f"{name}.npy", what))

    seconds, places = column("events_ts", "times of events"), column("events_xy", "places of events")
    signs, pictures = column("events_p", "polarities"), column("images", "pictures")
    if pictures.ndim == 4 and pictures.shape[3] == 1:
        pictures = pictures[..., 0]
    if pictures.ndim != 3 or pictures.dtype != np.uint8:
        raise bad_input(
            folder / "images.npy", "shape and type", (pictures.shape, str(pictures.dtype)), "(N, H, W, 1), uint8"
        )
    shown_s = column("images_ts", "times of pictures").reshape(-1)
    times_us = np.round(seconds.astype(np.float64) * 1e6).astype(np.int64)
    return _checked(folder, times_us, places[:, 0], places[:, 1], signs, shown_s * 1e6, pictures)


def _hs_ergb(folder: Path) -> Footage:
    images = folder / "images_corrected"
    times_us = np.array(read_numbers(images / "timestamp.txt", "times of pictures in us, a line each"))
    paths = sorted(images.glob("*.png"))
    if len(paths) < len(times_us):
        raise bad_input(images, "pictures", len(paths), f"{len(times_us)}, as timestamp.txt has")
    pictures = np.stack([grey(read_picture(path)) for path in paths[: len(times_us)]])
    columns: list[list[NDArray[Any]]] = []
    for path in sorted((folder / "events_aligned").glob("*.npz")):
        with load(path, "events") as file:
            names = [next((k for k in keys if k in file), "") for keys in HS_ERGB_KEYS]
            if "" in names:
                raise bad_input(path, "arrays", sorted(file), "x, y, t or timestamp, p or polarity")
            t, x, y, p = (file[name].reshape(-1) for name in names)
        x, y = (v // SUBPIXELS if v.dtype.kind in "iu" else v for v in (x, y))
        # Remapping moves some events out of the picture.
        inside = (x >= 0) & (x < pictures.shape[2]) & (y >= 0) & (y < pictures.shape[1])
        columns.append([v[inside] for v in (np.round(t).astype(np.int64), x, y, p)])
    if not columns:
        raise bad_input(folder / "events_aligned", "files", 0, "*.npz")
    t, x, y, p = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    return _checked(folder, t, x, y, p, times_us, pictures)


def _checked(
    folder: Path,
    t: NDArray[Any],
    x: NDArray[Any],
    y: NDArray[Any],
    p: NDArray[Any],
    times_us: NDArray[np.float64],
    pictures: NDArray[np.uint8],
) -> Footage:
    lengths = {len(t), len(x), len(y), len(p)}
    if len(lengths) > 1:
        raise bad_input(folder, "lengths of the events' arrays", sorted(lengths), "the same for all")
    if len(times_us) != len(pictures) or len(times_us) < 2 or (np.diff(times_us) <= 0).any():
        raise bad_input(
            folder, "pictures and their times", (len(pictures), len(times_us)), "two or more, at increasing timestamps"
        )
    events = np.empty(len(t), EVENT_DTYPE)
    order = np.argsort(t, kind="stable")
    for name, values in zip("txyp", (t, x, y, np.asarray(p) > 0), strict=True):
        events[name] = values[order]
    outside = (events["x"] >= pictures.shape[2]) | (events["y"] >= pictures.shape[1])
    if outside.any():
        bad = events[outside][0]
        size = f"one of {pictures.shape[2]} x {pictures.shape[1]}"
        raise bad_input(folder, "pixel", (int(bad["x"]), int(bad["y"])), size)
    return Footage(folder.name, events, np.asarray(times_us, np.float64), np.ascontiguousarray(pictures))
