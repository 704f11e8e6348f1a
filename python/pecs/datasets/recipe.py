"""A recipe (docs/reference/datasets.md): the configuration of a data set, read and checked as far as its tables go.
plan.py draws its sequences.

To add a key: a field below, with how it is read, and its use in plan.py.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from .._config import MAX_BYTES, parse_toml
from .._files import read_text
from .._options import STAGE_KEYS
from .._text import MOST_BYTES, is_file_name
from ..chip import presets
from . import placing
from .blender import scene_folders
from .checks import LIMITS
from .table import Table, Value, key, optional, without
from .writers import WRITERS

SPLITS = ("train", "val", "test")
RENDER_KEYS = (  # options of `pecs_blender render` that a recipe may give
    *("bands", "placement", "bands_per_pass", "illuminant", "fps", "time", "step_px", "subpixels"),
    *("samples", "noise_events", "no_denoise", "light_tree", "engine", "device"),
)
RENDER = {"time": "adaptive", "fps": 1000.0}  # by default
TRUTH_LAYERS = ["depth", "normal", "objects", "motion"]  # by default; the renderer rejects unknown ones
TRAJECTORY_LISTS = ("step_m", "speed")  # pairs that are no range
MOST_SEQUENCES = 1_000_000
OWN_LENS = "none"  # a camera of the .blend
ORIGIN = (0.0, 0.0, 0.0)


# How free keys are read


def _option(table: Table, key: str) -> Any:
    if key == "allow_scripts":
        raise table.fail(key, "a permission in the recipe", "the flag --allow-scripts of pecs dataset")
    if key not in RENDER_KEYS:
        raise table.fail(key, "an unknown option", f"one of {', '.join(RENDER_KEYS)}")
    return table.any(key)


def _stage(table: Table, key: str) -> Any:
    """A file, or what the sensor checks."""
    if key not in STAGE_KEYS:
        raise table.fail(key, "an unknown stage", f"one of {', '.join(STAGE_KEYS)}")
    return table.text(key) if key == "mask" else table.any(key)


def _parameter(table: Table, key: str) -> Value:
    return (table.drawn if key.endswith(("_spectrum", "_reflectance")) else table.value)(key)


def _motion(table: Table, key: str) -> Any:
    """Numbers and tables of ranges are drawn; lists of three and more, texts and flags are the trajectory's own
    (trajectories.py checks them)."""
    value = table.any(key)
    pair = isinstance(value, list) and len(value) == 2 and not any(isinstance(v, (list, str)) for v in value)
    return table.drawn(key) if isinstance(value, dict) or (pair and key not in TRAJECTORY_LISTS) else value


def _splits(table: Table, key: str) -> dict[str, float]:
    shares = table.table(key, {"train": 1.0})
    found = {name: shares.number(name, 0.0, 0, 1) for name in SPLITS} if shares.keys() else {"train": 1.0}
    shares.done()
    if sum(found.values()) <= 0:
        raise table.fail(key, "no share above 0", f"shares of {', '.join(SPLITS)}")
    return found


def _limits(table: Table, key: str) -> dict[str, float]:
    """Limits of the quality of a sequence (checks.py); speed_m_per_s also of the trajectories."""
    limits = table.table(key, {})
    found = {name: limits.number(name, value, 0, 1) for name, value in LIMITS.items()}
    if limits.has("speed_m_per_s"):
        found["speed_m_per_s"] = limits.number("speed_m_per_s", low=1e-3, high=1e4)
    limits.done()
    return found


# The rig


_owns_pixels = without("pixels_of")


def _is_rgb(table: Table) -> bool:
    return table.text("kind") == "rgb"


def _is_events(table: Table) -> bool:
    return not _is_rgb(table)


def _owns_film(table: Table) -> bool:
    return _is_rgb(table) and _owns_pixels(table)


def _has_own_lens(table: Table) -> bool:
    """That of a .blend's camera."""
    return _owns_pixels(table) and table.text("lens") == OWN_LENS


def _has_traced_lens(table: Table) -> bool:
    return _owns_pixels(table) and not _has_own_lens(table)


def _has_light(table: Table) -> bool:
    return _is_rgb(table) or _owns_pixels(table)


