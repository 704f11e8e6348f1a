# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors as the pecs program reports them: one line, one documented exit code (docs/reference/exit_codes.md)."""

import re

USAGE, NOT_FOUND, BAD_INPUT, BAD_OUTPUT, UNSUPPORTED = 2, 3, 4, 5, 6


class RenderError(Exception):
    def __init__(self, code: int, line: str):
        super().__init__(re.sub(r"[\x00-\x1f\x7f]", " ", line))
        self.code = code


def bad_input(file: object, place: str, got: object, wanted: str) -> RenderError:
    return RenderError(BAD_INPUT, ": ".join(filter(None, (str(file), place, f"got {got}, wanted {wanted}"))))
