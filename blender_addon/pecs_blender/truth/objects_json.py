# SPDX-License-Identifier: GPL-3.0-or-later
"""The records of the layer `objects`: one file per instant, `objects_000000.json`, joined into `objects.json` when all
instants are written (docs/reference/exr_stack.md)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pecs._config import Fields, read_json
from pecs._errors import bad_input
from pecs._files import write_text

LAYER, WHOLE, ONE = "objects", "objects.json", "objects_{:06d}.json"
OF_A_THING = ("id", "name", "class", "class_id", "size_m", "centre_local")
CHANGING = ("size_m", "centre_local")  # of things that deform
SAME = 1e-5  # of the largest extent
MAX_BYTES = 1 << 30


def write_json(path: Path, value: Any) -> None:
    write_text(path, json.dumps(value, separators=(",", ":"), ensure_ascii=False) + "\n")


def one(folder: Path, index: int) -> Path:
    return folder / ONE.format(index)


def join(folder: Path, times_ns: list[int]) -> None:
    """Writes objects.json once all instants are there; other processes may have written some of them."""
    paths = [one(folder, i) for i in range(len(times_ns))]
    if not all(path.is_file() for path in paths):
        return
    classes: dict[str, str] = {}
    objects: dict[int, dict[str, Any]] = {}
    instants = []
    for path in paths:
        top = Fields(content := read_json(path, MAX_BYTES), path)
        classes |= top.any("classes")
        for thing in top.any("objects"):
            known = objects.setdefault(thing["id"], {key: thing[key] for key in OF_A_THING})
            if thing["name"] != known["name"]:
                raise bad_input(path, f"object {thing['id']}", repr(thing["name"]), repr(known["name"]))
            changes = any(_differs(thing[key], known[key], known["size_m"]) for key in CHANGING)
            for key in OF_A_THING[1:]:
                if not (key in CHANGING and changes):
                    del thing[key]
        instants.append({"t_ns": content["t_ns"], "objects": content["objects"]})
    ordered = [objects[k] for k in sorted(objects)]
    joined = {"format": 1, "classes": classes, "objects": ordered, "instants": instants}
    write_json(folder / WHOLE, joined)


def _differs(now: list[float], first: list[float], size: list[float]) -> bool:
    return max(abs(a - b) for a, b in zip(now, first, strict=True)) > SAME * max(size)
