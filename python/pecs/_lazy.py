"""Packages whose names load their modules when they are first used."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from typing import Any


def attributes(package: str, modules: dict[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package. modules: their names in it, with the names that they define."""
    module_of = {name: module for module, names in modules.items() for name in names.split()}
    known = vars(sys.modules[package])

    def find(name: str) -> Any:
        if name in module_of:
            known[name] = getattr(importlib.import_module(f".{module_of[name]}", package), name)
        elif name in modules:
            known[name] = importlib.import_module(f".{name}", package)
        else:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return known[name]

    return find, lambda: sorted({*known, *module_of, *modules})
