# SPDX-License-Identifier: GPL-3.0-or-later
"""Stacks rendered in parts, joined."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

from .errors import NOT_FOUND, RenderError, bad_input


def merge(shards: list[Path], output: Path) -> None:
    """Writes the stack of all the shards' instants. Shards differ in times_ns and in the frames they have; a frame file
    is a hard link where that is possible."""
    import pecs

    stacks = [_stack(shard) for shard in shards]
    whole = {**stacks[0], "times_ns": sorted({t for stack in stacks for t in stack["times_ns"]})}
    frames = {}
    for shard, stack in zip(shards, stacks, strict=True):
        for key in whole.keys() | stack.keys():
            if key != "times_ns" and whole.get(key) != stack.get(key):
                raise bad_input(shard / "stack.json", key, "something else", f"what {shards[0]} says")
        for index, time_ns in enumerate(stack["times_ns"]):
            path = shard / f"frame_{index:06d}.exr"
            if path.is_file():
                frames[time_ns] = path
    missing = [t for t in whole["times_ns"] if t not in frames]
    if missing:
        raise bad_input(shards[0], f"instant {missing[0]} ns", f"{len(missing)} frames missing", "all frames")
    with pecs.StackWriter(output, whole) as writer:
        for index, time_ns in enumerate(whole["times_ns"]):
            if not writer.has_frame(index):
                _place(frames[time_ns], output / f"frame_{index:06d}.exr")


def _stack(shard: Path) -> dict:
    path = shard / "stack.json"
    if not path.is_file():
        raise RenderError(NOT_FOUND, f"{path}: no such file")
    try:
        return json.loads(path.read_text())
    except json.JSONDecodeError as e:
        raise bad_input(path, f"line {e.lineno} column {e.colno}", e.msg, "valid JSON") from None


def _place(source: Path, target: Path) -> None:
    part = target.with_suffix(".part")
    part.unlink(missing_ok=True)
    try:
        os.link(source, part)
    except OSError:
        shutil.copyfile(source, part)
    os.replace(part, target)