@dataclass(frozen=True)
class Film:
    """Exposure and film of an RGB camera (rgb.py). rolling_us: from row to row; steps: of an exposure, 0: motion is at
    most half a pixel in each."""

    fps: float = key(Table.number, 20.0, 1e-3, 1e5)
    exposure_ms: Value = key(Table.value, 5.0, 1e-3, 1e4)
    peak_qe: float = key(Table.number, 0.6, 0.01, 1)
    full_well_e: float = key(Table.number, 10000.0, 10, 1e7)
    read_noise_e: float = key(Table.number, 3.0, 0, 1e4)
    bayer: str = key(Table.text, "rggb", ("rggb", "bggr", "grbg", "gbrg", "none"))
    rolling_us: float = key(Table.number, 0.0, 0, 1e4)
    phase_ms: Value = key(Table.value, 0.0, 0, 1e6)
    sharp: bool = key(Table.flag, True)
    steps: int = key(Table.integer, 0, 0, 4096)

    def rolled_us(self, height: int) -> float:
        """From the first row's exposure to the middle of the picture, and from there to the last row's."""
        return self.rolling_us * (height - 1) / 2


def _preset(table: Table, key: str) -> str | None:
    return table.text(key, choices=tuple(preset["name"] for preset in presets())) if table.has(key) else None


def _model(table: Table, key: str) -> str:
    """The pixel model, which a preset sets."""
    name = _preset(table, "preset")
    return next(p["model"] for p in presets() if p["name"] == name) if name else table.text(key, "pecs")


@dataclass(frozen=True)
class CameraEntry:
    """A camera of the rig. pixels_of: the camera whose place, lens and pixels it shares (a beam splitter). frames: the
    chip also takes frames, as a DAVIS. options: of its render. camera: of the .blend, whose optics a rig camera with
    the lens "none" has; by default the active one."""

    name: str = key(Table.text)
    kind: str = key(Table.text, choices=("events", "rgb"))
    position_m: list[float] = key(Table.numbers, ORIGIN, count=3, only=_owns_pixels, absent=list(ORIGIN))
    rotation_deg: list[float] = key(Table.numbers, ORIGIN, count=3, only=_owns_pixels, absent=list(ORIGIN))
    width: int | None = optional(Table.integer, low=8, high=8192, only=_owns_pixels)
    height: int | None = optional(Table.integer, low=8, high=8192, only=_owns_pixels)
    chip: str | None = key(Table.text, only=_is_events)
    pixel_pitch_um: float | None = key(Table.number, low=0.5, high=100, only=_owns_film)
    lens: str = key(Table.text, only=_owns_pixels, absent="")
    camera: str | None = optional(Table.text, only=_has_own_lens)
    fnumber: Value | None = optional(Table.value, low=0.5, high=1000, only=_owns_pixels)
    focus_m: Value | None = optional(Table.value, low=1e-3, high=1e9, only=_has_traced_lens)
    overrides: dict[str, Value] = key(Table.all, Table.value, name="set", only=_is_events, absent={})
    biases: dict[str, Value] = key(Table.all, Table.value, name="bias", only=_is_events, absent={})
    stages: dict[str, Any] = key(Table.all, _stage, only=_is_events, absent={})
    frames: bool = key(Table.flag, False, only=_is_events, absent=False)
    preset: str | None = key(_preset, only=_is_events)
    model: str = key(_model, only=_is_events, absent="pecs")
    partner: str | None = optional(Table.text)
    pixels_of: str | None = optional(Table.text)
    options: dict[str, Any] = key(Table.all, _option, only=_has_light, absent={})
    film: Film | None = key(lambda table, key: table.into(Film), only=_is_rgb)  # its keys are the camera's

    @property
    def has_light(self) -> bool:
        """Whether light is rendered for it. Event cameras of one place share it; an RGB camera has other bands."""
        return self.kind == "rgb" or not self.pixels_of


@dataclass(frozen=True)
class ImuEntry:
    part: str = key(Table.text, "ideal")
    rate_hz: float = key(Table.number, 1000, 1, 1e5)
    position_m: list[float] = key(Table.numbers, ORIGIN, count=3)
    rotation_deg: list[float] = key(Table.numbers, ORIGIN, count=3)
    turn_on: float = key(Table.number, 0.0, 0, 10)


def _cameras(rig: Table) -> tuple[CameraEntry, ...]:
    tables = rig.tables("camera", least=1)
    cameras = tuple(table.into(CameraEntry) for table in tables)
    _unique(rig, "camera", [c.name for c in cameras])
    by_name = {c.name: c for c in cameras}
    for table, camera in zip(tables, cameras, strict=True):
        if camera.kind == "rgb" and not camera.pixels_of and not (camera.width and camera.height):
            raise table.fail("width", "nothing", "width and height of an RGB camera")
        for other in ("partner", "pixels_of"):
            name = getattr(camera, other)
            if name is not None and (name not in by_name or name == camera.name):
                raise table.fail(other, name, "the name of another camera of the rig")
        if camera.pixels_of and by_name[camera.pixels_of].pixels_of:
            raise table.fail("pixels_of", camera.pixels_of, "a camera with pixels of its own")
    return cameras


