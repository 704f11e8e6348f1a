"""A recipe (docs/reference/datasets.md): the configuration of a data set, and the values drawn for one sequence.

Each drawn value has a separate generator, keyed by the recipe's seed, the sequence's number and the value's name:
sequence 7 is the same in a set of ten and of a thousand, and a new range beside it changes no other value.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .._config import read_toml
from .._options import STAGE_KEYS
from .._text import MOST_BYTES, is_file_name
from ..chip import presets
from . import placing
from .checks import LIMITS
from .table import Table, Value
from .writers import WRITERS

SPLITS = ("train", "val", "test")
GOLDEN = 0.6180339887498949  # steps of this share keep any number of draws even (Weyl's sequence)
RENDER_KEYS = (  # options of `pecs_blender render` that a recipe may give
    *("bands", "placement", "bands_per_pass", "illuminant", "fps", "time", "step_px", "subpixels"),
    *("samples", "noise_events", "no_denoise", "light_tree", "device"),
)
TRUTH_LAYERS = ["depth", "normal", "objects", "motion"]  # by default; the renderer rejects unknown ones

TRAJECTORY_LISTS = ("step_m", "speed")  # pairs that are no range
MOST_SEQUENCES = 1_000_000
ORIGIN = (0.0, 0.0, 0.0)


def generator(seed: int, index: int, name: str) -> np.random.Generator:
    """The generator of one drawn value."""
    key = hashlib.blake2b(f"{seed} {index} {name}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=np.frombuffer(key, np.uint64)))


@dataclass(frozen=True)
class Film:
    """Exposure and film of an RGB camera (rgb.py)."""

    fps: float
    exposure_ms: Value
    peak_qe: float
    full_well_e: float
    read_noise_e: float
    bayer: str
    rolling_us: float  # from row to row
    phase_ms: Value
    sharp: bool
    steps: int  # of an exposure; 0: motion is at most half a pixel in each

    def rolled_us(self, height: int) -> float:
        """From the first row's exposure to the middle of the picture, and from there to the last row's."""
        return self.rolling_us * (height - 1) / 2


@dataclass(frozen=True)
class CameraEntry:
    """A camera of the rig. pixels_of: the camera whose place, lens and pixels it shares (a beam splitter). options: of
    its render."""

    name: str
    kind: str
    position_m: list[float]
    rotation_deg: list[float]
    width: int | None
    height: int | None
    chip: str | None
    pixel_pitch_um: float | None
    lens: str
    fnumber: Value | None
    focus_m: Value | None
    overrides: dict[str, Value]
    biases: dict[str, Value]
    stages: dict[str, Any]
    preset: str | None
    model: str
    partner: str | None
    pixels_of: str | None
    options: dict[str, Any]
    film: Film | None

    @property
    def has_light(self) -> bool:
        """Whether light is rendered for it. Event cameras of one place share it; an RGB camera has other bands."""
        return self.kind == "rgb" or not self.pixels_of


@dataclass(frozen=True)
class SceneEntry:
    name: str
    path: Path
    weight: float
    split: str | None
    parameters: dict[str, Value]
    options: dict[str, Any]
    light_scale: Value
    trajectory: dict[str, Any]
    pools: tuple[placing.Pool, ...]


@dataclass(frozen=True)
class Recipe:
    path: Path
    name: str
    seed: int
    sequences: int
    duration_s: Value
    splits: dict[str, float]
    scenes: tuple[SceneEntry, ...]
    cameras: tuple[CameraEntry, ...]
    imu: dict[str, Any] | None
    render: dict[str, Any]
    truth: dict[str, Any]
    keep: dict[str, bool]
    export: tuple[str, ...]
    limits: dict[str, float] = field(default_factory=dict)
    about: dict[str, str] = field(default_factory=dict)
    sha256: str = ""
    allow_scripts: bool = False  # by the caller, never by the recipe

    def rng(self, index: int, name: str) -> np.random.Generator:
        return generator(self.seed, index, name)

    def draw(self, index: int) -> dict[str, Any]:
        """The drawn values of sequence `index`, as written to its sequence.json."""
        scene = self.scenes[self._place(index, "scene", [s.weight for s in self.scenes])]
        share = [self.splits.get(name, 0.0) for name in SPLITS]
        split = scene.split or SPLITS[self._place(index, "split", share)]

        def drawn(name: str, value: Value) -> Any:
            return value.draw(self.rng(index, name))

        def camera(entry: CameraEntry) -> dict[str, Any]:
            at = f"camera.{min(entry.name, entry.partner or entry.name)}"  # partners are set alike
            found: dict[str, Any] = {
                "overrides": {k: drawn(f"{at}.set.{k}", v) for k, v in entry.overrides.items()},
                "biases": {k: drawn(f"{at}.bias.{k}", v) for k, v in entry.biases.items()},
                "seed": int(self.rng(index, f"camera.{entry.name}.seed").integers(2**31)),
            }
            for key in ("fnumber", "focus_m"):
                value: Value | None = getattr(entry, key)
                found[key] = drawn(f"{at}.{key}", value) if value else None
            if entry.film:
                found["exposure_ms"] = drawn(f"{at}.exposure_ms", entry.film.exposure_ms)
                found["phase_ms"] = drawn(f"{at}.phase_ms", entry.film.phase_ms)
            return found

        return {
            "scene": scene.name,
            "split": split,
            "duration_s": self._whole_intervals(drawn("duration_s", self.duration_s)),
            "parameters": {k: drawn(f"scene.{scene.name}.{k}", v) for k, v in scene.parameters.items()},
            "place": [
                thing
                for i, pool in enumerate(scene.pools)
                for thing in pool.draw(f"scene.{scene.name}.place[{i}]", lambda name: self.rng(index, name))
            ],
            "light_scale": drawn(f"scene.{scene.name}.light_scale", scene.light_scale),
            "trajectory": {
                k: drawn(f"trajectory.{k}", v) if isinstance(v, Value) else v for k, v in scene.trajectory.items()
            },
            "cameras": {entry.name: camera(entry) for entry in self.cameras},
        }

    def camera(self, name: str) -> CameraEntry:
        return next(c for c in self.cameras if c.name == name)

    def owner(self, entry: CameraEntry) -> CameraEntry:
        """The camera whose pixels it shares, or the camera itself."""
        return self.camera(entry.pixels_of) if entry.pixels_of else entry

    def scene(self, name: str) -> SceneEntry:
        return next(s for s in self.scenes if s.name == name)

    def render_options(self, scene: SceneEntry, camera: CameraEntry) -> dict[str, Any]:
        """Options of the light."""
        return self.render | scene.options | camera.options | self.permission

    @property
    def permission(self) -> dict[str, bool]:
        """The renderer's option that the caller's permission sets."""
        return {"allow_scripts": True} if self.allow_scripts else {}

    def truth_frames(self, duration_s: float) -> int:
        return math.floor(duration_s * self.truth["fps"] + 1e-9) + 1

    def _whole_intervals(self, seconds: float) -> float:
        """At least `seconds`, and a whole number of intervals of the ground truth, so that all events are within it."""
        if not self.truth["layers"]:
            return seconds
        return math.ceil(seconds * self.truth["fps"] - 1e-9) / self.truth["fps"]

    def _place(self, index: int, name: str, weights: list[float]) -> int:
        """Index of the weights; the shares are even for any number of sequences."""
        begin = float(self.rng(0, name).uniform())
        ends = np.cumsum(weights) / sum(weights)
        return int(np.searchsorted(ends, (begin + index * GOLDEN) % 1.0, side="right").clip(0, len(weights) - 1))


def load(path: Path) -> Recipe:
    top = Table(read_toml(path), path)
    cameras = _rig(rig := top.table("rig"))
    imu = rig.optional(rig.table, "imu")
    rig.done()
    common = _trajectory(top.table("trajectory", {}))
    scenes = tuple(_scene(table, path.parent, common) for table in top.tables("scene", least=1))
    _unique(top, "scene", [s.name for s in scenes])
    splits = top.table("split", {})
    about, truth, keep, limits = (top.table(key, {}) for key in ("about", "truth", "keep", "limits"))
    export = top.texts("export", [], choices=tuple(WRITERS))
    recipe = Recipe(
        path=path,
        name=top.text("name", path.stem),
        seed=top.integer("seed", 1),
        sequences=top.integer("sequences", 1, low=1, high=MOST_SEQUENCES),
        duration_s=top.value("duration_s", low=1e-3, high=3600),
        splits={k: splits.number(k, 0.0, 0, 1) for k in SPLITS} if splits.keys() else {"train": 1.0},
        scenes=scenes,
        cameras=cameras,
        imu={
            "part": imu.text("part", "ideal"),
            "rate_hz": imu.number("rate_hz", 1000, 1, 1e5),
            "position_m": imu.numbers("position_m", ORIGIN, count=3),
            "rotation_deg": imu.numbers("rotation_deg", ORIGIN, count=3),
            "turn_on": imu.number("turn_on", 0.0, 0, 10),
        }
        if imu
        else None,
        render={"time": "adaptive", "fps": 1000.0} | _options(top.table("render", {})),
        truth={"fps": truth.number("fps", 20.0, 1e-3, 1e5), "layers": truth.texts("layers", TRUTH_LAYERS)},
        keep={key: keep.flag(key, True) for key in ("light", "truth")},
        export=tuple(export),
        limits=_limits(limits),
        about={k: about.text(k, lines=True) for k in about.keys()},
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
    )
    for table in (splits, about, truth, keep, limits, *([imu] if imu else []), top):
        table.done()
    if sum(recipe.splits.values()) <= 0:
        raise top.fail("split", "no share above 0", f"shares of {', '.join(SPLITS)}")
    return recipe


def _limits(table: Table) -> dict[str, float]:
    """Limits of the quality of a sequence (checks.py); speed_m_per_s also of the trajectories."""
    found = {key: table.number(key, value, 0, 1) for key, value in LIMITS.items()}
    speed = table.optional(table.number, "speed_m_per_s", low=1e-3, high=1e4)
    return found if speed is None else found | {"speed_m_per_s": speed}


def _unique(top: Table, place: str, names: list[str]) -> None:
    for name in names:
        if sum(name.casefold() == other.casefold() for other in names) > 1:
            raise top.fail(place, f"the name {name!r} twice", "names of their own")
        if not all(c.isalnum() or c in "_-" for c in name) or not is_file_name(name):
            raise top.fail(place, f"the name {name!r}", f"letters, digits, _ and -, at most {MOST_BYTES} bytes")


def _scene(table: Table, beside: Path, common: dict[str, Any]) -> SceneEntry:
    path = Path(table.text("path"))
    path = path if path.is_absolute() else beside / path
    if not path.exists():
        raise table.fail("path", str(path), "a .blend file or a scene folder that is there")
    parameters = table.table("set", {})
    found = SceneEntry(
        name=table.text("name", path.stem),
        path=path.resolve(),
        weight=table.number("weight", 1.0, 1e-6, 1e6),
        split=table.optional(table.text, "split", choices=SPLITS),
        parameters={
            k: (parameters.drawn if k.endswith(("_spectrum", "_reflectance")) else parameters.value)(k)
            for k in parameters.keys()
        },
        options=_options(table.table("options", {})),
        light_scale=table.value("light_scale", 1.0, 1e-9, 1e9),
        pools=tuple(placing.read(t, beside) for t in table.tables("place", [])),
        trajectory=common | _trajectory(table.table("trajectory", {})),
    )
    if "kind" not in found.trajectory:
        raise table.fail("trajectory", "nothing", "a table with kind, here or at the top")
    table.done()
    return found


def _trajectory(table: Table) -> dict[str, Any]:
    """Numbers and tables of ranges are drawn; lists of three and more, texts and flags are the trajectory's own
    (trajectories.py checks them)."""
    found: dict[str, Any] = {}
    for key in table.keys():
        value = table.any(key)
        pair = isinstance(value, list) and len(value) == 2 and not any(isinstance(v, (list, str)) for v in value)
        drawn = isinstance(value, dict) or (pair and key not in TRAJECTORY_LISTS)
        found[key] = table.drawn(key) if drawn else value
    return found


def _options(table: Table) -> dict[str, Any]:
    for key in table.keys():
        if key == "allow_scripts":
            raise table.fail(key, "a permission in the recipe", "the flag --allow-scripts of pecs dataset")
        if key not in RENDER_KEYS:
            raise table.fail(key, "an unknown option", f"one of {', '.join(RENDER_KEYS)}")
    return {key: table.any(key) for key in table.keys()}


def _rig(rig: Table) -> tuple[CameraEntry, ...]:
    tables = rig.tables("camera", least=1)
    cameras = tuple(map(_camera, tables))
    _unique(rig, "camera", [c.name for c in cameras])
    by_name = {c.name: c for c in cameras}
    for table, camera in zip(tables, cameras, strict=True):
        for key in ("partner", "pixels_of"):
            other = getattr(camera, key)
            if other is not None and (other not in by_name or other == camera.name):
                raise table.fail(key, other, "the name of another camera of the rig")
        if camera.pixels_of and by_name[camera.pixels_of].pixels_of:
            raise table.fail("pixels_of", camera.pixels_of, "a camera with pixels of its own")
    return cameras


def _camera(table: Table) -> CameraEntry:
    kind = table.text("kind", choices=("events", "rgb"))
    shared = table.optional(table.text, "pixels_of")
    overrides, biases, stages = (table.table(key, {}) for key in ("set", "bias", "stages"))
    for key in stages.keys():
        if key not in STAGE_KEYS:
            raise stages.fail(key, "an unknown stage", f"one of {', '.join(STAGE_KEYS)}")
    own = shared is None
    preset, model = _pixel(table)
    found = CameraEntry(
        name=table.text("name"),
        kind=kind,
        position_m=table.numbers("position_m", ORIGIN, count=3),
        rotation_deg=table.numbers("rotation_deg", ORIGIN, count=3),
        width=table.optional(table.integer, "width", low=8, high=8192),
        height=table.optional(table.integer, "height", low=8, high=8192),
        chip=table.text("chip") if kind == "events" else None,
        pixel_pitch_um=table.number("pixel_pitch_um", low=0.5, high=100) if kind == "rgb" and own else None,
        lens=table.text("lens") if own else "",
        fnumber=table.optional(table.value, "fnumber", low=0.5, high=1000) if own else None,
        focus_m=table.optional(table.value, "focus_m", low=1e-3, high=1e9) if own else None,
        overrides={k: overrides.value(k) for k in overrides.keys()},
        biases={k: biases.value(k) for k in biases.keys()},
        stages={k: _stage(stages, k) for k in stages.keys()},
        preset=preset,
        model=model,
        partner=table.optional(table.text, "partner"),
        pixels_of=shared,
        options=_options(table.table("options", {})) if own or kind == "rgb" else {},
        film=_film(table) if kind == "rgb" else None,
    )
    if kind == "rgb" and own and not (found.width and found.height):
        raise table.fail("width", "nothing", "width and height of an RGB camera")
    table.done()
    return found


def _pixel(table: Table) -> tuple[str | None, str]:
    """Preset, if any, and pixel model."""
    if not table.has("preset"):
        return None, table.text("model", "pecs")
    known = {preset["name"]: preset["model"] for preset in presets()}
    preset = table.text("preset", choices=tuple(known))
    return preset, known[preset]


def _stage(table: Table, key: str) -> Any:
    """A file, beside the recipe, or what the sensor checks."""
    return table.text(key) if key == "mask" else table.any(key)


def _film(table: Table) -> Film:
    return Film(
        fps=table.number("fps", 20.0, 1e-3, 1e5),
        exposure_ms=table.value("exposure_ms", 5.0, 1e-3, 1e4),
        peak_qe=table.number("peak_qe", 0.6, 0.01, 1),
        full_well_e=table.number("full_well_e", 10000.0, 10, 1e7),
        read_noise_e=table.number("read_noise_e", 3.0, 0, 1e4),
        bayer=table.text("bayer", "rggb", ("rggb", "bggr", "grbg", "gbrg", "none")),
        rolling_us=table.number("rolling_us", 0.0, 0, 1e4),
        phase_ms=table.value("phase_ms", 0.0, 0, 1e6),
        sharp=table.flag("sharp", True),
        steps=table.integer("steps", 0, 0, 4096),
    )
