"""The plan of a data set: its sequences, with all that they are made from, drawn from the recipe. The checks, --plan,
the run and a resumed run read the plan; nothing else is drawn or resolved.

Each drawn value has a separate generator, keyed by the recipe's seed, the sequence's number and the value's name:
sequence 7 is the same in a set of ten and of a thousand, and a further range changes no other value.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .._config import is_number
from .._errors import ExitCode, PecsError, PecsInputError
from ..chip import Chip
from . import placing, rgb, rig
from .imu import Imu
from .recipe import SPLITS, CameraEntry, Recipe, SceneEntry
from .table import Value

GOLDEN = 0.6180339887498949  # steps of this share keep any number of draws even (Weyl's sequence)
PATH_HZ = 1000.0  # of camera paths, at least; the renderer goes straight between
PLACE = "place.json"  # objects and sky of a sequence that is being made
OF_SCENE = "scene"  # kind of trajectory
OF_LIGHT = ("time", "fps", "step_px", "subpixels", "noise_events")
Draw = Callable[[str, Value], Any]


def generator(seed: int, index: int, name: str) -> np.random.Generator:
    """The generator of one drawn value."""
    key = hashlib.blake2b(f"{seed} {index} {name}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=np.frombuffer(key, np.uint64)))


@contextmanager
def at(recipe: Recipe, place: str) -> Iterator[None]:
    """Adds the recipe and the place to an error, unless it has them."""
    try:
        yield
    except PecsError as e:
        text = str(e)
        code = ExitCode.BAD_INPUT if e.code == ExitCode.USAGE else e.code
        message = text if text.startswith(f"{recipe.path}: ") else f"{recipe.path}: {place}: {text}"
        raise PecsError(message, code) from None


@dataclass(frozen=True)
class Pixels:
    """Pixels of a camera. owner: the camera whose place, lens and pixels it has, often the camera itself. chip, mask:
    names, or files in the recipe's folder."""

    owner: CameraEntry
    width: int
    height: int
    pitch_um: float
    chip: str | Path
    mask: str | Path | None


@dataclass(frozen=True)
class CameraPlan:
    """A camera in a sequence, with its drawn values. seed: of its events."""

    entry: CameraEntry
    pixels: Pixels
    overrides: dict[str, float]
    biases: dict[str, float]
    seed: int
    fnumber: float | None = None
    focus_m: float | None = None
    exposure_ms: float = 0.0
    phase_ms: float = 0.0

    @property
    def name(self) -> str:
        return self.entry.name

    @property
    def owns_pixels(self) -> bool:
        return self.pixels.owner is self.entry

    @property
    def rig_from_camera(self) -> rig.Array:
        return rig.rig_from_camera(self.entry.position_m, self.entry.rotation_deg)

    @property
    def stack(self) -> str:
        """The folder of its light in the sequence."""
        return f"{self.name if self.entry.has_light else self.pixels.owner.name}/stack"

    @property
    def truth(self) -> str:
        """The folder of its ground truth."""
        return f"{self.pixels.owner.name}/truth"

    @property
    def drawn(self) -> dict[str, Any]:
        """As sequence.json records it."""
        keys = ("overrides", "biases", "seed", "fnumber", "focus_m", "exposure_ms", "phase_ms")
        return {key: getattr(self, key) for key in keys[: None if self.entry.film else -2]}

    @property
    def film(self) -> str:
        """The chip that determines the width of its film and its bands: a name, or a file in the sequence."""
        name = "chip.json" if self.entry.kind == "events" else "film.json"
        return f"{self.name}/{name}" if isinstance(self.pixels.chip, Path) or self.entry.film else str(self.pixels.chip)

    def sensor(self) -> dict[str, Any]:
        """Options of the sensor; files are where the recipe has them."""
        values = {"chip": self.pixels.chip, "overrides": self.overrides, "biases": self.biases}
        mask = {"mask": self.pixels.mask} if self.pixels.mask else {}
        pixel = {"preset": self.entry.preset} if self.entry.preset else {"model": self.entry.model}
        return values | self.entry.stages | mask | pixel