def _unique(top: Table, place: str, names: list[str]) -> None:
    for name in names:
        if sum(name.casefold() == other.casefold() for other in names) > 1:
            raise top.fail(place, f"the name {name!r} twice", "names of their own")
        if not all(c.isalnum() or c in "_-" for c in name) or not is_file_name(name):
            raise top.fail(place, f"the name {name!r}", f"letters, digits, _ and -, at most {MOST_BYTES} bytes")


# The set


def _path(table: Table, key: str) -> Path:
    """A file or a folder in that of the recipe, or the name of a scene of PECS."""
    path = Path(str(table.file)).parent / table.text(key)
    if is_file_name(name := table.text(key)) and not path.exists():
        path = next((folder / name for folder in scene_folders() if (folder / name).is_dir()), path)
    if not path.exists() and not path.resolve().exists():  # the recipe's folder may be made later
        raise table.fail(key, str(path), "a .blend file or a scene folder that is there")
    return path


@dataclass(frozen=True)
class SceneEntry:
    path: Path = key(lambda table, key: _path(table, key).resolve())
    name: str = key(lambda table, key: table.text(key, _path(table, "path").stem))
    weight: float = key(Table.number, 1.0, 1e-6, 1e6)
    split: str | None = optional(Table.text, choices=SPLITS)
    parameters: dict[str, Value] = key(Table.all, _parameter, name="set")
    options: dict[str, Any] = key(Table.all, _option)
    light_scale: Value = key(Table.value, 1.0, 1e-9, 1e9)
    pools: tuple[placing.Pool, ...] = key(placing.pools, name="place")
    sky: placing.Sky | None = optional(Table.part, placing.Sky)
    trajectory: dict[str, Any] = key(Table.all, _motion)


def _scene(table: Table, common: dict[str, Any]) -> SceneEntry:
    found = table.into(SceneEntry)
    if "kind" not in (trajectory := common | found.trajectory):
        raise table.fail("trajectory", "nothing", "a table with kind, here or at the top")
    return replace(found, trajectory=trajectory)


@dataclass(frozen=True)
class Truth:
    fps: float = key(Table.number, 20.0, 1e-3, 1e5)
    layers: list[str] = key(Table.texts, TRUTH_LAYERS)


@dataclass(frozen=True)
class Keep:
    """Whether stacks are kept."""

    light: bool = key(Table.flag, True)
    truth: bool = key(Table.flag, True)


@dataclass(frozen=True)
class Recipe:
    path: Path
    sha256: str
    scenes: tuple[SceneEntry, ...]
    cameras: tuple[CameraEntry, ...]
    imu: ImuEntry | None
    name: str = key(lambda table, key: table.text(key, Path(str(table.file)).stem))
    seed: int = key(Table.integer, 1)
    sequences: int = key(Table.integer, 1, low=1, high=MOST_SEQUENCES)
    duration_s: Value = key(Table.value, low=1e-3, high=3600)
    splits: dict[str, float] = key(_splits, name="split")
    render: dict[str, Any] = key(lambda table, key: RENDER | table.all(key, _option))
    truth: Truth = key(Table.part, Truth)
    keep: Keep = key(Table.part, Keep)
    export: list[str] = key(Table.texts, [], choices=tuple(WRITERS))
    limits: dict[str, float] = key(_limits)
    about: dict[str, str] = key(Table.all, partial(Table.text, lines=True))
    allow_scripts: bool = False  # by the caller, never by the recipe

    @property
    def permission(self) -> dict[str, bool]:
        """The renderer's option that the caller's permission sets."""
        return {"allow_scripts": True} if self.allow_scripts else {}


def load(path: Path, text: str | None = None) -> Recipe:
    """text: of the recipe, if the file may not exist yet."""
    text = read_text(path, MAX_BYTES, "TOML") if text is None else text
    top = Table(parse_toml(text, path), path)
    rig = top.table("rig")
    cameras, imu = _cameras(rig), rig.part("imu", ImuEntry) if rig.has("imu") else None
    rig.done()
    common = top.all("trajectory", _motion)
    scenes = tuple(_scene(table, common) for table in top.tables("scene", least=1))
    _unique(top, "scene", [scene.name for scene in scenes])
    digest = hashlib.sha256(text.encode()).hexdigest()
    return top.into(Recipe, path=path, sha256=digest, scenes=scenes, cameras=cameras, imu=imu)
