"""Faults of a recipe beyond its tables, before the first ray: every part that it names is opened or tried with
the ends of its drawn values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from .. import sensor
from .._arguments import words
from .._errors import ExitCode, PecsError, bad_input
from ..lens import Lens
from . import blender, parameters, rig, trajectories
from .imu import Imu
from .recipe import CameraEntry, Recipe, SceneEntry
from .table import Value
from .work import beside, pixels

WITH_PICTURES = ("evreal", "event_cnn", "radiance")  # exports that require an RGB camera on the pixels of events
WITHOUT_EVENTS = ("coco",)
FIRST = 1000  # sequences among which a scene's first one is looked for


def check(recipe: Recipe) -> None:
    """Raises PecsError, with the recipe's path and the place in it, for what cannot be made."""
    _partners(recipe)
    _exports(recipe)
    _scripts(recipe)
    for entry in recipe.cameras:
        with _at(recipe, f"rig.camera {entry.name}"):
            if entry.kind == "events":
                _sensors(recipe, entry)
            if not entry.pixels_of:
                for fnumber in _ends(entry.fnumber):
                    for focus_m in _ends(entry.focus_m):
                        see_corners(recipe, entry, fnumber, focus_m)
    if recipe.imu:
        with _at(recipe, "rig.imu"):
            Imu.of_part(recipe.imu["part"], recipe.imu["rate_hz"], turn_on=recipe.imu["turn_on"])
    for scene in recipe.scenes:
        with _at(recipe, f"scene {scene.name}.trajectory"):
            _trajectories(recipe, scene)
    _renders(recipe)


@contextmanager
def _at(recipe: Recipe, place: str) -> Iterator[None]:
    """Adds the recipe and the place to an error, unless it has them."""
    try:
        yield
    except PecsError as e:
        text = str(e)
        code = ExitCode.BAD_INPUT if e.code == ExitCode.USAGE else e.code
        message = text if text.startswith(f"{recipe.path}: ") else f"{recipe.path}: {place}: {text}"
        raise PecsError(message, code) from None


def _ends(value: Value | None) -> tuple[Any, ...]:
    return value.ends if value else (None,)


def _combined(values: dict[str, Value]) -> Iterator[dict[str, Any]]:
    """The first ends of all values, the second ends, and so on; a value that has no more keeps its last one."""
    for i in range(max((len(value.ends) for value in values.values()), default=1)):
        yield {key: value.ends[min(i, len(value.ends) - 1)] for key, value in values.items()}


# The rig


def _partners(recipe: Recipe) -> None:
    for entry in (c for c in recipe.cameras if c.partner):
        other, place = recipe.camera(str(entry.partner)), f"rig.camera {entry.name}.partner"
        if other.partner != entry.name or other.kind != entry.kind:
            raise bad_input(recipe.path, place, other.name, "a camera of the same kind whose partner is this one")
        a, b = recipe.owner(entry), recipe.owner(other)
        if a is b or np.allclose(a.position_m, b.position_m, rtol=0, atol=1e-9):
            raise bad_input(recipe.path, place, other.name, "a camera at another position_m")


def _exports(recipe: Recipe) -> None:
    events = [recipe.owner(c).name for c in recipe.cameras if c.kind == "events"]
    shared = any(recipe.owner(c).name in events for c in recipe.cameras if c.kind == "rgb")
    for name in recipe.export:
        if name not in WITHOUT_EVENTS and not events:
            raise bad_input(recipe.path, "export", name, "a rig with an event camera for it")
        if name in WITH_PICTURES and not shared:
            raise bad_input(recipe.path, "export", name, "an RGB camera whose pixels_of is an event camera for it")


def _sensors(recipe: Recipe, entry: CameraEntry) -> None:
    """Opens the camera's sensor with the ends of its drawn values."""
    width, height, _ = pixels(recipe, entry)
    chip, stages = beside(recipe, str(entry.chip)) or str(entry.chip), dict(entry.stages)
    if "mask" in stages:
        stages["mask"] = beside(recipe, stages["mask"]) or stages["mask"]
    pixel = {"preset": entry.preset} if entry.preset else {"model": entry.model}
    for overrides in _combined(entry.overrides):
        for biases in _combined(entry.biases):
            sensor.Sensor(width, height, chip, overrides=overrides, biases=biases, **stages, **pixel).close()


