"""Files: inputs of a bounded size, and outputs by the rules of docs/reference/exit_codes.md (common/src/files.cpp keeps
them for the program).

Every file and folder that a Python command writes comes from here: `whole` and `write_*` for files, `whole_folder` for
a folder, `check_outputs` before a command begins. The program writes videos.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from . import _platform
from ._errors import PecsError, PecsNotFoundError, PecsOutputError, UsageError, bad_input

FRAME_ENDINGS = (".json", ".exr", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".webp", ".pgm", ".ppm")
MARK = ".pecs_partial"  # in a folder that is being written: it is ours, and its lock is held


# Inputs


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """All of a file of at most so many bytes."""
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as e:
        raise PecsNotFoundError(f"{path}: {e.strerror or e}") from None
    if len(data) > max_bytes:
        raise bad_input(path, "", f"more than {max_bytes} bytes", "a smaller file")
    return data


def read_text(path: Path, max_bytes: int, wanted: str = "text") -> str:
    """UTF-8 text, without a byte order mark. `wanted` names the expected content in errors."""
    try:
        return read_bytes(path, max_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise bad_input(path, f"byte {e.start}", "invalid UTF-8", f"{wanted} in UTF-8") from None


def existing_folder(path: Path) -> Path:
    """The path, or the nearest folder above it that exists."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


def sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


# Outputs


def partial_path(path: Path) -> Path:
    return path.with_name(path.name + ".partial")


def is_stream(path: Path) -> bool:
    """A pipe or a device, which is written directly."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


def check_outputs(inputs: Sequence[Path | None], outputs: Sequence[Path | None]) -> None:
    """Raises UsageError for an output that is an input, that would replace a frame of an input folder, or that another
    output names; PecsOutputError for a folder that cannot be written."""
    named = [path for path in outputs if path is not None and not is_stream(path)]
    for i, output in enumerate(named):
        got, wanted = "", "another file"
        for path in (path for path in inputs if path is not None):
            if _same(output, path) or _same(partial_path(output), path):
                got = "the input itself"
            elif output.exists() and _same(output.parent, path) and output.suffix.lower() in FRAME_ENDINGS:
                got = "a file of the input folder"
        if any(_same(output, other) for other in named[:i]):
            got, wanted = "two outputs", "one file each"
        if got:
            raise UsageError(f"{output}: output: got {got}, wanted {wanted}")
        check_folder(output, existing_folder(output.resolve().parent))


def check_folder(output: Path, folder: Path) -> None:
    """Raises PecsOutputError if the folder of an output is none, or cannot be written."""
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise _refused(output, f"{folder} is no folder that is writable")


def _same(a: Path, b: Path) -> bool:
    """Also for paths that do not exist yet."""
    with suppress(OSError):
        return a.samefile(b)
    return os.path.realpath(a) == os.path.realpath(b)


def _refused(path: object, why: object) -> PecsOutputError:
    return PecsOutputError(f"{path}: cannot be written: {why}")


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Errors of the system become PecsOutputError."""
    try:
        yield
    except PecsError:
        raise
    except OSError as e:
        raise _refused(e.filename or path, e.strerror or e) from None


def _file_behind(path: Path) -> Path:
    """Resolves links. Raises PecsOutputError for an existing path that is not a file."""
    if not path.name:
        raise _refused(path, "the path names no file")
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        if path.is_symlink():
            raise _refused(path, "dangling symbolic link") from None
        return path
    if stat.S_ISDIR(mode):
        raise _refused(path, "it is a directory")
    if stat.S_ISBLK(mode) or stat.S_ISSOCK(mode):
        raise _refused(path, "it is a block device or a socket")
    if not stat.S_ISREG(mode):
        raise _refused(path, "it is a pipe or a device; this format needs a seekable file")
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def _is_open(descriptor: int, file: Path) -> bool:
    """Whether it is this open file, which another process may have renamed or removed."""
    with suppress(OSError):
        return os.path.samestat(os.lstat(file), os.fstat(descriptor))
    return False


def _claim(file: Path, path: Path) -> int:
    """Opens or creates a file and locks it, for the output `path`; its content stays. Raises OSError, BlockingIOError
    where another process holds the lock."""
    while True:
        descriptor = _platform.open_regular(file, path)
        try:
            if not _platform.lock_bytes(descriptor):
                raise BlockingIOError(errno.EAGAIN, "another process is writing it", str(path))
            if _is_open(descriptor, file):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


@contextmanager
def whole(path: Path) -> Iterator[BinaryIO]:
    """Opens a file for writing. It gets its name when the block ends without an exception and all data are on disk. A
    pipe or a device is written directly. Creates the folder. Raises PecsOutputError."""
    with _writing(path):
        if is_stream(path):
            with _platform.open_stream(path) as file:
                yield file
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        target = _file_behind(path)
        partial = partial_path(target)
        fd = _claim(partial, path)
        try:
            os.ftruncate(fd, 0)
            with os.fdopen(os.dup(fd), "wb") as file:
                yield file
            _platform.rename_complete(fd, partial, target)
        finally:
            if _is_open(fd, partial):
                partial.unlink()
            os.close(fd)


def write_whole(path: Path, content: bytes) -> None:
    with whole(path) as file:
        file.write(content)


def write_text(path: Path, text: str) -> None:
    write_whole(path, text.encode())


def write_json(path: Path, value: Any) -> None:
    write_text(path, json.dumps(value, indent=1) + "\n")


@contextmanager
def whole_folder(path: Path, replace: bool = False) -> Iterator[Path]:
    """An empty folder for this process alone, X.partial, which gets its name when the block ends without an exception;
    otherwise it stays, and the next run of PECS empties it. A folder X.partial that PECS did not make is an error, and
    so is an output that exists, unless `replace`: then it goes when the new one is whole. Raises PecsOutputError."""
    partial = partial_path(path)

    def check() -> None:
        if os.path.lexists(path) and not replace:
            raise PecsOutputError(f"{path}: exists")

    with _writing(path):
        check()
        fd = _own_folder(partial, path)
        try:
            check()  # another process may have finished it before the lock was taken
            for entry in partial.iterdir():
                if entry.name != MARK:
                    shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()
            yield partial
            if replace and os.path.lexists(path):
                shutil.rmtree(path)
            _platform.rename_complete(fd, partial, path)
            (path / MARK).unlink()
        finally:
            os.close(fd)


def _own_folder(partial: Path, path: Path) -> int:
    """Makes the folder, or takes an earlier one of PECS; the locked descriptor of its mark."""
    while True:
        with suppress(FileExistsError):
            partial.mkdir(parents=True)
        with suppress(FileNotFoundError):  # another process has finished it and it has its name
            ours = not partial.is_symlink() and ((partial / MARK).is_file() or not any(partial.iterdir()))
            if not ours:
                raise _refused(path, f"{partial} exists and is not of PECS; remove or rename it")
            return _claim(partial / MARK, path)


@contextmanager
def lock_file(name: Path, path: Path, busy: PecsOutputError | None = None) -> Iterator[None]:
    """Holds a lock file for the output `path`. It stays: a process that has opened a removed file would lock nothing.
    Raises `busy`, and PecsOutputError about `path`."""
    with _writing(path):
        try:
            fd = _claim(name, path)
        except BlockingIOError as e:
            raise busy or e from None
    try:
        yield
    finally:
        os.close(fd)
