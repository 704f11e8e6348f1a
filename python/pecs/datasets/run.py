"""One sequence of a data set: planned, rendered, simulated, checked. A step is skipped if its output exists, so a run
that was stopped continues."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .. import _poses as poses
from .._arguments import words
from .._files import read_text, write_json, write_text, write_whole
from .._library import version
from .._sense import sense
from . import imu as imus
from . import pictures, placing, recipe_check, report, rgb, rig, trajectories
from .blender import blender
from .files import MAX_BYTES, npy_bytes
from .manifest import seal
from .paths import GRAVITY_M_S2
from .recipe import CameraEntry, Recipe
from .sequence import Sequence
from .work import Work, beside, pixels, portable, sequence_work

PATH_HZ = 1000.0  # of camera paths, at least; the renderer goes straight between
SURVEY_INSTANTS = 5
WARMUP_US = 20_000  # of the pixels, before the sequence (docs/reference/sensor.md)
OF_LIGHT = ("time", "fps", "step_px", "subpixels", "noise_events")


def make(recipe: Recipe, index: int, output: Path, threads: int, say: Callable[..., None]) -> None:
    """Makes sequence `index` in output/sequences, unless it exists. Raises PecsError; Busy if another process makes
    it."""
    with sequence_work(recipe, index, output, say) as work:
        if not work:
            return
        owners = [entry for entry in recipe.cameras if not entry.pixels_of]
        for entry in owners:
            values = work.drawn["cameras"][entry.name]
            recipe_check.see_corners(recipe, entry, values["fnumber"], values["focus_m"])
        _move(work)
        for entry in sorted((c for c in recipe.cameras if c.has_light), key=lambda c: bool(c.pixels_of)):
            _render(work, entry, threads)
        _describe(work)
        for entry in recipe.cameras:
            (_sense if entry.kind == "events" else pictures.take)(work, entry)
        _report(work)
        _drop(work)
        seal(work.folder)


# Motion


def _move(work: Work) -> None:
    """Surveys the scene, plans the rig's path through it; writes poses, camera paths and the IMU's samples."""
    if (work.folder / "poses.txt").exists():
        return
    work.say("path")
    recipe, scene = work.recipe, work.recipe.scene(work.drawn["scene"])
    survey = work.folder / "survey.npz"
    if not survey.exists():
        end_s = work.drawn["duration_s"]
        blender(
            *("survey", scene.path, *_parameters(work), "-o", survey.name),
            *words(recipe.permission),
            *("--frames", SURVEY_INSTANTS, "--fps", (SURVEY_INSTANTS - 1) / end_s),
            folder=work.folder,
            log="survey.log",
        )
    kind, parameters = recipe_check.trajectory(recipe, work.drawn["trajectory"])
    rate, seconds = max(PATH_HZ, float(recipe.render["fps"])), work.drawn["duration_s"]
    parameters["duration_s"] = seconds + 3 / rate  # the last frames may be later
    path = trajectories.plan(kind, parameters, _surfaces(survey), recipe.rng(work.index, "trajectory"))
    t_s = np.arange(math.ceil(seconds * rate) + 3) / rate
    for entry in recipe.cameras:
        if not entry.pixels_of:
            world = path.matrices(t_s) @ rig.rig_from_camera(entry.position_m, entry.rotation_deg)
            (work.folder / entry.name).mkdir(exist_ok=True)
            poses.write_tum(work.folder / entry.name / "camera_path.txt", t_s, *poses.position_quaternion(world))
    rate = PATH_HZ
    if recipe.imu:
        rate = recipe.imu["rate_hz"]
        _write_imu(work, path)
    t_s = np.arange(math.floor(seconds * rate * (1 + 1e-12)) + 1) / rate
    poses.write_tum(work.folder / "poses.txt", t_s, *path.pose(t_s))


def _surfaces(survey: Path) -> trajectories.Surfaces:
    """Surfaces that `pecs_blender survey` has sampled."""
    with np.load(survey, allow_pickle=False) as found:
        points = np.split(found["points"], found["first"][1:-1])
        return trajectories.Surfaces(found["times_s"], points, found["static_points"], float(found["spacing_m"]))


def _write_imu(work: Work, path: trajectories.Trajectory) -> None:
    imu = _imu(work.recipe)
    got = imus.measure(path, imu, work.recipe.rng(work.index, "imu"))
    kept, folder = got.t_ns <= work.duration_us * 1000, work.folder
    poses.write_euroc_imu(folder / "imu.csv", got.t_ns[kept], got.gyro_rad_s[kept], got.accel_m_s2[kept])
    biases = got.gyro_bias_rad_s[kept], got.accel_bias_m_s2[kept]
    poses.write_euroc_imu(folder / "imu_biases.csv", got.t_ns[kept], *biases)
    write_text(folder / "imu.yaml", "".join(f"{key}: {value!r}\n" for key, value in imu.kalibr().items()))


def _imu(recipe: Recipe) -> imus.Imu:
    options = recipe.imu or {}
    placed = rig.rig_from_camera(options["position_m"], options["rotation_deg"])
    return imus.Imu.of_part(options["part"], options["rate_hz"], placed, turn_on=options["turn_on"])


def _imu_entry(recipe: Recipe) -> dict[str, Any] | None:
    """The IMU in sequence.json. noise: densities and random walks in Kalibr's sense, SI units."""
    if not recipe.imu:
        return None
    imu = _imu(recipe)
    more = {"rig_from_imu": imu.rig_from_imu.tolist(), "gravity_m_s2": [0.0, 0.0, -GRAVITY_M_S2], "noise": imu.kalibr()}
    return recipe.imu | more