@dataclass(frozen=True)
class SequencePlan:
    """A sequence. place: objects from pools; sky: its picture; kind, trajectory: the drawn parameters of the rig's
    motion."""

    recipe: Recipe
    index: int
    imu: Imu | None
    scene: SceneEntry
    split: str
    duration_s: float
    parameters: dict[str, Any]
    place: list[dict[str, Any]]
    sky: dict[str, Any] | None
    light_scale: float
    trajectory: dict[str, Any]
    cameras: tuple[CameraPlan, ...]

    @property
    def name(self) -> str:
        return f"{self.index:04d}"

    @property
    def duration_us(self) -> int:
        return round(self.duration_s * 1e6)

    @property
    def truth_frames(self) -> int:
        return math.floor(self.duration_s * self.recipe.truth.fps + 1e-9) + 1

    @property
    def path_hz(self) -> float:
        return max(PATH_HZ, _fps(self.recipe.render))

    @property
    def end_s(self) -> float:
        """End of the sequence, or the last instant of light if it is later than two samples of the path behind."""
        rates = [_fps(self.light(camera)) for camera in self.with_light]
        last_s = max(math.ceil(self.duration_s * fps - 1e-9) / fps for fps in rates)
        return last_s if last_s > self.duration_s + 2 / self.path_hz else self.duration_s

    @property
    def path(self) -> tuple[str, dict[str, Any]]:
        """Kind and parameters for `trajectories.plan`."""
        given = self.trajectory | {"duration_s": self.end_s + 3 / self.path_hz}
        if "file" in given:
            given["file"] = str(self.recipe.path.parent / str(given["file"]))
        if "speed_m_per_s" in self.recipe.limits:
            given.setdefault("max_speed_m_per_s", self.recipe.limits["speed_m_per_s"])
        return given.pop("kind"), given

    @property
    def follows_scene(self) -> bool:
        """Whether the rig has the motion of the .blend's camera (scene_cameras.py)."""
        return self.trajectory["kind"] == OF_SCENE

    @property
    def scene_words(self) -> list[Any]:
        """Arguments of the renderer: the scene and its drawn parameters."""
        place = ["--place", PLACE] if self.place or self.sky else []
        return [self.scene.path, *(f"--set={key}={value}" for key, value in self.parameters.items()), *place]

    def light(self, camera: CameraPlan) -> dict[str, Any]:
        """Options of the render of a camera's light, without the frames."""
        recipe, owner = self.recipe, self.camera(camera.pixels.owner.name)
        options = recipe.render | self.scene.options | camera.entry.options | recipe.permission
        return options | {
            "camera_path": f"{owner.name}/camera_path.txt",
            "lens": owner.entry.lens,
            "fnumber": owner.fnumber,
            "focus_m": owner.focus_m,
            "camera": owner.entry.camera,
            "chip": camera.film,
            "width": camera.pixels.width,
            "height": camera.pixels.height,
            "light_scale": self.light_scale,
            "seed": int(self.rng(f"camera.{camera.name}.render").integers(2**31 - 1)),
        }

    def truth(self, camera: CameraPlan) -> dict[str, Any] | None:
        """Options of the render of the ground truth, which a camera with pixels of its own has."""
        truth = self.recipe.truth
        if not (camera.owns_pixels and truth.layers):
            return None
        own = {"no_light": True, "fps": truth.fps, "frames": self.truth_frames, "layers": ",".join(truth.layers)}
        return {key: value for key, value in self.light(camera).items() if key not in OF_LIGHT} | own

    def exposures_us(self, camera: CameraPlan) -> list[tuple[int, int]]:
        """Exposures of the middle row of an RGB camera."""
        film, setting = camera.entry.film, (camera.exposure_ms, camera.phase_ms)
        return rgb.frame_times_us(film, camera.pixels.height, self.duration_us, *setting) if film else []

    def ranges(self, camera: CameraPlan) -> list[tuple[int, int]]:
        """Ranges [begin, end) of the instants that a camera's light needs: those of the exposures if only an RGB camera
        sees it, otherwise all from 0 to the end (the last may be later)."""
        shared = any(other.stack == camera.stack for other in self.cameras if other is not camera)
        fps, times = _fps(self.light(camera)), [] if shared else self.exposures_us(camera)
        needed = np.full(math.ceil(self.duration_s * fps - 1e-9), not times)  # intervals
        rolled_us = camera.entry.film.rolled_us(camera.pixels.height) if camera.entry.film else 0
        for begin, end in times:
            first, last = (begin - rolled_us) * 1e-6 * fps, (end + rolled_us) * 1e-6 * fps
            needed[math.floor(first + 1e-9) : math.ceil(last - 1e-9)] = True
        bounds = np.flatnonzero(np.diff(needed, prepend=False, append=False)).reshape(-1, 2)
        return [(int(begin), int(end) + 1) for begin, end in bounds]

    @property
    def is_adaptive(self) -> bool:
        return any(self.light(camera)["time"] == "adaptive" for camera in self.with_light)

    def instants(self, camera: CameraPlan) -> int:
        return sum(end - begin for begin, end in self.ranges(camera))

    def camera(self, name: str) -> CameraPlan:
        return next(camera for camera in self.cameras if camera.name == name)

    @property
    def with_light(self) -> list[CameraPlan]:
        """Cameras whose light is rendered, the owners of pixels first."""
        return sorted((c for c in self.cameras if c.entry.has_light), key=lambda c: not c.owns_pixels)

    @property
    def drawn(self) -> dict[str, Any]:
        """As sequence.json records it."""
        keys = ("split", "duration_s", "parameters", "place", "light_scale", "trajectory")
        found = {"scene": self.scene.name} | {key: getattr(self, key) for key in keys}
        found |= {"sky": self.sky} if self.sky else {}
        return found | {"cameras": {camera.name: camera.drawn for camera in self.cameras}}

    @property
    def files(self) -> dict[str, Path]:
        """Input files and folders, by the names in the recipe."""
        names = [name for thing in self.place for name in (thing["file"], thing["texture"]) if name]
        names += [self.sky["file"]] if self.sky else []
        names += [str(self.trajectory["file"])] if "file" in self.trajectory else []
        names += map(str, self.parameters.values())
        names += [name for c in self.recipe.cameras for name in (c.chip, c.lens, c.stages.get("mask")) if name]
        found = {name: _named(self.recipe, name) for name in names} | {f"scene {self.scene.name}": self.scene.path}
        files = {name: path for name, path in found.items() if isinstance(path, Path)}
        models = {thing["file"] for thing in self.place} & files.keys()
        return files | {f"{name} {path.name}": path for name in models for path in placing.read_with(files[name])}

    def rng(self, name: str) -> np.random.Generator:
        return generator(self.recipe.seed, self.index, name)


