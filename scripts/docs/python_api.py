#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Writes the page of the Python package from its docstrings.

.venv/bin/python scripts/docs/python_api.py -o out/docs/python_api.md
"""

import argparse
import dataclasses
import functools
import importlib
import inspect
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODULES = ("pecs", "pecs.datasets", "pecs.datasets.trajectories", "pecs.datasets.imu", "pecs.fit")
HEAD = """# Python, name by name

This page lists all public names of the package with their docstrings.
`scripts/docs/python_api.py` writes it. [Python and C](python.md) shows the main names at work.
"""
SECTIONS = "Parameters Returns Yields Raises Attributes Notes Examples".split()
ENTRIES = re.compile(r"^(\S.*)\n((?:(?: +.*)?\n)*)", re.MULTILINE)


def public(module) -> list[str]:
    """Names of `__all__`, or those that the module defines."""
    own = [n for n, v in vars(module).items() if n[0] != "_" and getattr(v, "__module__", None) == module.__name__]
    return getattr(module, "__all__", own)


def signature(name: str, call) -> str:
    """With annotations as written, one parameter a line where it is long."""
    found = inspect.signature(call)
    parts, star = [], False
    for p in found.parameters.values():
        if p.name == "self":
            continue
        if p.kind is p.KEYWORD_ONLY and not star:
            parts.append("*")
        star = star or p.kind in (p.KEYWORD_ONLY, p.VAR_POSITIONAL)
        prefix = {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "")
        text = prefix + p.name + (f": {p.annotation}" if p.annotation is not p.empty else "")
        default = repr(p.default) if not re.search(r" at 0x|<", repr(p.default)) else "…"
        parts.append(text + (f" = {default}" if p.default is not p.empty else ""))
    result = f" -> {found.return_annotation}" if found.return_annotation is not found.empty else ""
    line = f"{name}({', '.join(parts)}){result}"
    return line if len(line) < 100 else f"{name}(\n" + "".join(f"    {part},\n" for part in parts) + f"){result}"


def markdown(text: str | None) -> str:
    """A docstring, with sections of NumPy's convention as lists."""
    parts = re.split(rf"^({'|'.join(SECTIONS)})\n-+\n", inspect.cleandoc(text or "") + "\n", flags=re.MULTILINE)
    out = [parts[0]]
    for title, body in zip(parts[1::2], parts[2::2], strict=True):
        if title not in ("Notes", "Examples"):
            entries = (entry(*found) for found in ENTRIES.findall(body))
            body = "\n".join(entries)
        out.append(f"**{title}**\n\n{body.strip()}\n")
    page = "\n".join(out).strip()
    return re.sub(r"\bdocs/(\w+)/(\w+)\.md", r"[\2](../\1/\2.md)", page)


def entry(head: str, text: str) -> str:
    name, _, kind = head.partition(" : ")
    names = ", ".join(f"`{part}`" for part in ([name] if name[0] == "(" else name.split(", ")))  # (tuple, of types)
    return f"- {names}{f' ({kind})' if kind else ''}: {' '.join(text.split())}"


def members(cls):
    """(name, value) of methods and properties in the order of the source."""
    kinds = (property, functools.cached_property, classmethod, staticmethod)
    for name, value in vars(cls).items():
        if name[0] != "_" and (inspect.isfunction(value) or isinstance(value, kinds)):
            yield name, value


def block(level: int, title: str, call, doc: str | None) -> str:
    code = f"```py\n{signature(title.rpartition('.')[2], call)}\n```\n\n" if call else ""
    return f"{'#' * level} {title}\n\n{code}{markdown(doc)}\n\n"


def describe(module: str, name: str, value) -> str:
    title = f"{module}.{name}"
    if inspect.isclass(value):
        doc = value.__doc__ if not (value.__doc__ or "").startswith(f"{name}(") else ""  # dataclass: its signature
        plain = dataclasses.is_dataclass(value) or "__init__" in vars(value)
        page = block(3, title, value if plain else None, doc)
        for key, member in members(value):
            plain = isinstance(member, (property, functools.cached_property))
            page += block(4, f"{name}.{key}", None if plain else getattr(value, key), member.__doc__)
        return page
    if inspect.isroutine(value):
        return block(3, title, value, value.__doc__)
    return f"### {title}\n\n`{value!r}`\n\n" if not inspect.ismodule(value) else block(3, title, None, value.__doc__)


def page() -> str:
    out = HEAD
    for name in MODULES:
        module = importlib.import_module(name)
        out += f"\n## {name}\n\n{markdown(module.__doc__)}\n\n"
        out += "".join(describe(name, key, getattr(module, key)) for key in public(module))
    return re.sub(r"[ \t]+$", "", re.sub(r"\n{3,}", "\n\n", out), flags=re.MULTILINE).strip() + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.parse_args().output.write_text(page())


if __name__ == "__main__":
    main()
