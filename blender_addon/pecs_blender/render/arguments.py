# SPDX-License-Identifier: GPL-3.0-or-later
"""The parsers' rules that all commands share (pecs/_arguments.py), read without pecs itself: its library must be loaded
after bpy."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from . import streams
from .errors import NOT_FOUND, USAGE, RenderError


def _rules() -> ModuleType:
    found = importlib.util.find_spec("pecs")
    if not found or not found.origin:
        raise RenderError(NOT_FOUND, "pecs: got no such package, wanted it beside pecs_blender")
    spec = importlib.util.spec_from_file_location(f"{__name__}._rules", Path(found.origin).with_name("_arguments.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


rules = _rules()
Quantity, account = rules.Quantity, rules.account


class Parser(rules.Parser):
    """Whose errors are one line, "COMMAND: …"."""

    def error(self, message: str) -> NoReturn:
        command = self.prog.removeprefix("pecs_blender").strip()
        raise RenderError(USAGE, f"{command}: {rules.said(message)}" if command else rules.said(message))

    def _print_message(self, message: str, file: object = None) -> None:
        streams.say(message)
