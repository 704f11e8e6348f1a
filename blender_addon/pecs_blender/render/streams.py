# SPDX-License-Identifier: GPL-3.0-or-later
"""Standard input, output and error where one is closed or fails."""

from __future__ import annotations

import os
import sys

from .errors import BAD_OUTPUT, RenderError


def fill() -> None:
    """Opens those that are closed, so that no file of ours gets their numbers. First of all."""
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(fd, True)
    os.close(fd)
    for name, fd, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(fd, mode, closefd=False))


def say(text: str) -> None:
    """To standard output, to the last byte; throws RenderError where it cannot be written."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as e:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is left there must not fail once more at the exit
        raise RenderError(BAD_OUTPUT, f"standard output: cannot be written: {e.strerror}") from None
