"""Cameras of a .blend: their motion as a trajectory (`kind = "scene"`), their optics (`lens = "none"`), and the recipe
of a .blend without one."""

from __future__ import annotations

import json
import math
import os
import re
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from .. import _poses as poses
from .._config import parse_json
from .._errors import PecsInputError, bad_input
from . import rig, trajectories
from .blender import printed
from .plan import CameraPlan, SequencePlan
from .recipe import OWN_LENS, RENDER

SAME_M, SAME_DEG = 1e-4, 1e-3  # of a rig: how far a camera may move relative to another one
JUMP = 10.0  # times as far as before and after, in the same time
JUMP_M, JUMP_DEG = 1e-3, 0.1  # steps below these are no jumps
DEFAULT_CHIP = "davis346"


@dataclass(frozen=True)
class SceneCamera:
    """world_from_camera: [n, 4, 4] at the times of the cameras. optics: as `pecs_blender cameras` prints them."""

    name: str
    world_from_camera: rig.Array
    optics: dict[str, Any]

    def K(self, width: int, height: int) -> rig.Array:
        """The camera matrix for square pixels, OpenCV's (the first centre is at (0, 0)). Raises PecsInputError for a
        camera without one."""
        o = self.optics
        if o["type"] != "PERSP" or o["zooms"]:
            what = "a focal length or shift that changes" if o["zooms"] else f"type {o['type']}"
            raise PecsInputError(f"camera {self.name!r}: got {what}, wanted a perspective camera with fixed optics")
        upright = o["fit"] == "VERTICAL" or (o["fit"] == "AUTO" and height > width)
        side_mm = o["sensor_height_mm"] if o["fit"] == "VERTICAL" else o["sensor_width_mm"]
        side_px = height if upright else width
        focal_px = o["focal_mm"] / side_mm * side_px
        x, y = width / 2 - o["shift_x"] * side_px, height / 2 + o["shift_y"] * side_px
        return np.array([[focal_px, 0, x - 0.5], [0, focal_px, y - 0.5], [0, 0, 1]])


@dataclass(frozen=True)
class SceneCameras:
    """active: names of the cameras that render the range of frames, in order."""

    fps: float
    frames: tuple[int, int]
    times_s: rig.Array
    active: list[str]
    cameras: dict[str, SceneCamera]
    panel: dict[str, Any] | None

    @property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        return (self.frames[1] - self.frames[0]) / self.fps

    def camera(self, name: str | None) -> SceneCamera:
        """By name; None: the active one. Raises PecsInputError."""
        if name is None and len(self.active) > 1:
            names = ", ".join(map(repr, self.active))
            raise PecsInputError(f"camera: got markers that switch between {names}, wanted one name of them")
        if (found := self.cameras.get(name or self.active[0])) is None:
            raise PecsInputError(f"camera: got {name!r}, wanted one of {', '.join(map(repr, self.cameras))}")
        if found.optics["mirrored"]:
            raise PecsInputError(f"camera {found.name!r}: got a negative scale, which mirrors it, wanted none")
        return found


def of(blend: Path, allow_scripts: bool) -> SceneCameras:
    """Raises PecsError as the renderer would for the file."""
    return _read(blend.absolute(), blend.stat().st_mtime_ns if blend.exists() else 0, allow_scripts)


@cache
def _read(blend: Path, _changed_ns: int, allow_scripts: bool) -> SceneCameras:
    text = printed("cameras", blend, *(["--allow-scripts"] if allow_scripts else []))
    found = parse_json(text, "pecs_blender cameras")
    cameras = {}
    for name, one in found["cameras"].items():
        rows = np.array(one.pop("poses"), float)
        cameras[name] = SceneCamera(name, poses.pose_matrix(rows[:, :3], rows[:, 3:]), one)
    frames, times_s = tuple(found["frames"]), np.array(found["times_s"])
    return SceneCameras(found["fps"], frames, times_s, found["active"], cameras, found["panel"])


def K(plan: SequencePlan, camera: CameraPlan) -> rig.Array | None:
    """The camera matrix of a camera with the optics of one of the .blend; None for a lens. Raises PecsInputError."""
    entry = camera.pixels.owner
    if entry.lens != OWN_LENS:
        return None
    if plan.scene.path.suffix != ".blend":
        raise PecsInputError(f"lens: got {OWN_LENS}, which is the camera of a .blend, wanted a lens for a scene folder")
    own = of(plan.scene.path, plan.recipe.allow_scripts).camera(entry.camera)
    return own.K(camera.pixels.width, camera.pixels.height)


# The trajectory


def trajectory(plan: SequencePlan) -> trajectories.Trajectory:
    """A spline through the poses of the scene's camera. Raises PecsInputError."""
    kind, given = plan.path
    name = given.pop("camera", None)
    if unknown := sorted(given.keys() - {"duration_s", "max_speed_m_per_s"}):
        raise PecsInputError(f"{kind}: {unknown[0]}: got an unknown key, wanted camera")
    if plan.scene.path.suffix != ".blend":
        raise PecsInputError(
            f"kind: got {kind}, wanted a trajectory for a scene folder, which has no camera that moves"
        )
    cameras = of(plan.scene.path, plan.recipe.allow_scripts)
    camera = cameras.camera(name)
    if plan.duration_s > cameras.duration_s * (1 + 1e-9):
        first, last = cameras.frames
        most = f"wanted at most {cameras.duration_s:.9g} s, frames {first} to {last} of {plan.scene.path.name}"
        raise PecsInputError(f"duration_s: got {plan.duration_s:.9g} s in whole intervals of the ground truth, {most}")
    _check_jumps(cameras, camera)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "path.txt"
        poses.write_tum(file, cameras.times_s, *poses.position_quaternion(camera.world_from_camera))
        recorded = {**given, "file": str(file), "start_s": 0.0, "tries": 1}
        return trajectories.plan("recorded", recorded, None, plan.rng("trajectory"))


