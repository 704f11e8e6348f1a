"""Files of the writers: HDF5, PNG, text, tar, the same bytes for the same content."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._errors import optional_module
from ..._files import write_text
from ..._pages import png_bytes
from ...events import EventWriter
from ..event_file import EventFile
from ..sequence import Camera

_CHUNK = 1 << 16
_GZIP = {"compression": "gzip", "compression_opts": 1, "shuffle": True}  # every HDF5 library reads it
BLOCK = 1 << 20  # events at a time


class _Sink(io.FileIO):
    """A file that keeps its first error for later: HDF5 cannot close what it cannot write."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        try:
            done = 0
            while done < len(view):
                done += super().write(view[done:]) or 0
        except OSError as e:
            self.error = self.error or e
        return len(view)


@contextmanager
def hdf5(path: Path) -> Iterator[Any]:
    h5py = optional_module("h5py", "h5py", f"writing {path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    sink = _Sink(path, "w+")
    try:
        with h5py.File(sink, "w") as file:
            yield file
    finally:
        sink.close()
        if sink.error:
            raise sink.error from None


def put(file: Any, name: str, data: NDArray[Any]) -> Any:
    """A data set under gzip; scalars plain."""
    data = np.asarray(data)
    layout = {"chunks": True, **_GZIP} if data.size and data.ndim else {}
    return file.create_dataset(name, data=data, **layout)


def stack(file: Any, name: str, count: int, shape: tuple[int, ...], dtype: str) -> Any:
    """An empty data set of `count` pictures, one chunk each."""
    layout = {"chunks": (1, *shape), **_GZIP} if count else {}
    return file.create_dataset(name, (count, *shape), dtype, **layout)


Columns = dict[str, tuple[str, Callable[[NDArray[Any]], NDArray[Any]]]]  # data set -> (type, of a block of events)


def event_columns(group: str, t: str = "<i8") -> Columns:
    """GROUP/{x, y, t, p}; `t`: the type of t."""
    types = {"x": "<u2", "y": "<u2", "t": t, "p": "u1"}
    return {f"{group}/{name}": (dtype, lambda e, name=name: e[name]) for name, dtype in types.items()}


def put_events(file: Any, events: EventFile, columns: Columns) -> None:
    """Events in blocks."""
    n = len(events)
    layout = {"chunks": (min(n, _CHUNK),), **_GZIP} if n else {}
    sets = {name: file.create_dataset(name, (n,), dtype, **layout) for name, (dtype, _) in columns.items()}
    first = 0
    for block in events.blocks(BLOCK):
        for name, (_, value) in columns.items():
            sets[name][first : first + len(block)] = value(block)
        first += len(block)


def save_events(path: Path, events: EventFile, dtype: str, value: Callable[[NDArray[Any]], NDArray[Any]], *shape: int):
    """An NPY file of something of each event, [n, *shape], in blocks."""
    header = {"descr": np.dtype(dtype).str, "fortran_order": False, "shape": (len(events), *shape)}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        for block in events.blocks(BLOCK):
            file.write(np.ascontiguousarray(value(block), dtype).tobytes())


def write_events(path: Path, camera: Camera, events: EventFile, format: str) -> None:
    """In a format of `pecs.events`."""
    with EventWriter(path, camera.width, camera.height, format) as writer:
        for block in events.blocks(BLOCK):
            writer.write(block)


def write_png(path: Path, picture: NDArray[Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as file:  # two names of a foreign set may give one
        file.write(png_bytes(picture))


def grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Luma of BT.601, as OpenCV's."""
    cv2 = optional_module("cv2", "opencv-python-headless", "reading pictures")
    out: NDArray[np.uint8] = cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY)
    return out


def write_lines(path: Path, lines: list[str]) -> None:
    write_text(path, "".join(line + "\n" for line in lines))


def add_to_tar(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    entry = tarfile.TarInfo(name)
    entry.size = len(data)
    entry.mode = 0o644  # times and owners are 0
    tar.addfile(entry, io.BytesIO(data))
