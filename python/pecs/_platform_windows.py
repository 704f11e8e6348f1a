"""Windows, for `_platform`: the functions of `_platform_unix`, which describes them."""

from __future__ import annotations

import ctypes
import errno
import msvcrt
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from ctypes import wintypes
from functools import cache
from pathlib import Path
from typing import BinaryIO, NoReturn

_kernel = ctypes.WinDLL("kernel32", use_last_error=True)
_kernel.CreateFileW.restype = _kernel.CreateJobObjectW.restype = wintypes.HANDLE
_kernel.GetCurrentProcess.restype = _kernel.GetModuleHandleW.restype = wintypes.HANDLE

# Files

_READ_WRITE, _OPEN_ALWAYS, _OPEN_LINK = 0xC0000000, 4, 0x00200000
_SHARE_ALL = 7  # others may read, write, rename and remove an open file, as on other systems
_LOCK_VIOLATION, _SHARING_VIOLATION, _ACCESS_DENIED = 33, 32, 5
# Behind the end of every file, as in common/src/platform_files_windows.cpp: a lock of Windows keeps others from reading
# and writing what it covers.
_LOCKS = 0x7FFFFFFF << 32


class _Overlapped(ctypes.Structure):
    _fields_ = [
        ("internal", ctypes.c_void_p),
        ("internal_high", ctypes.c_void_p),
        ("offset", wintypes.DWORD),
        ("offset_high", wintypes.DWORD),
        ("event", wintypes.HANDLE),
    ]


def lock_bytes(descriptor: int, first: int = 0, count: int = 0) -> bool:
    at = _Overlapped(offset=(_LOCKS + first) & 0xFFFFFFFF, offset_high=(_LOCKS + first) >> 32)
    exclusive_at_once = 3
    handle = wintypes.HANDLE(msvcrt.get_osfhandle(descriptor))
    done = _kernel.LockFileEx(handle, exclusive_at_once, 0, count or 0x7FFFFFFF, 0, ctypes.byref(at))
    return bool(done) or ctypes.get_last_error() != _LOCK_VIOLATION


def open_regular(file: Path, path: Path) -> int:
    with suppress(FileNotFoundError):
        found = file.lstat()
        if found.st_file_attributes & stat.FILE_ATTRIBUTE_REPARSE_POINT:
            raise OSError(errno.ELOOP, f"{file} is a symbolic link", str(path))
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, f"{file} is not a regular file", str(path))
    handle = _kernel.CreateFileW(str(file), _READ_WRITE, _SHARE_ALL, None, _OPEN_ALWAYS, _OPEN_LINK, None)
    if handle in (None, wintypes.HANDLE(-1).value):
        raise ctypes.WinError(ctypes.get_last_error())
    return msvcrt.open_osfhandle(handle, os.O_RDWR | os.O_BINARY)


def rename_complete(descriptor: int, file: Path, target: Path) -> None:
    os.fsync(descriptor)
    if file.is_dir():  # none is renamed with a file open in it
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, descriptor)
        os.close(null)
    for _ in range(20):  # a scanner for viruses opens new files for a moment
        try:
            return os.replace(file, target)
        except PermissionError as e:
            if e.winerror not in (_SHARING_VIOLATION, _ACCESS_DENIED):
                raise
        time.sleep(0.05)
    return os.replace(file, target)


def open_stream(path: Path) -> BinaryIO:
    return open(path, "wb")


def link_folder(link: Path, folder: Path) -> None:
    import _winapi

    _winapi.CreateJunction(str(folder), str(link))  # a symbolic link requires a privilege


# Processes

KILLED = (1,)


def become(command: Sequence[str]) -> NoReturn:
    """Windows replaces no process: this one waits, and ends as the program does."""
    _end_children_with_this()
    process = subprocess.Popen(command)
    for number in (signal.SIGINT, signal.SIGBREAK):  # which the program also gets
        signal.signal(number, lambda *_: None)
    os._exit(process.wait())