def see_corners(recipe: Recipe, entry: CameraEntry, fnumber: float | None, focus_m: float | None) -> None:
    """Raises PecsInputError for a lens that does not cover the film."""
    width, height, pitch_um = pixels(recipe, entry)
    corners = np.array([[x, y] for y in (0.5, height - 0.5) for x in (0.5, width - 0.5)])
    setting = {"fnumber": fnumber, "focus_m": focus_m, "pixel_pitch_mm": pitch_um * 1e-3}
    with Lens(entry.lens) as lens:
        covered(recipe, entry, lens.directions(corners, width=width, height=height, **setting))


def covered(recipe: Recipe, entry: CameraEntry, directions: rig.Array) -> None:
    """Raises PecsInputError for pixels without light."""
    if lost := int(np.isnan(directions).any(-1).sum()):
        place, got = f"rig.camera {entry.name}.lens", f"{entry.lens}, which does not illuminate {lost} pixels"
        raise bad_input(recipe.path, place, got, "a lens that covers the film")


# Scenes


def _scripts(recipe: Recipe) -> None:
    """A recipe gives no permission to run code: scene folders of others require the flag, as scripts of a .blend do."""
    for scene in recipe.scenes:
        if scene.path.suffix != ".blend" and not (scene.path / "scene.json").is_file():
            wanted = "a .blend file, or a folder with scene.json"
            raise bad_input(recipe.path, f"scene {scene.name}.path", str(scene.path), wanted)
        if scene.path.is_dir() and not recipe.allow_scripts and scene.path.parent not in blender.scene_folders():
            raise PecsError(
                f"{recipe.path}: scene {scene.name}.path: {scene.path} contains Python; --allow-scripts runs it",
                ExitCode.UNSUPPORTED,
            )


def trajectory(recipe: Recipe, drawn: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Kind and parameters for `trajectories.plan`, with drawn values."""
    given = dict(drawn)
    kind = given.pop("kind")
    if "file" in given:
        given["file"] = str(recipe.path.parent / str(given["file"]))
    if "speed_m_per_s" in recipe.limits:
        given.setdefault("max_speed_m_per_s", recipe.limits["speed_m_per_s"])
    return kind, given


def _trajectories(recipe: Recipe, scene: SceneEntry) -> None:
    """Reads the parameters with the ends of their drawn values, and plans the path of the scene's first sequence as if
    the scene were empty."""
    drawn = {key: value for key, value in scene.trajectory.items() if isinstance(value, Value)}
    for values in _combined(drawn):
        kind, given = trajectory(recipe, scene.trajectory | values)
        if kind not in trajectories.KINDS:
            raise bad_input(recipe.path, f"scene {scene.name}.trajectory.kind", kind, ", ".join(trajectories.KINDS))
        for seconds in recipe.duration_s.ends:
            parameters.read(kind, given | {"duration_s": seconds})
    for index in range(min(recipe.sequences, FIRST)):
        values = recipe.draw(index)
        if values["scene"] == scene.name:
            kind, given = trajectory(recipe, values["trajectory"])
            given["duration_s"] = values["duration_s"]
            trajectories.plan(kind, given, None, recipe.rng(index, "trajectory"))
            return


def _renders(recipe: Recipe) -> None:
    """Has the renderer read its options for every scene and camera, without a render."""
    jobs = []
    for scene in recipe.scenes:
        if scene.path.suffix == ".blend" and scene.parameters:
            raise bad_input(recipe.path, f"scene {scene.name}.set", "parameters of a .blend", "none (of scene folders)")
        for values in _combined(scene.parameters):
            begin = ["render", str(scene.path), "-o", "stack", *(f"--set={key}={v}" for key, v in values.items())]
            for entry in (c for c in recipe.cameras if c.has_light):
                size = dict(zip(("width", "height"), pixels(recipe, entry), strict=False))
                options = recipe.render_options(scene, entry) | size | {"lens": recipe.owner(entry).lens}
                jobs.append([*begin, *words(options)])
            layers = {"fps": recipe.truth["fps"], "layers": ",".join(recipe.truth["layers"])}
            jobs.append([*begin, "--no-light", *words(layers if recipe.truth["layers"] else {})])
    if fault := blender.fault_of(jobs):
        raise PecsError(f"{recipe.path}: {fault}", ExitCode.BAD_INPUT)
