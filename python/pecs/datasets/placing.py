"""Objects and textures from pools, drawn into a scene: [[scene.place]] of a recipe. The renderer places them by
`--place` (docs/reference/render.md)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from .._config import read_json
from .._files import read_bytes
from .table import Table, Value, key, optional, without

MOST_BYTES, MOST_TEXT = 1 << 28, 1 << 32  # bytes of a .gltf; of an .obj
Rng = Callable[[str], np.random.Generator]


MODELS = (".blend", ".obj", ".ply", ".glb", ".gltf", ".fbx", ".usd", ".usda", ".usdc", ".usdz")  # read by the renderer
OWN_AXES = (".obj", ".ply")  # that do not say which axis points up


def _files(table: Table, key: str, *kinds: str) -> tuple[str, ...]:
    """Files of a pattern, sorted, so that the same set of files gives the same draws."""
    pattern, beside = table.text(key), Path(str(table.file)).parent
    whole = f"{pattern}/**/*" if (beside / pattern).is_dir() else pattern
    if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
        raise table.fail(key, pattern, "files in the recipe's folder, of which a link may lead elsewhere")
    there = beside.glob(whole)
    found = sorted(str(p.relative_to(beside)) for p in there if p.suffix.lower() in kinds)
    if not found:
        raise table.fail(
            key, f"{pattern}: no file", f"a folder or a pattern of {', '.join(kinds)} files in the recipe's folder"
        )
    return tuple(found)


def _up(table: Table, key: str) -> str | None:
    if not table.has(key):
        return None
    others = [name for name in _files(table, "files", *MODELS) if Path(name).suffix.lower() not in OWN_AXES]
    if others:
        raise table.fail(key, f"an axis for {others[0]}", f"files of {', '.join(OWN_AXES)} alone; other files have it")
    return table.text(key, choices=("y", "z"))


def _class(path: Path, by: str) -> str:
    return path.stem if by == "file" else path.parent.name or path.stem


@dataclass(frozen=True)
class Pool:
    """files: models, each an object or several; textures: pictures for their base colour; relative to the
    recipe."""

    files: tuple[str, ...] = key(_files, *MODELS)
    textures: tuple[str, ...] | None = optional(_files, ".png", ".jpg", ".jpeg", ".exr")
    count: Value = key(Table.value, 1, 0, 10000)
    low_m: list[float] = key(Table.numbers, count=3)
    high_m: list[float] = key(Table.numbers, count=3)
    size_m: Value | None = optional(Table.value, low=1e-4, high=1e4)
    unit_m: float = key(Table.number, 1.0, 1e-6, 1e6, only=without("size_m"), absent=1.0)
    up: str | None = key(_up)
    speed_m_s: Value = key(Table.value, 0.0, 0, 1e4)
    spin_deg_s: Value = key(Table.value, 0.0, -1e6, 1e6)
    turn: str = key(Table.text, "z", ("z", "any"))
    name: str | None = optional(Table.text, name="class")
    class_by: str = key(Table.text, "file", ("file", "folder"), only=without("class"), absent="file")

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
                    "class": self.name or _class(Path(file), self.class_by),
                    "size_m": float(self.size_m.draw(of)) if self.size_m else None,
                    **({} if self.size_m else {"unit_m": self.unit_m}),
                    **({"up": self.up} if self.up else {}),
                    "low_m": self.low_m,
                    "high_m": self.high_m,
                    "position_m": of.uniform(self.low_m, self.high_m).tolist(),
                    "rotation_deg": turns.tolist(),
                    "velocity_m_s": (_unit(heading) * self.speed_m_s.draw(of)).tolist(),
                    "spin_deg_s": (axis * self.spin_deg_s.draw(of)).tolist(),
                }
            )
        return found


@dataclass(frozen=True)
class Sky:
    """files: pictures of all directions (HDRI), relative to the recipe. lux: on a horizontal surface."""

    files: tuple[str, ...] = key(_files, ".hdr", ".exr")
    lux: Value = key(Table.value, low=1e-6, high=1e7)
    turn_deg: Value = key(Table.value, 0.0, -360, 360)

    def draw(self, of: np.random.Generator) -> dict[str, Any]:
        file = self.files[int(of.integers(len(self.files)))]
        return {"file": file, "lux": float(self.lux.draw(of)), "turn_deg": float(self.turn_deg.draw(of))}


def _unit(vector: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else np.array([1.0, 0.0, 0.0])


def pools(scene: Table, key: str) -> tuple[Pool, ...]:
    found = tuple((table, table.into(Pool)) for table in scene.tables(key, []))
    for table, pool in found:
        if any(a > b for a, b in zip(pool.low_m, pool.high_m, strict=True)):
            raise table.wrong("low_m", "a corner below high_m")
    return tuple(pool for _, pool in found)


def read_with(model: Path) -> list[Path]:
    """Files that a model names: materials and textures of an .obj, buffers and textures of a .gltf."""
    if model.suffix.lower() == ".obj":
        found = [model.parent / name for name in _named(model, "mtllib")]
        found += [file.parent / name for file in found for name in _named(file, "map_", "bump", "disp", "norm", "refl")]
    elif model.suffix.lower() == ".gltf":
        content = read_json(model, MOST_BYTES)
        uris = [
            one.get("uri") for key in ("buffers", "images") for one in content.get(key, []) if isinstance(one, dict)
        ]
        found = [model.parent / unquote(uri) for uri in uris if isinstance(uri, str) and not uri.startswith("data:")]
    else:
        found = []
    return [path for path in found if path.is_file()]


def _named(file: Path, *words: str) -> list[str]:
    """Last words of the lines of a text that begin with one of these."""
    if not file.is_file():
        return []
    lines = (line.split() for line in read_bytes(file, MOST_TEXT).decode(errors="replace").splitlines())
    return [line[-1] for line in lines if len(line) > 1 and line[0].lower().startswith(words)]


def placed(things: list[dict[str, Any]], beside: Path) -> list[dict[str, Any]]:
    """Objects in the format of `--place`, for a recipe in the folder `beside`."""
    found: list[dict[str, Any]] = []
    for number, thing in enumerate(things):
        files = {key: str((beside / thing[key]).resolve()) if thing[key] else None for key in ("file", "texture")}
        own = {key: value for key, value in thing.items() if key not in ("low_m", "high_m")}
        found.append(own | files | {"name": f"{Path(thing['file']).stem}_{number:03d}"})
    return found