class Plan:
    """The plan of a recipe's set. Raises PecsError, with the recipe's path and the place in it, for a chip or an IMU
    that is not there."""

    def __init__(self, recipe: Recipe):
        self.recipe, self.imu = recipe, None
        self.pixels: dict[str, Pixels] = {}
        for entry in recipe.cameras:
            with at(recipe, f"rig.camera {entry.name}"):
                self.pixels[entry.name] = _pixels(recipe, entry)
        if imu := recipe.imu:
            with at(recipe, "rig.imu"):
                placed = rig.rig_from_camera(imu.position_m, imu.rotation_deg)
                self.imu = Imu.of_part(imu.part, imu.rate_hz, placed, turn_on=imu.turn_on)

    def sequence(self, index: int) -> SequencePlan:
        seed = self.recipe.seed
        return self._drawn(index, self.scene(index), lambda name, value: value.draw(generator(seed, index, name)))

    def scene(self, index: int) -> SceneEntry:
        return self.recipe.scenes[self._share(index, "scene", [scene.weight for scene in self.recipe.scenes])]

    def ends(self) -> Iterator[SequencePlan]:
        """Sequences of each scene that no drawn value is outside of: all values at their first ends, their second ends,
        and so on (one that has no more keeps its last), each with those of the biases and the focus."""
        for scene in self.recipe.scenes:
            counts = [1, 1]
            self._drawn(0, scene, partial(_end, (0, 0), counts))
            for ends in np.ndindex(*counts):
                yield self._drawn(0, scene, partial(_end, ends, counts))

    def _drawn(self, index: int, scene: SceneEntry, draw: Draw) -> SequencePlan:
        of, recipe, rng = f"scene.{scene.name}", self.recipe, partial(generator, self.recipe.seed, index)
        shares = [recipe.splits.get(name, 0.0) for name in SPLITS]
        duration_s, light_scale = draw("duration_s", recipe.duration_s), draw(f"{of}.light_scale", scene.light_scale)
        if recipe.truth.layers:  # whole intervals, so that all events are within the ground truth
            duration_s = math.ceil(duration_s * recipe.truth.fps - 1e-9) / recipe.truth.fps
        return SequencePlan(
            recipe=recipe,
            index=index,
            imu=self.imu,
            scene=scene,
            split=scene.split or SPLITS[self._share(index, "split", shares)],
            duration_s=duration_s,
            parameters={k: draw(f"{of}.{k}", value) for k, value in scene.parameters.items()},
            place=[thing for i, pool in enumerate(scene.pools) for thing in pool.draw(f"{of}.place[{i}]", rng)],
            sky=scene.sky.draw(rng(f"{of}.sky")) if scene.sky else None,
            light_scale=light_scale,
            trajectory={
                k: draw(f"trajectory.{k}", value) if isinstance(value, Value) else value
                for k, value in scene.trajectory.items()
            },
            cameras=tuple(self._camera(index, entry, draw) for entry in recipe.cameras),
        )

    def _camera(self, index: int, entry: CameraEntry, draw: Draw) -> CameraPlan:
        of = f"camera.{min(entry.name, entry.partner or entry.name)}"  # partners are set alike
        film = entry.film
        single = {"fnumber": entry.fnumber, "focus_m": entry.focus_m}
        single |= {"exposure_ms": film.exposure_ms, "phase_ms": film.phase_ms} if film else {}
        return CameraPlan(
            entry,
            self.pixels[entry.name],
            overrides={k: draw(f"{of}.set.{k}", value) for k, value in entry.overrides.items()},
            biases={k: draw(f"{of}.bias.{k}", value) for k, value in entry.biases.items()},
            seed=int(generator(self.recipe.seed, index, f"camera.{entry.name}.seed").integers(2**31)),
            **{key: draw(f"{of}.{key}", value) for key, value in single.items() if value},
        )

    def _share(self, index: int, name: str, weights: list[float]) -> int:
        """Index of the weights; the shares are even for any number of sequences."""
        begin = float(generator(self.recipe.seed, 0, name).uniform())
        ends = np.cumsum(weights) / sum(weights)
        return int(np.searchsorted(ends, (begin + index * GOLDEN) % 1.0, side="right").clip(0, len(weights) - 1))


