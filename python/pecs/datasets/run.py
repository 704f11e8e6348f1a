"""One sequence of a data set: planned, rendered, simulated, checked. A step is skipped if its output exists, so a run
that was stopped continues."""

from __future__ import annotations

import math
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import _poses as poses
from .._arguments import words
from .._files import read_text, write_json, write_text, write_whole
from .._library import version
from .._sense import sense
from ..chip import Chip
from . import fitting, parameters, pictures, placing, recipe_check, report, rgb, rig, scene_cameras, trajectories
from . import imu as imus
from .blender import blender
from .files import MAX_BYTES, npy_bytes, read_object
from .manifest import seal
from .paths import GRAVITY_M_S2
from .plan import PATH_HZ, PLACE, CameraPlan, SequencePlan, at
from .sequence import Sequence
from .work import Work, portable, sequence_work

SURVEY_INSTANTS = 5
WARMUP_US = 20_000  # of the pixels, before the sequence (docs/reference/sensor.md)


def make(plan: SequencePlan, output: Path, threads: int, say: Callable[..., None]) -> None:
    """Makes a sequence in output/sequences, unless it exists. Raises PecsError; Busy if another process makes it."""
    with sequence_work(plan, output, say) as work:
        if not work:
            return
        for camera in plan.cameras:
            recipe_check.see_corners(plan.recipe, camera)
        _inputs(work)
        _move(work)
        for camera in plan.with_light:
            _render(work, camera, threads)
        _describe(work)
        for camera in plan.cameras:
            (_sense if camera.entry.kind == "events" else pictures.take)(work, camera)
        say("report")
        report.write(Sequence(work.folder))
        _drop(work)
        seal(work.folder)


def _inputs(work: Work) -> None:
    """Copies of the cameras' files, so that records contain no path of this machine, and the placed objects."""
    plan = work.plan
    for camera in plan.cameras:
        folder, pixels = work.folder / camera.name, camera.pixels
        folder.mkdir(exist_ok=True)
        for name, file in (("chip.json", pixels.chip), ("mask.txt", pixels.mask)):
            if isinstance(file, Path):
                write_whole(folder / name, file.read_bytes())
        if film := camera.entry.film:
            size = pixels.width, pixels.height, pixels.pitch_um
            rgb.write_chip(work.folder / camera.film, None, *size, film.peak_qe)
    if not (plan.place or plan.sky) or (work.folder / PLACE).exists():
        return
    things = plan.place
    if (described := work.folder / "sequence.json").exists():  # stopped at its end: places are as they were found
        things = read_object(described, "a sequence")["drawn"].get("place", [])
    _write_place(work, [thing["position_m"] for thing in things])


def _write_place(work: Work, positions_m: list[list[float]]) -> None:
    """The objects and the sky, for the renderer."""
    plan, beside = work.plan, work.plan.recipe.path.parent
    sky = {"sky": plan.sky | {"file": str((beside / plan.sky["file"]).resolve())}} if plan.sky else {}
    things = [thing | {"position_m": put} for thing, put in zip(plan.place, positions_m, strict=True)]
    write_json(work.folder / PLACE, {"format": 1, "objects": placing.placed(things, beside)} | sky)


# Motion


def _move(work: Work) -> None:
    """Surveys the scene, plans the rig's path through it; writes poses, camera paths and the IMU's samples."""
    if (work.folder / "poses.txt").exists():
        return
    work.say("path")
    plan, path = work.plan, _path(work)
    t_s = np.arange(math.ceil(plan.end_s * plan.path_hz) + 3) / plan.path_hz
    for camera in plan.cameras:
        if camera.owns_pixels:
            world = path.matrices(t_s) @ camera.rig_from_camera
            poses.write_tum(work.folder / camera.name / "camera_path.txt", t_s, *poses.position_quaternion(world))
    if plan.imu:
        _write_imu(work, path, plan.imu)
    rate = plan.imu.rate_hz if plan.imu else PATH_HZ
    t_s = np.arange(math.floor(plan.duration_s * rate * (1 + 1e-12)) + 1) / rate
    poses.write_tum(work.folder / "poses.txt", t_s, *path.pose(t_s))


