"""All that is the operating system's in Python: files and locks, streams, processes, signals, memory, libraries; as
common/include/pecs/platform.h in C++. No other file of the package or of the Blender extension imports such modules
(tests/python/docs/test_structure.py). Errors are OSError, with the path and a reason to print.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

if os.name == "nt":
    from ._platform_windows import *  # noqa: F403
else:
    from ._platform_unix import *  # noqa: F403

# Standard streams


def open_standard_descriptors() -> None:
    """Opens those that are closed, so that no other file gets their numbers."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name, number, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))


def discard(*descriptors: int) -> None:
    """From now on, what is written to them is lost."""
    null = os.open(os.devnull, os.O_WRONLY)
    for descriptor in descriptors:
        os.dup2(null, descriptor)
    os.close(null)


def empty_standard_input() -> None:
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)


@contextmanager
def discarded(*descriptors: int, into: BinaryIO | None = None) -> Iterator[None]:
    """As `discard`, within the block; `into`: a file that gets what is written."""
    saved = {descriptor: os.dup(descriptor) for descriptor in descriptors}
    discard(*descriptors)
    for descriptor in descriptors if into else ():
        os.dup2(into.fileno(), descriptor)
    try:
        yield
    finally:
        for descriptor, copy in saved.items():
            os.dup2(copy, descriptor)
            os.close(copy)