def _check_jumps(cameras: SceneCameras, camera: SceneCamera) -> None:
    """Constant interpolation between keyframes, and constraints that switch, move a camera in no time."""
    path = camera.world_from_camera
    for unit, least, steps in zip("m deg".split(), (JUMP_M, JUMP_DEG), _apart(path[:-1], path[1:]), strict=True):
        around = np.maximum(np.r_[0, steps[:-1]], np.r_[steps[1:], 0])
        if (jumps := (steps > least) & (steps > JUMP * around)).any():
            at = int(np.argmax(jumps))
            where = f"{steps[at]:.3g} {unit} at {cameras.times_s[at]:.3g} s"
            raise PecsInputError(f"camera {camera.name!r}: got a jump of {where}, wanted a path without jumps")


def _apart(first: rig.Array, second: rig.Array) -> tuple[rig.Array, rig.Array]:
    """Distances [m] and angles [deg] between poses [n, 4, 4]."""
    turns = np.swapaxes(first[:, :3, :3], 1, 2) @ second[:, :3, :3]
    sine = np.linalg.norm(turns - np.swapaxes(turns, 1, 2), axis=(1, 2)) / math.sqrt(8)
    angles = np.degrees(np.arctan2(sine, (np.trace(turns, axis1=1, axis2=2) - 1) / 2))
    return np.linalg.norm(second[:, :3, 3] - first[:, :3, 3], axis=1), angles


# The recipe of a .blend


def recipe_of(blend: Path, folder: Path, allow_scripts: bool) -> str:
    """The text of a recipe in `folder`: the scene with its own cameras. Raises PecsError."""
    cameras = of(blend, allow_scripts)
    if cameras.duration_s <= 0:
        raise bad_input(blend, "frames", f"{cameras.frames[0]} alone", "a range of two or more")
    main = cameras.camera(None)
    panel = cameras.panel or {}
    name = re.sub(r"[^A-Za-z0-9_-]", "_", blend.stem)[:60] or "scene"
    lines = [
        f"# The recipe of `pecs dataset {blend.name}`. To change it, copy and edit it, and run `pecs dataset` with it.",
        f"name = {_toml(name)}",
        f"duration_s = {cameras.duration_s!r}  # frames {cameras.frames[0]} to {cameras.frames[1]}",
        "[[scene]]",
        f"path = {_toml(os.path.relpath(blend.resolve(), folder.resolve()))}",
        f"name = {_toml(name)}",
        *([f"light_scale = {panel['light_scale']!r}"] if "light_scale" in panel else []),
        "[scene.trajectory]",
        'kind = "scene"',
    ]
    used = {_name(main.name)}
    lines += _camera(main, main, _name(main.name), panel)
    for other in (camera for camera in cameras.cameras.values() if camera is not main):
        if not _is_rigid(main, other):
            lines += [f"# Not in the rig, since it moves relative to {_toml(main.name)}: {_toml(other.name)}"]
            continue
        unique = next(n for n in _names(_name(other.name)) if n.casefold() not in map(str.casefold, used))
        used.add(unique)
        lines += _camera(main, other, unique, panel)
    lines += ["[render]", *(f"{key} = {_toml(value)}" for key, value in (RENDER | panel.get("render", {})).items())]
    if left_out := panel.get("left_out"):
        lines += [f"# Settings of the panel that a recipe has no key for: {', '.join(left_out)}"]
    lines += ["[truth]", f"fps = {cameras.fps!r}  # at the frames of the scene"]
    return "\n".join(lines) + "\n"


def _camera(main: SceneCamera, camera: SceneCamera, name: str, panel: dict[str, Any]) -> list[str]:
    move = _relative(main, camera)[0]
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(move[:3, :3]).as_euler("xyz", degrees=True)
    lens = panel.get("lens", "none")
    lines = [
        "[[rig.camera]]",
        f"name = {_toml(name)}",
        'kind = "events"',
        f"chip = {_toml(panel.get('chip', DEFAULT_CHIP))}",
        f"lens = {_toml(lens)}" + ("  # that of the .blend's camera" if lens == "none" else ""),
        *([f"camera = {_toml(camera.name)}"] if lens == "none" else []),
        *(f"{key} = {_toml(panel[key])}" for key in ("fnumber", "focus_m") if key in panel),
        *(f"{key} = {_toml(value)}" for key, value in panel.get("sensor", {}).items()),
    ]
    if camera is not main:
        lines += [f"position_m = {_toml((np.round(move[:3, 3], 6) + 0.0).tolist())}"]
        lines += [f"rotation_deg = {_toml((np.round(turn, 5) + 0.0).tolist())}"]
    for key in ("set", "bias"):
        if panel.get(key):
            lines += [f"[rig.camera.{key}]", *(f"{k} = {_toml(v)}" for k, v in panel[key].items())]
    return lines


def _relative(main: SceneCamera, other: SceneCamera) -> rig.Array:
    return np.linalg.inv(main.world_from_camera) @ other.world_from_camera


def _is_rigid(main: SceneCamera, other: SceneCamera) -> bool:
    moves = _relative(main, other)
    distances_m, angles_deg = _apart(moves[:1].repeat(len(moves), 0), moves)
    return bool(distances_m.max() <= SAME_M and angles_deg.max() <= SAME_DEG)


def _name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]", "_", text)[:60] or "camera"


def _names(name: str) -> Any:
    yield name
    yield from (f"{name}_{number}" for number in range(2, 10**6))


def _toml(value: Any) -> str:
    """JSON's numbers, lists of them and texts are TOML's."""
    return json.dumps(value)