def _end(ends: tuple[int, ...], counts: list[int], name: str, value: Value) -> Any:
    """One of a value's ends: of the biases and the focus by the second number. counts: how many there are at most."""
    group = int(".bias." in name or name.endswith(".focus_m"))
    counts[group] = max(counts[group], len(value.ends))
    return value.ends[min(ends[group], len(value.ends) - 1)]


def _fps(options: dict[str, Any]) -> float:
    if not is_number(fps := options["fps"]) or fps <= 0:
        raise PecsInputError(f"--fps: got {fps}, wanted a number above 0")
    return float(fps)


def _pixels(recipe: Recipe, entry: CameraEntry) -> Pixels:
    owner = next(camera for camera in recipe.cameras if camera.name == (entry.pixels_of or entry.name))
    size = owner.width or 0, owner.height or 0, owner.pixel_pitch_um or 0.0
    if owner.chip:
        with Chip(_named(recipe, owner.chip)) as chip:
            width, height = owner.width or chip.width, owner.height or chip.height
            size = width, height, chip.pixel_pitch_m * 1e6 * (chip.width or width) / width  # the film is the whole chip
    mask = _named(recipe, entry.stages["mask"]) if "mask" in entry.stages else None
    return Pixels(owner, *size, _named(recipe, entry.chip or ""), mask)


def _named(recipe: Recipe, name: str) -> str | Path:
    """The file of that name in the recipe's folder, or the name."""
    path = recipe.path.parent / name
    return path if path.is_file() else name