def _path(work: Work) -> trajectories.Trajectory:
    """Through the scene, away from its surfaces, or that of the scene's own camera; then objects get their places."""
    plan, survey = work.plan, work.folder / "survey.npz"
    if plan.follows_scene and not plan.place:
        return scene_cameras.trajectory(plan)
    if not survey.exists():
        blender(
            *("survey", *plan.scene_words, "-o", survey.name),
            *words(plan.recipe.permission),
            *("--frames", SURVEY_INSTANTS, "--fps", (SURVEY_INSTANTS - 1) / plan.duration_s),
            folder=work.folder,
            log="survey.log",
        )
    surfaces, objects = _surfaces(survey, [f"{Path(one['file']).stem}_{i:03d}" for i, one in enumerate(plan.place)])
    kind, given = plan.path
    if plan.follows_scene:
        path = scene_cameras.trajectory(plan)
    else:
        path = trajectories.plan(kind, given, surfaces, plan.rng("trajectory"))
    if plan.place:
        defaults = parameters.PARAMETERS["still"]
        limits = {key: float(given.get(key, defaults[key].default)) for key in ("clearance_m", "view_deg")}
        with at(plan.recipe, f"scene {plan.scene.name}.place"):
            found = fitting.fit(
                plan.place, objects, surfaces, path, plan.rng("place"), duration_s=plan.duration_s, **limits
            )
        _write_place(work, found)
    return path


def _surfaces(survey: Path, placed: list[str]) -> tuple[trajectories.Surfaces, list[rig.Array]]:
    """Surfaces that `pecs_blender survey` has sampled, without placed objects; and of each of these, points at the
    first instant."""
    with np.load(survey, allow_pickle=False) as found:
        first, ids = found["first"], dict(zip(found["names"].tolist(), found["ids"].tolist(), strict=True))
        numbers = [ids.get(name, -1) for name in placed]
        moving, still = found["points"], found["static_points"]
        movers, standing = found["objects"], found["static_objects"]
        objects = [
            np.concatenate([moving[: first[1]][movers[: first[1]] == number], still[standing == number]])
            for number in numbers
        ]
        parts = zip(np.split(moving, first[1:-1]), np.split(movers, first[1:-1]), strict=True)
        points = [part[~np.isin(whose, numbers)] for part, whose in parts]
        own = still[~np.isin(standing, numbers)]
        return trajectories.Surfaces(found["times_s"], points, own, float(found["spacing_m"])), objects


def _write_imu(work: Work, path: trajectories.Trajectory, imu: imus.Imu) -> None:
    got = imus.measure(path, imu, work.plan.rng("imu"))
    kept, folder = got.t_ns <= work.plan.duration_us * 1000, work.folder
    poses.write_euroc_imu(folder / "imu.csv", got.t_ns[kept], got.gyro_rad_s[kept], got.accel_m_s2[kept])
    biases = got.gyro_bias_rad_s[kept], got.accel_bias_m_s2[kept]
    poses.write_euroc_imu(folder / "imu_biases.csv", got.t_ns[kept], *biases)
    write_text(folder / "imu.yaml", "".join(f"{key}: {value!r}\n" for key, value in imu.kalibr().items()))


# Light and truth


def _render(work: Work, camera: CameraPlan, threads: int) -> None:
    """Light, and ground truth if the camera has pixels of its own."""
    plan = work.plan
    for what, to, options in _renders(plan, camera):
        done = work.folder / to / "done"
        if done.exists():
            continue
        if what == "light" and not camera.owns_pixels:  # its film stands where that of the owner stands
            owner = rig.stack_json(work.folder / camera.pixels.owner.name / "stack")
            options["focus_bands_nm"] = ",".join(map(str, owner["lens"]["focus_bands_nm"])) if owner["lens"] else None
        step = f"{camera.name}: {what}"
        work.say(step)
        job = ["render", *plan.scene_words, "-o", to, *words(options | {"threads": threads})]
        blender(*job, folder=work.folder, log=f"{camera.name}/render.log", tell=partial(work.say, step))
        write_whole(done, b"")


