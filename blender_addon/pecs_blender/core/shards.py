# SPDX-License-Identifier: GPL-3.0-or-later
"""Stacks rendered in parts, joined."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

from .errors import bad_input
from .strict_json import JsonObject, read_json, shown


def merge(shards: list[Path], output: Path) -> None:
    """Writes the stack of all the shards' instants, in every layer. Shards differ in times_ns and in the frames they
    have; a frame file is a hard link where that is possible."""
    import pecs

    stacks = [_Shard(shard) for shard in shards]
    whole = {**stacks[0].json, "times_ns": sorted({t for stack in stacks for t in stack.times_ns})}
    for stack in stacks:
        for key in whole.keys() | stack.json.keys():
            if key != "times_ns" and whole.get(key) != stack.json.get(key):
                raise bad_input(stack.folder / "stack.json", key, "something else", f"what {shards[0]} says")
    files = {layer: {} for layer in stacks[0].patterns}
    for stack in stacks:
        for layer, found in files.items():
            found |= stack.files(layer)
    for layer, found in files.items():
        missing = [t for t in whole["times_ns"] if t not in found]
        if missing:
            place = f"{layer}: instant {missing[0]} ns"
            raise bad_input(shards[0], place, f"{len(missing)} frames missing", "all frames")
    with pecs.StackWriter(output, whole) as writer:
        for layer, found in files.items():
            for index, time_ns in enumerate(whole["times_ns"]):
                if not writer.has_layer(layer, index):
                    _place(found[time_ns], output / (stacks[0].patterns[layer] % index))


class _Shard:
    def __init__(self, folder: Path):
        path = folder / "stack.json"
        self.folder, self.json = folder, read_json(path, 64 << 20)
        top = JsonObject(self.json, path)
        self.times_ns = top.numbers("times_ns")
        self.patterns = {"light": "frame_%06d.exr"}
        for i, entry in enumerate(top.any("layers") if top.has("layers") else ()):
            layer = JsonObject(entry, path, f"layers[{i}]")
            if layer.text("at") != "instant":
                raise layer.fail("at", layer.text("at"), "a layer per instant: intervals do not merge")
            pattern = layer.text("files")
            if not re.fullmatch(r"[A-Za-z0-9_-]+%06d\.exr", pattern):
                raise layer.fail("files", shown(pattern), "a name such as depth_%06d.exr")
            self.patterns[layer.text("name")] = pattern

    def files(self, layer: str) -> dict[int, Path]:
        """By time in ns."""
        paths = ((t, self.folder / (self.patterns[layer] % i)) for i, t in enumerate(self.times_ns))
        return {t: path for t, path in paths if path.is_file()}


def _place(source: Path, target: Path) -> None:
    part = target.with_suffix(".part")
    part.unlink(missing_ok=True)
    try:
        os.link(source, part)
    except OSError:
        shutil.copyfile(source, part)
    os.replace(part, target)