# Light and truth


def _parameters(work: Work) -> list[Any]:
    """Command-line arguments that set the drawn scene parameters."""
    found: list[Any] = [f"--set={key}={value}" for key, value in work.drawn["parameters"].items()]
    if work.drawn["place"]:
        write_json(
            work.folder / "place.json",
            {"format": 1, "objects": placing.placed(work.drawn["place"], work.recipe.path.parent)},
        )
        found += ["--place", "place.json"]
    return found


def _render(work: Work, entry: CameraEntry, threads: int) -> None:
    """Light, and ground truth if the camera has pixels of its own."""
    recipe, scene = work.recipe, work.recipe.scene(work.drawn["scene"])
    owner = recipe.owner(entry)
    (work.folder / entry.name).mkdir(exist_ok=True)
    drawn = work.drawn["cameras"][owner.name]
    chip, width, height = film(work, entry)
    options = {
        "camera_path": f"{owner.name}/camera_path.txt",
        "lens": owner.lens,
        "fnumber": drawn["fnumber"],
        "focus_m": drawn["focus_m"],
        "chip": chip,
        "width": width,
        "height": height,
        "light_scale": work.drawn["light_scale"],
        "seed": int(recipe.rng(work.index, f"camera.{entry.name}.render").integers(2**31 - 1)),
        "threads": threads,
    }
    light = recipe.render_options(scene, entry)
    flags = [scene.path, *_parameters(work)]
    seconds = work.drawn["duration_s"]

    def render(what: str, to: Path, *own: Any) -> None:
        step = f"{entry.name}: {what}"
        work.say(step)
        job = ["render", *flags, "-o", to.relative_to(work.folder), *own]
        blender(*job, folder=work.folder, log=f"{entry.name}/render.log", tell=partial(work.say, step))
        write_whole(to / "done", b"")

    if owner is not entry:  # its film stands where that of the owner stands
        options["focus_bands_nm"] = ",".join(map(str, rig.stack_json(work.stack(owner))["lens"]["focus_bands_nm"]))
    if owner is entry and recipe.truth["layers"] and not (work.truth(entry) / "done").exists():
        own = {k: v for k, v in light.items() if k not in OF_LIGHT}
        fps = recipe.truth["fps"]
        own |= {"fps": fps, "frames": recipe.truth_frames(seconds), "layers": ",".join(recipe.truth["layers"])}
        render("truth", work.truth(entry), "--no-light", *words(options | own))
    if not (work.stack(entry) / "done").exists():
        ranges = rgb.light_instants(recipe, work.drawn, entry)
        own = light | {"frames": ",".join(f"{begin}:{end}" for begin, end in ranges)}
        render("light", work.stack(entry), *words(options | own))


def film(work: Work, entry: CameraEntry) -> tuple[Any, int, int]:
    """The chip that determines film width and bands (its path is relative to the work's folder), and the size of the
    picture in pixels."""
    width, height, pitch_um = pixels(work.recipe, entry)
    if entry.kind == "events":
        return _copied(work, entry, str(entry.chip), "chip.json"), width, height
    assert entry.film
    rgb.write_chip(work.folder / entry.name / "film.json", None, width, height, pitch_um, entry.film.peak_qe)
    return f"{entry.name}/film.json", width, height


def _copied(work: Work, entry: CameraEntry, name: str, to: str) -> str:
    """CAMERA/`to`, a copy of the file `name` beside the recipe, so that records contain no path of this machine; the
    name itself if there is no such file."""
    path = beside(work.recipe, name)
    if not path:
        return name
    write_whole(work.folder / entry.name / to, path.read_bytes())
    return f"{entry.name}/{to}"


# Calibration


