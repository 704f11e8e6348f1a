"""Objects and textures from pools, drawn into a scene: [[scene.place]] of a recipe. The renderer places them by
`--place` (docs/reference/render.md)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .table import Table, Value, key, optional

Rng = Callable[[str], np.random.Generator]


def _files(table: Table, key: str, *kinds: str) -> tuple[str, ...]:
    """Files of a pattern, sorted, so that the same set of files gives the same draws."""
    pattern, beside = table.text(key), Path(str(table.file)).parent
    there = () if pattern.startswith(("/", "..")) else beside.glob(pattern)
    found = sorted(str(p.relative_to(beside)) for p in there if p.suffix in kinds)
    if not found:
        raise table.fail(key, f"{pattern}: no file", f"a pattern of {', '.join(kinds)} files beside the recipe")
    return tuple(found)


def _textures(table: Table, key: str) -> tuple[str, ...]:
    return _files(table, key, ".png", ".jpg", ".jpeg", ".exr") if table.has(key) else ()


@dataclass(frozen=True)
class Pool:
    """files: .blend files, each an object or several; textures: pictures for their base colour; relative to the
    recipe."""

    files: tuple[str, ...] = key(_files, ".blend")
    textures: tuple[str, ...] = key(_textures)
    count: Value = key(Table.value, 1, 0, 10000)
    low_m: list[float] = key(Table.numbers, count=3)
    high_m: list[float] = key(Table.numbers, count=3)
    size_m: Value = key(Table.value, low=1e-4, high=1e4)
    speed_m_s: Value = key(Table.value, 0.0, 0, 1e4)
    spin_deg_s: Value = key(Table.value, 0.0, -1e6, 1e6)
    turn: str = key(Table.text, "z", ("z", "any"))
    name: str | None = optional(Table.text, name="class")

    def draw(self, place: str, rng: Rng) -> list[dict[str, Any]]:
        """Objects in the format of `--place`, without names and with paths relative to the recipe."""
        found = []
        for i in range(round(self.count.draw(rng(f"{place}.count")))):
            of = rng(f"{place}.{i}")
            file = self.files[int(of.integers(len(self.files)))]
            turns = of.uniform(-180, 180, 3) * ((0, 0, 1) if self.turn == "z" else (1, 1, 1))
            heading = of.normal(size=3) * ((1, 1, 0) if self.turn == "z" else (1, 1, 1))
            axis = np.array([0.0, 0.0, 1.0]) if self.turn == "z" else _unit(of.normal(size=3))
            found.append(
                {
                    "file": file,
                    "texture": self.textures[int(of.integers(len(self.textures)))] if self.textures else None,
                    "class": self.name or Path(file).stem,
                    "size_m": float(self.size_m.draw(of)),
                    "position_m": of.uniform(self.low_m, self.high_m).tolist(),
                    "rotation_deg": turns.tolist(),
                    "velocity_m_s": (_unit(heading) * self.speed_m_s.draw(of)).tolist(),
                    "spin_deg_s": (axis * self.spin_deg_s.draw(of)).tolist(),
                }
            )
        return found


def _unit(vector: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else np.array([1.0, 0.0, 0.0])


def pools(scene: Table, key: str) -> tuple[Pool, ...]:
    found = tuple((table, table.into(Pool)) for table in scene.tables(key, []))
    for table, pool in found:
        if any(a > b for a, b in zip(pool.low_m, pool.high_m, strict=True)):
            raise table.wrong("low_m", "a corner below high_m")
    return tuple(pool for _, pool in found)


def placed(things: list[dict[str, Any]], beside: Path) -> list[dict[str, Any]]:
    """Objects in the format of `--place`, for a recipe in the folder `beside`."""
    found = []
    for number, thing in enumerate(things):
        files = {key: str((beside / thing[key]).resolve()) if thing[key] else None for key in ("file", "texture")}
        found.append(thing | files | {"name": f"{Path(thing['file']).stem}_{number:03d}"})
    return found