def _renders(plan: SequencePlan, camera: CameraPlan) -> Iterator[tuple[str, Path, dict[str, Any]]]:
    """What is rendered, its stack in the sequence's folder, and the options."""
    if truth := plan.truth(camera):
        yield "truth", Path(camera.truth), truth
    light = plan.light(camera) | {"frames": ",".join(f"{begin}:{end}" for begin, end in plan.ranges(camera))}
    yield "light", Path(camera.stack), light


class Cost(NamedTuple):
    """Of a sequence's renders, measured on a few frames of each; events of all its event cameras, the largest share of
    them by the renderer's noise (0 if it has no estimate), and the largest median speed of the picture (0 with uniform
    steps)."""

    seconds: float
    disk_gb: float
    cpu_s: float
    events: float
    memory_gb: float
    render_noise: float
    px_per_s: float


def cost(plan: SequencePlan, threads: int) -> Cost:
    every: dict[Path, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(prefix="pecs_estimate_") as folder:
        work = Work(plan, Path(folder), lambda *_: None)
        _inputs(work)
        _move(work)
        for camera in plan.with_light:
            for _, to, options in _renders(plan, camera):
                job = ["render", *plan.scene_words, "-o", to, *words(options | {"threads": threads}), "--plan"]
                every[to] = blender(*job, folder=work.folder, log="estimate.log")
    seen = [(c, every[Path(c.stack)]) for c in plan.cameras if c.entry.kind == "events"]
    seen = [(camera, one) for camera, one in seen if "events" in one]
    seconds = sum(one["start_s"] + one["frames"] * one["each_s"] for one in every.values())
    disk, cpu_s = (sum(one[name] for one in every.values()) for name in ("disk_bytes", "cpu_s"))
    noise, px_per_s = (
        max((one.get(name, 0.0) for _, one in seen), default=0.0) for name in ("render_noise", "px_per_s")
    )
    memory, events = max(one["memory_bytes"] for one in every.values()), sum(_events(*one) for one in seen)
    return Cost(seconds, disk * 1e-9, cpu_s, events, memory * 1e-9, noise, px_per_s)


def _events(camera: CameraPlan, measured: dict[str, Any]) -> float:
    """As many of the light as its drawn thresholds are below the profile's, which was measured."""
    thresholds = []
    for overrides in ({}, camera.overrides):
        with Chip(str(camera.pixels.chip), overrides=overrides) as chip:
            thresholds.append(2 / (1 / chip.contrast_threshold_on + 1 / chip.contrast_threshold_off))
    return float(measured["events"] * thresholds[0] / thresholds[1] + measured["own_events"])


# Calibration


class _View(NamedTuple):
    """The camera as its stack records it. placed: rig_from_camera."""

    stack: dict[str, Any]
    optics: rig.Optics
    pinhole: rig.Pinhole
    placed: rig.Array


def _view(work: Work, camera: CameraPlan) -> _View:
    stack, K = rig.stack_json(work.folder / camera.stack), scene_cameras.K(work.plan, camera)
    optics = rig.optics(stack, camera.entry.lens, K)
    recipe_check.covered(work.plan.recipe, camera, optics.directions)
    pinhole = rig.pinhole(optics.directions) if K is None else rig.Pinhole(K, np.zeros(5), 0.0)
    return _View(stack, optics, pinhole, camera.rig_from_camera)


def _describe(work: Work) -> None:
    """sequence.json and the rectification maps."""
    plan, recipe = work.plan, work.plan.recipe
    drawn = plan.drawn
    if plan.place:
        if not (work.folder / PLACE).exists():  # sequence.json exists: the run was stopped at its end
            return
        objects = read_object(work.folder / PLACE, "placed objects")["objects"]
        drawn["place"] = [one | {"position_m": put["position_m"]} for one, put in zip(plan.place, objects, strict=True)]
    views = {camera.name: _view(work, camera) for camera in plan.cameras if camera.owns_pixels}
    imu = plan.imu and vars(recipe.imu) | {
        "rig_from_imu": plan.imu.rig_from_imu.tolist(),
        "gravity_m_s2": [0.0, 0.0, -GRAVITY_M_S2],
        "noise": plan.imu.kalibr(),  # densities and random walks in Kalibr's sense, SI units
    }
    write_json(
        work.folder / "sequence.json",
        {
            "format": 1,
            "name": plan.name,
            "split": plan.split,
            "seed": recipe.seed,
            "duration_us": plan.duration_us,
            "drawn": portable(drawn),
            "scene": plan.scene.name,
            "cameras": [_described(work, camera, views) for camera in plan.cameras],
            "imu": imu,
            "limits": recipe.limits,
            "versions": {"pecs": version(), "blender": next(iter(views.values())).stack["versions"]["blender"]},
            "about": recipe.about,
        },
    )


def _described(work: Work, camera: CameraPlan, views: dict[str, _View]) -> dict[str, Any]:
    """The camera in sequence.json; writes its rectification map."""
    entry, owner = camera.entry, camera.pixels.owner
    view = views[owner.name]
    pair, R_rect, baseline = [view], np.eye(3), None
    if entry.partner:
        pair.append(other := views[work.plan.camera(entry.partner).pixels.owner.name])
        baseline = float(np.linalg.norm(other.placed[:3, 3] - view.placed[:3, 3]))
        R_rect = rig.rectified_axes(view.placed, other.placed).T @ view.placed[:3, :3]
    sizes = [(one.stack["width"], one.stack["height"]) for one in pair]
    (width, height), K = sizes[0], rig.rectified_K([one.pinhole.K for one in pair], sizes)
    rectify_map = rig.rectify_map(view.optics.directions, R_rect, K)
    write_whole(work.folder / camera.name / "rectify_map.npy", npy_bytes(rectify_map))
    matrices = {"rig_from_camera": view.placed, "K": view.pinhole.K, "distortion": view.pinhole.distortion}
    matrices |= {"K_rect": K, "R_rect": R_rect}
    return {
        **{key: getattr(entry, key) for key in ("name", "kind", "chip", "preset", "model", "partner", "pixels_of")},
        **{key: (view.stack["lens"] or view.stack).get(key) for key in ("fnumber", "focus_m")},
        **{key: matrix.tolist() for key, matrix in matrices.items()},
        "width": width,
        "height": height,
        "overrides": camera.overrides,
        "lens": owner.lens,
        "pixel_pitch_um": view.stack["pixel_pitch_m"] * 1e6,
        "distortion_model": "radtan",
        "distortion_error_px": view.pinhole.error_px,
        "baseline_m": baseline,
    }


# Events


def _sense(work: Work, camera: CameraPlan) -> None:
    folder = work.folder / camera.name
    if (folder / "objects.npy").exists():
        return
    causes = folder / "causes.npy"
    if not (folder / "events.h5").exists() or not causes.exists():
        work.say(f"{camera.name}: events")
        shutil.rmtree(folder / "frames", ignore_errors=True)
        options = camera.sensor()
        for key, name in (("chip", "chip.json"), ("mask", "mask.txt")):
            if isinstance(options.get(key), Path):
                options[key] = folder / name  # the copy
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*noise of the renderer")  # checks.json has it
            sense(
                work.folder / camera.stack,
                folder / "events.h5",
                **options,
                warmup_us=WARMUP_US,
                seed=camera.seed,
                format="dsec",
                labels=causes,
                frames=folder / "frames" if camera.entry.frames else None,
                duration_us=work.plan.duration_us,
            )
        record = folder / "events.h5.run.json"
        write_text(record, read_text(record, MAX_BYTES).replace(f"{work.folder}/", ""))
    pictures.label_events(work, camera, folder)


def _drop(work: Work) -> None:
    """Deletes stacks that the recipe does not keep, and inputs of the renderer."""
    (work.folder / PLACE).unlink(missing_ok=True)
    (work.folder / "survey.npz").unlink(missing_ok=True)
    keep = work.plan.recipe.keep
    for camera in work.plan.cameras:
        for kept, folder in ((keep.light, "stack"), (keep.truth, "truth")):
            if not kept:
                shutil.rmtree(work.folder / camera.name / folder, ignore_errors=True)
