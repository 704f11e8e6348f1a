"""Faults of a plan before the first ray, beyond its recipe's tables: every part that it names is opened or tried as the
run does it, with the ends of its drawn values."""

from __future__ import annotations

import numpy as np

from .. import sensor
from .._arguments import words
from .._errors import ExitCode, PecsError, bad_input
from ..lens import Lens
from . import blender, parameters, rig, scene_cameras, trajectories
from .plan import OF_SCENE, CameraPlan, Plan, SequencePlan, at
from .recipe import OWN_LENS, Recipe

WITH_PICTURES = ("evreal", "event_cnn", "radiance")  # exports that require pictures of the pixels of events
WITHOUT_EVENTS = ("coco",)
FIRST = 1000  # sequences among which a scene's first one is looked for


def check(plan: Plan) -> None:
    """Raises PecsError, with the recipe's path and the place in it, for what cannot be made."""
    recipe = plan.recipe
    _partners(plan)
    _exports(plan)
    _scripts(recipe)
    tried: set[str] = set()  # what several sequences of `ends` share
    jobs: list[list[str]] = []
    for sequence in plan.ends():
        for camera in sequence.cameras:
            with at(recipe, f"rig.camera {camera.name}"):
                _camera(recipe, camera, tried)
        with at(recipe, f"scene {sequence.scene.name}.trajectory"):
            kind, given = sequence.path
            if kind not in (kinds := (*trajectories.KINDS, OF_SCENE)):
                raise bad_input(recipe.path, f"scene {sequence.scene.name}.trajectory.kind", kind, ", ".join(kinds))
            if kind != OF_SCENE:
                parameters.read(kind, given)
        for camera in sequence.cameras:
            with at(recipe, f"rig.camera {camera.name}.lens"):
                scene_cameras.K(sequence, camera)
        jobs += [job for job in _renders(sequence) if job not in jobs]
    for scene in recipe.scenes:  # as if it were empty
        with at(recipe, f"scene {scene.name}.trajectory"):
            first = (i for i in range(min(recipe.sequences, FIRST)) if plan.scene(i) is scene)
            if (index := next(first, None)) is not None:
                sequence = plan.sequence(index)
                if sequence.follows_scene:
                    scene_cameras.trajectory(sequence)
                else:
                    trajectories.plan(*sequence.path, None, sequence.rng("trajectory"))
    if fault := blender.fault_of(jobs):
        raise PecsError(f"{recipe.path}: {fault}", ExitCode.BAD_INPUT)


# The rig


def _partners(plan: Plan) -> None:
    entries = {entry.name: entry for entry in plan.recipe.cameras}
    for entry in (entry for entry in entries.values() if entry.partner):
        other, place = entries[str(entry.partner)], f"rig.camera {entry.name}.partner"
        if other.partner != entry.name or other.kind != entry.kind:
            wanted = "a camera of the same kind whose partner is this one"
            raise bad_input(plan.recipe.path, place, other.name, wanted)
        a, b = plan.pixels[entry.name].owner, plan.pixels[other.name].owner
        if a is b or np.allclose(a.position_m, b.position_m, rtol=0, atol=1e-9):
            raise bad_input(plan.recipe.path, place, other.name, "a camera at another position_m")
        with at(plan.recipe, place):
            rig.rectified_axes(*(rig.rig_from_camera(of.position_m, of.rotation_deg) for of in (a, b)))


def _exports(plan: Plan) -> None:
    owners: dict[str, set[str]] = {"events": set(), "rgb": set()}
    for entry in plan.recipe.cameras:
        owners[entry.kind].add(plan.pixels[entry.name].owner.name)
        if entry.frames:
            owners["rgb"].add(plan.pixels[entry.name].owner.name)
    for name in plan.recipe.export:
        if name not in WITHOUT_EVENTS and not owners["events"]:
            raise bad_input(plan.recipe.path, "export", name, "a rig with an event camera for it")
        if name in WITH_PICTURES and not owners["events"] & owners["rgb"]:
            wanted = "an RGB camera whose pixels_of is an event camera, or an event camera with frames, for it"
            raise bad_input(plan.recipe.path, "export", name, wanted)


def _camera(recipe: Recipe, camera: CameraPlan, tried: set[str]) -> None:
    """Opens a camera's sensor and lens, unless they were tried."""
    if camera.entry.kind == "events" and (key := f"{camera.name} {camera.sensor()}") not in tried:
        tried.add(key)
        size, frames = (camera.pixels.width, camera.pixels.height), camera.entry.frames
        sensor.Sensor(*size, chip_frames=frames, **camera.sensor()).close()
    if (key := f"{camera.name} {camera.fnumber} {camera.focus_m}") not in tried:
        tried.add(key)
        see_corners(recipe, camera)


def see_corners(recipe: Recipe, camera: CameraPlan) -> None:
    """Raises PecsInputError for a lens that does not cover the film of its camera."""
    if not camera.owns_pixels or camera.entry.lens == OWN_LENS:
        return
    width, height, pitch_um = camera.pixels.width, camera.pixels.height, camera.pixels.pitch_um
    corners = np.array([[x, y] for y in (0.5, height - 0.5) for x in (0.5, width - 0.5)])
    setting = {"fnumber": camera.fnumber, "focus_m": camera.focus_m, "pixel_pitch_mm": pitch_um * 1e-3}
    with Lens(camera.entry.lens) as lens:
        covered(recipe, camera, lens.directions(corners, width=width, height=height, **setting))


def covered(recipe: Recipe, camera: CameraPlan, directions: rig.Array) -> None:
    """Raises PecsInputError for pixels without light."""
    if lost := int(np.isnan(directions).any(-1).sum()):
        place, got = f"rig.camera {camera.name}.lens", f"{camera.entry.lens}, which does not illuminate {lost} pixels"
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
        if scene.path.suffix == ".blend" and scene.parameters:
            raise bad_input(recipe.path, f"scene {scene.name}.set", "parameters of a .blend", "none (of scene folders)")


def _renders(sequence: SequencePlan) -> list[list[str]]:
    """The renderer's command lines of a sequence, which it reads without a render."""
    options = [sequence.light(camera) for camera in sequence.with_light]
    options += [truth for camera in sequence.cameras if (truth := sequence.truth(camera))]
    return [["render", *map(str, sequence.scene_words), "-o", "stack", *words(one)] for one in options]
