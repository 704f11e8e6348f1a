# SPDX-License-Identifier: GPL-3.0-or-later
"""Merges stacks that were rendered in parts."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pecs
from pecs._config import Fields, read_json
from pecs._errors import bad_input

from ..scene.timeline import Timeline
from ..truth import objects_json


def merge(shards: list[Path], output: Path) -> None:
    """Writes the stack of all instants of the shards, in every layer. Shards differ in times_ns and in the frames they
    contain; frame files are hard links if possible. Each interval of the merged stack must be one of a shard."""
    stacks = [_Shard(shard) for shard in shards]
    whole = {**stacks[0].json, "times_ns": sorted({t for stack in stacks for t in stack.times_ns})}
    for stack in stacks:
        for key in whole.keys() | stack.json.keys():
            if key != "times_ns" and whole.get(key) != stack.json.get(key):
                raise bad_input(stack.folder / "stack.json", key, "another value", f"that of {shards[0]}")
    files_of = {layer: {} for layer in stacks[0].patterns}
    for stack in stacks:
        for layer, files in files_of.items():
            files |= stack.files(layer)
    wanted = {layer: stacks[0].places(layer, whole["times_ns"]) for layer in files_of}
    for layer, files in files_of.items():
        missing = [place for place in wanted[layer] if place not in files]
        if missing:
            kind = "instant" if len(missing[0]) == 1 else "interval"
            place = f"{layer}: {kind} {' to '.join(map(str, missing[0]))} ns"
            raise bad_input(shards[0], place, f"{len(missing)} frames missing", "all frames")
    with pecs.StackWriter(output, whole) as writer:
        for layer, files in files_of.items():
            for index, place in enumerate(wanted[layer]):
                if layer == objects_json.LAYER:
                    _place(files[place].with_suffix(".json"), objects_json.one(output, index))
                if not writer.has_layer(layer, index):
                    _place(files[place], output / (stacks[0].patterns[layer] % index))
        if objects_json.LAYER in files_of:
            objects_json.join(output, whole["times_ns"])
        intervals = {place: i for i, place in enumerate(stacks[0].intervals(whole["times_ns"]))}
        for stack in stacks:
            for place, number, path in stack.between():
                if place in intervals:
                    _place(path, output / f"between_{intervals[place]:06d}_{number}.exr")


class _Shard:
    def __init__(self, folder: Path):
        path = folder / "stack.json"
        self.folder, self.json = folder, read_json(path, 64 << 20)
        top = Fields(self.json, path)
        self.times_ns = top.numbers("times_ns")
        self._period_ns = top.optional(top.number, "period_ns")
        lit = self.json.get("light", True)
        self.patterns, self._per_interval = {"light": "frame_%06d.exr"} if lit else {}, set()
        for layer in top.tables("layers", []):
            pattern = layer.text("files")
            if not re.fullmatch(r"[A-Za-z0-9_-]+%06d\.exr", pattern):
                raise layer.wrong("files", "a name such as depth_%06d.exr")
            self.patterns[layer.text("name")] = pattern
            if layer.text("at") == "interval":
                self._per_interval.add(layer.text("name"))

    def places(self, layer: str, times_ns: list[int]) -> list[tuple[int, ...]]:
        """Instant [ns] or interval of each file of a layer, in their order."""
        return self.intervals(times_ns) if layer in self._per_interval else [(t,) for t in times_ns]

    def intervals(self, times_ns: list[int]) -> list[tuple[int, int]]:
        return list(pairwise(Timeline(times_ns, self._period_ns).bounds_ns))

    def between(self) -> Iterator[tuple[tuple[int, int], str, Path]]:
        """Pictures between instants (docs/reference/exr_stack.md): interval, number and file."""
        for i, place in enumerate(self.intervals(self.times_ns)):
            for path in sorted(self.folder.glob(f"between_{i:06d}_*.exr")):
                yield place, path.stem.rsplit("_", 1)[1], path

    def files(self, layer: str) -> dict[tuple[int, ...], Path]:
        """Existing files by instant or interval."""
        paths = ((p, self.folder / (self.patterns[layer] % i)) for i, p in enumerate(self.places(layer, self.times_ns)))
        beside = layer == objects_json.LAYER
        return {p: path for p, path in paths if path.is_file() and (not beside or path.with_suffix(".json").is_file())}


def _place(source: Path, target: Path) -> None:
    part = target.with_suffix(".part")
    part.unlink(missing_ok=True)
    try:
        os.link(source, part)
    except OSError:
        shutil.copyfile(source, part)
    os.replace(part, target)
