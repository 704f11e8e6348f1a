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
from ..event_file import EventFile
from ..files import png_bytes

_CHUNK = 1 << 16
BLOCK = 1 << 20  # events at a time


class _Sink(io.RawIOBase):
    """A file that keeps its first error for later: HDF5 cannot close what it cannot write, and says so at length."""

    def __init__(self, path: Path):
        self._file = path.open("w+b", buffering=0)
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        try:
            done = 0
            while done < len(view):
                done += self._file.write(view[done:]) or 0
        except OSError as e:
            self.error = self.error or e
        return len(view)

    def readinto(self, buffer: Any) -> int:
        return self._file.readinto(buffer)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def truncate(self, size: int | None = None) -> int:
        return self._file.truncate(size)

    def close(self) -> None:
        self._file.close()


@contextmanager
def hdf5(path: Path) -> Iterator[Any]:
    h5py = optional_module("h5py", "h5py", f"writing {path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    sink = _Sink(path)
    try:
        with h5py.File(sink, "w") as file:
            yield file
    finally:
        sink.close()
        if sink.error:
            raise sink.error from None


def put(file: Any, name: str, data: NDArray[Any], chunk: tuple[int, ...] | None = None) -> Any:
    """A data set under gzip, which every HDF5 library reads; scalars plain."""
    data = np.asarray(data)
    if data.ndim == 0 or data.size == 0:
        return file.create_dataset(name, data=data)
    return file.create_dataset(
        name, data=data, chunks=chunk or True, compression="gzip", compression_opts=1, shuffle=True
    )


def stack(file: Any, name: str, count: int, shape: tuple[int, ...], dtype: str) -> Any:
    """An empty data set of `count` pictures, one chunk each."""
    chunks = (1, *shape) if count else None
    return file.create_dataset(
        name, (count, *shape), dtype, chunks=chunks, compression="gzip" if count else None, shuffle=bool(count)
    )


Columns = dict[str, tuple[str, Callable[[NDArray[Any]], NDArray[Any]]]]  # data set -> (type, of a block of events)


def put_events(file: Any, events: EventFile, columns: Columns) -> None:
    """Events in blocks."""
    n = len(events)
    sets = {}
    for name, (dtype, _) in columns.items():
        layout = (
            {"chunks": (min(n, _CHUNK),), "compression": "gzip", "compression_opts": 1, "shuffle": True} if n else {}
        )
        sets[name] = file.create_dataset(name, (n,), dtype, **layout)
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


def write_png(path: Path, picture: NDArray[Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png_bytes(picture))


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
