"""Linux and other systems like it, for `_platform`; `die_with_parent` runs it alone, so it imports nothing of PECS."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import stat
import struct
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, BinaryIO, NoReturn

if TYPE_CHECKING:
    import ctypes
    from pathlib import Path

# Files


def lock_bytes(descriptor: int, first: int = 0, count: int = 0) -> bool:
    """Locks bytes of an open file (count 0: all), also behind its end; False if another process holds one of them. The
    lock belongs to the open file: a POSIX record lock would end when this process closes any other descriptor of the
    file. A file system without locks locks nothing."""
    if sys.platform == "darwin":  # struct flock
        set_lock, lock = 90, struct.pack("qqihh", first, count, 0, fcntl.F_WRLCK, os.SEEK_SET)
    else:
        set_lock, lock = fcntl.F_OFD_SETLK, struct.pack("hhqqi0q", fcntl.F_WRLCK, os.SEEK_SET, first, count, 0)
    try:
        fcntl.fcntl(descriptor, set_lock, lock)
    except OSError as e:
        return e.errno not in (errno.EAGAIN, errno.EACCES)
    return True


def open_regular(file: Path, path: Path) -> int:
    """Opens or creates a regular file without following a link, for the output `path`; its content stays. Raises
    OSError."""
    try:
        # O_NONBLOCK: opening a pipe does not block.
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
        descriptor = os.open(file, flags, 0o666)
    except OSError as e:
        is_link = e.errno == errno.ELOOP and file.is_symlink()
        raise (OSError(e.errno, f"{file} is a symbolic link", str(path)) if is_link else e) from None
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EINVAL, f"{file} is not a regular file", str(path))


def rename_complete(descriptor: int, file: Path, target: Path) -> None:
    """Flushes an open file to the disk, then renames it, or the folder that contains it; it replaces the target."""
    os.fsync(descriptor)
    os.replace(file, target)


def open_stream(path: Path) -> BinaryIO:
    """A pipe or a device, to write."""
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_NOCTTY | os.O_CLOEXEC), "wb")


def link_folder(link: Path, folder: Path) -> None:
    """Makes a link to a folder, which `Path.resolve` follows."""
    link.symlink_to(folder)


# Processes

KILLED = (-signal.SIGTERM, -signal.SIGKILL)  # exit codes of `subprocess` after its `terminate` and `kill`


def become(command: Sequence[str]) -> NoReturn:
    """Replaces this process by a program, so that signals and exit codes need no forwarding. Raises OSError."""
    os.execvp(command[0], command)


def die_with_parent(command: Sequence[str | os.PathLike[str]]) -> list[str]:
    """The command line of a process that becomes `command` and gets SIGTERM when the thread that started it ends, also
    by SIGKILL of its process. The child asks for the signal itself (prctl(2); exec keeps it): `preexec_fn` may deadlock
    in a process with threads, and Blender always has some."""
    return [sys.executable, "-IS", os.path.abspath(__file__), str(os.getpid()), *map(os.fspath, command)]


def _become_child(parent: int, command: list[str]) -> None:
    import ctypes  # only the child needs it

    death_signal = 1  # PR_SET_PDEATHSIG
    libc = ctypes.CDLL(None)
    if hasattr(libc, "prctl"):
        libc.prctl(death_signal, signal.SIGTERM)
    if os.getppid() != parent:  # ended before prctl
        sys.exit(128 + signal.SIGTERM)
    try:
        become(command)
    except OSError as e:
        print(f"pecs: {command[0]}: {e.strerror}", file=sys.stderr)
        sys.exit(3)  # docs/reference/exit_codes.md


def has_crashed(code: int) -> bool:
    """Whether a process with this exit code of `subprocess` ended by a fault of its own."""
    return -code in (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL)


def end_of(code: int) -> str:
    """Such as "signal 11 (Segmentation fault)", for the exit code of `subprocess` or of a shell; "" if no signal ended
    the process."""
    number = -code if code < 0 else max(0, code - 128)
    return f"signal {number} ({signal.strsignal(number) or '?'})" if number else ""


# Signals that stop a process: SIGINT and SIGTERM


def exit_when_terminated() -> None:
    """SIGTERM raises SystemExit in the main thread, as SIGINT raises KeyboardInterrupt."""
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))


def raise_nothing_when_stopped() -> None:
    """SIGINT and SIGTERM reach `watch_stops` alone."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)


def watch_stops(stopped: Callable[[int], object]) -> Callable[[], None]:
    """Calls `stopped(number)` in a thread for each signal, also while a library does not return to Python, whose own
    handlers wait for that. Call in the main thread, before Blender is loaded. Returns a function that ends it."""
    signals, waker = os.pipe()
    os.set_blocking(waker, False)

    def watch() -> None:
        with os.fdopen(signals, "rb", buffering=0) as stream:
            while number := stream.read(1):
                if number[0] in (signal.SIGINT, signal.SIGTERM):
                    stopped(number[0])

    before = signal.set_wakeup_fd(waker, warn_on_full_buffer=False)
    threading.Thread(target=watch, daemon=True).start()

    def end() -> None:
        signal.set_wakeup_fd(before)
        os.close(waker)

    return end


# Memory and libraries


def resident_mb(peak: bool = False) -> float:
    """This process's resident memory, now or at its peak; 0 if the system does not report it."""
    name = "VmHWM" if peak else "VmRSS"
    with suppress(OSError), open("/proc/self/status", encoding="ascii") as file:
        return next((float(line.split()[1]) / 1024 for line in file if line.startswith(name)), 0.0)
    return 0.0


def cpu_has_bfloat16() -> bool:
    """Whether the CPU multiplies in bfloat16; no if the system does not tell."""
    with suppress(OSError), open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
        return "avx512_bf16" in file.read()
    return False


def program_file(name: str) -> str:
    return name


def library_file(name: str, version: str = "") -> str:
    """The file of a shared library, such as libNAME.so.2."""
    if sys.platform == "darwin":
        return ".".join(filter(None, (f"lib{name}", version, "dylib")))
    return ".".join(filter(None, (f"lib{name}.so", version)))


def loaded_library(file: str) -> ctypes.CDLL:
    """The copy of a library that this process has loaded. Raises OSError if it has none."""
    import ctypes

    return ctypes.CDLL(file, mode=os.RTLD_NOLOAD | os.RTLD_NOW)


if __name__ == "__main__":
    _become_child(int(sys.argv[1]), sys.argv[2:])