def _describe(work: Work) -> None:
    """sequence.json and the rectification maps."""
    recipe = work.recipe
    views = {c.name: _view(work, c) for c in recipe.cameras if not c.pixels_of}
    entries = []
    for entry in recipe.cameras:
        owner, name = recipe.owner(entry), entry.name
        view = views[owner.name]
        K_rect, R_rect, baseline = [view.pinhole.K], np.eye(3), None
        if entry.partner:
            other = views[recipe.owner(recipe.camera(entry.partner)).name]
            move = np.linalg.inv(view.placed) @ other.placed
            baseline, K_rect = float(np.linalg.norm(move[:3, 3])), [view.pinhole.K, other.pinhole.K]
            R_rect = rig.stereo_rotation(move)
        height, width = view.optics.directions.shape[:2]
        K = rig.rectified_K(K_rect, (width, height))
        rectify_map = rig.rectify_map(view.optics.directions, R_rect, K)
        write_whole(work.folder / name / "rectify_map.npy", npy_bytes(rectify_map))
        described = {
            key: getattr(entry, key) for key in ("name", "kind", "chip", "preset", "model", "partner", "pixels_of")
        }
        described |= {key: view.stack["lens"][key] for key in ("fnumber", "focus_m")}
        matrices = {"rig_from_camera": view.placed, "K": view.pinhole.K, "distortion": view.pinhole.distortion}
        matrices |= {"K_rect": K, "R_rect": R_rect}
        described |= {key: matrix.tolist() for key, matrix in matrices.items()}
        entries.append(
            described
            | {
                "width": width,
                "height": height,
                "overrides": work.drawn["cameras"][name]["overrides"],
                "lens": owner.lens,
                "pixel_pitch_um": view.stack["pixel_pitch_m"] * 1e6,
                "distortion_model": "radtan",
                "distortion_error_px": view.pinhole.error_px,
                "baseline_m": baseline,
            }
        )
    write_json(
        work.folder / "sequence.json",
        {
            "format": 1,
            "name": work.name,
            "split": work.drawn["split"],
            "seed": recipe.seed,
            "duration_us": work.duration_us,
            "drawn": portable(work.drawn),
            "scene": work.drawn["scene"],
            "cameras": entries,
            "imu": _imu_entry(recipe),
            "limits": recipe.limits,
            "versions": {"pecs": version(), "blender": view.stack["versions"]["blender"]},
            "about": recipe.about,
        },
    )


@dataclass(frozen=True)
class _View:
    """The camera as a stack records it. placed: rig_from_camera."""

    stack: dict[str, Any]
    optics: rig.Optics
    pinhole: rig.Pinhole
    placed: rig.Array


def _view(work: Work, entry: CameraEntry) -> _View:
    optics = rig.optics(stack := rig.stack_json(work.stack(entry)), entry.lens)
    recipe_check.covered(work.recipe, entry, optics.directions)
    placed = rig.rig_from_camera(entry.position_m, entry.rotation_deg)
    return _View(stack, optics, rig.pinhole(optics.directions), placed)


# Events


def _sense(work: Work, entry: CameraEntry) -> None:
    folder = work.folder / entry.name
    if (folder / "objects.npy").exists():
        return
    folder.mkdir(exist_ok=True)
    drawn, causes = work.drawn["cameras"][entry.name], folder / "causes.npy"
    if not (folder / "events.h5").exists() or not causes.exists():
        work.say(f"{entry.name}: events")
        chip, stages = film(work, entry)[0], dict(entry.stages)
        if "mask" in stages:
            stages["mask"] = str(work.folder / _copied(work, entry, stages["mask"], "mask.txt"))
        sense(
            work.stack(entry),
            folder / "events.h5",
            chip=work.folder / chip if "/" in chip else chip,
            overrides=drawn["overrides"],
            biases=drawn["biases"],
            **stages,
            warmup_us=WARMUP_US,
            **({"preset": entry.preset} if entry.preset else {"model": entry.model}),
            seed=drawn["seed"],
            format="dsec",
            labels=causes,
            duration_us=work.duration_us,
        )
        record = folder / "events.h5.run.json"
        write_text(record, read_text(record, MAX_BYTES).replace(f"{work.folder}/", ""))
    pictures.label_events(work, entry, folder)


def _report(work: Work) -> None:
    """report.html and checks.json."""
    work.say("report")
    report.write(Sequence(work.folder))


def _drop(work: Work) -> None:
    """Deletes stacks that the recipe does not keep, and inputs of the renderer."""
    (work.folder / "place.json").unlink(missing_ok=True)
    (work.folder / "survey.npz").unlink(missing_ok=True)
    for name in (c.name for c in work.recipe.cameras):
        for what, folder in (("light", "stack"), ("truth", "truth")):
            if not work.recipe.keep[what]:
                shutil.rmtree(work.folder / name / folder, ignore_errors=True)