class _JobLimits(ctypes.Structure):  # JOBOBJECT_EXTENDED_LIMIT_INFORMATION
    _fields_ = [("times", ctypes.c_int64 * 2), ("flags", wintypes.DWORD), ("rest", ctypes.c_size_t * 15)]


@cache
def _end_children_with_this() -> None:
    """Puts this process into a job that ends its processes when the last handle to it is closed: at this one's end."""
    extended_limits, kill_on_job_close = 9, 0x2000
    job = _kernel.CreateJobObjectW(None, None)
    limits = _JobLimits(flags=kill_on_job_close)
    size = ctypes.sizeof(limits)
    _kernel.SetInformationJobObject(wintypes.HANDLE(job), extended_limits, ctypes.byref(limits), size)
    _kernel.AssignProcessToJobObject(wintypes.HANDLE(job), wintypes.HANDLE(_kernel.GetCurrentProcess()))


def die_with_parent(command: Sequence[str | os.PathLike[str]]) -> list[str]:
    _end_children_with_this()
    return list(map(os.fspath, command))


def has_crashed(code: int) -> bool:
    return code >= 0xC0000000  # an exception: access violation, illegal instruction


def end_of(code: int) -> str:
    number = max(0, code - 128)
    if has_crashed(code):
        return f"exception {code:#x}"
    return f"signal {number}" if number in (signal.SIGINT, signal.SIGTERM) else ""


# Signals that stop a process: Ctrl-C is SIGINT, Ctrl-Break stands for SIGTERM, which Windows does not send


def exit_when_terminated() -> None:
    signal.signal(signal.SIGBREAK, lambda *_: sys.exit(128 + signal.SIGTERM))


def raise_nothing_when_stopped() -> None:
    for number in (signal.SIGINT, signal.SIGBREAK):
        signal.signal(number, lambda *_: None)


def watch_stops(stopped: Callable[[int], object]) -> Callable[[], None]:
    signals, waker = socket.socketpair()  # Windows has no other wake-up
    waker.setblocking(False)

    def watch() -> None:
        with suppress(OSError):
            while number := signals.recv(1):
                if number[0] in (signal.SIGINT, signal.SIGBREAK):
                    stopped(signal.SIGINT if number[0] == signal.SIGINT else signal.SIGTERM)

    before = signal.set_wakeup_fd(waker.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=watch, daemon=True).start()

    def end() -> None:
        signal.set_wakeup_fd(before)
        waker.close()

    return end


# Memory and libraries


class _Memory(ctypes.Structure):  # PROCESS_MEMORY_COUNTERS
    _fields_ = [
        ("bytes", wintypes.DWORD),
        ("faults", wintypes.DWORD),
        ("peak", ctypes.c_size_t),
        ("now", ctypes.c_size_t),
        ("rest", ctypes.c_size_t * 6),
    ]


def resident_mb(peak: bool = False) -> float:
    memory = _Memory(bytes=ctypes.sizeof(_Memory))
    process = wintypes.HANDLE(_kernel.GetCurrentProcess())
    if not _kernel.K32GetProcessMemoryInfo(process, ctypes.byref(memory), memory.bytes):
        return 0.0
    return float(memory.peak if peak else memory.now) / 1e6


def cpu_has_bfloat16() -> bool:
    """Windows does not tell."""
    return False


def program_file(name: str) -> str:
    return f"{name}.exe"


def library_file(name: str, version: str = "") -> str:
    """libpecs.dll as mingw-w64 names it; the others are Blender's: OpenImageDenoise.dll, tbb12.dll."""
    return {"pecs": "libpecs.dll", "tbb": f"tbb{version}.dll"}.get(name, f"{name}.dll")


def loaded_library(file: str) -> ctypes.CDLL:
    handle = _kernel.GetModuleHandleW(file)
    if not handle:
        raise OSError(f"{file} is not loaded")
    return ctypes.CDLL(file, handle=handle)
