# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles as a measuring instrument: fixed sampling, box filter, no view transform, float output."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import bpy
import numpy as np
from pecs._errors import ExitCode, PecsError
from pecs._platform import discarded

from .. import stop

SETTINGS = {  # the same for every render, and recorded with it
    "sampling_pattern": "AUTOMATIC",
    "use_adaptive_sampling": False,  # the number of samples must not depend on the picture
    "use_denoising": False,
    "pixel_filter_type": "BOX",  # a pixel integrates over its own square
    "filter_width": 1.0,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "min_light_bounces": 2,  # the passes of all bands have the same paths; see Sampling.settings
    "caustics_reflective": True,
    "caustics_refractive": True,
    "blur_glossy": 0.0,
    "light_sampling_threshold": 0.0,  # otherwise dim light samples are dropped at random: tenfold noise
    "use_auto_tile": False,
    "use_fast_gi": False,
    "use_guiding": False,  # learns from the whole picture: still pixels would change with what moves
    "film_exposure": 1.0,
}
LEAST_PX = 4  # of a picture, each way: Blender's limit
NO_SURFACE = 1e10  # value of the Depth pass where there is no surface
WORLD_MAP_WIDTH = 2048  # upper limit; 1024 misses the sun in a texture of 4096
BOUNCES = (  # settings that a .blend keeps
    "max_bounces",
    "diffuse_bounces",
    "glossy_bounces",
    "transmission_bounces",
    "volume_bounces",
    "transparent_max_bounces",
)


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """How Cycles samples. samples: per rendered pixel. bounces: Cycles settings. threads 0: all cores. denoise: whether
    the light is denoised (camera/denoise.py), with adaptive steps only: the remaining noise flickers from frame to
    frame. The number of samples is even then, so that they can be halved."""

    samples: int
    seed: int
    bounces: dict[str, Any]
    threads: int = 0
    device: str = "CPU"
    denoise: bool = False
    light_tree: bool = False
    noise_events: float | None = None  # highest share of events that come from noise; replaces samples
    engine: str = "cycles"

    @property
    def settings(self) -> dict[str, Any]:
        """Of Cycles. Russian roulette begins at the first bounce of light that is denoised: less noise for the time."""
        return SETTINGS | self.bounces | ({"min_light_bounces": 0} if self.denoise else {})


def empty_scene() -> bpy.types.Scene:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.world = None  # even a black world would get every second light sample
    return scene


def white_furnace() -> bpy.types.Scene:
    """Creates a white furnace: a scene with a uniform environment of radiance 1."""
    scene = bpy.data.scenes.new("white furnace")
    scene.world = bpy.data.worlds.new("white")
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"].inputs
    background["Color"].default_value, background["Strength"].default_value = (1.0, 1.0, 1.0, 1.0), 1.0
    return scene


def device_names(device: str) -> list[str]:
    """Switches the devices of a type on, and returns their names. Raises PecsError if there are none."""
    if device == "CPU":
        return ["CPU"]
    preferences = bpy.context.preferences.addons["cycles"].preferences
    offered = [item[0] for item in preferences.get_device_types(bpy.context)]
    if device in offered:
        preferences.compute_device_type = device
        preferences.refresh_devices()
        for one in preferences.devices:
            one.use = one.type == device
        names = [one.name for one in preferences.devices if one.use]
        if names:
            return names
    raise PecsError(
        f"--device: got {device}, wanted one that this machine has; CPU works everywhere", ExitCode.UNSUPPORTED
    )


def configure(scene: bpy.types.Scene, width: int, height: int, sampling: Sampling) -> None:
    scene.render.engine = "CYCLES"
    for key, value in sampling.settings.items():
        setattr(scene.cycles, key, value)
    scene.cycles.device = "CPU" if sampling.device == "CPU" else "GPU"
    scene.cycles.samples = sampling.samples
    scene.cycles.use_light_tree = sampling.light_tree
    for layer in scene.view_layers:
        layer.samples = 0  # use the scene's
        layer.cycles.denoising_store_passes = sampling.denoise  # denoise.GUIDES
    scene.cycles.seed = sampling.seed
    scene.cycles.use_animated_seed = False  # a static pixel gets the same samples in every frame
    scene.cycles.use_sample_subset, scene.cycles.time_limit = False, 0.0  # all samples, however long they take
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.render.use_motion_blur = False
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.use_border = scene.render.use_multiview = scene.render.use_freestyle = False
    scene.render.use_stamp = False  # EEVEE's picture is written by Blender, with text in it
    scene.render.use_crop_to_border = True  # else Blender makes a picture of the whole frame for each part
    scene.render.film_transparent = False
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0
    scene.render.dither_intensity = 0.0
    scene.render.threads_mode = "FIXED" if sampling.threads else "AUTO"
    if sampling.threads:
        scene.render.threads = sampling.threads
    image = scene.render.image_settings  # for save_picture
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGB", "32", "NONE"
    scene.view_settings.view_transform = "Raw"
    _limit_world_map(scene.world)


def _limit_world_map(world: bpy.types.World | None) -> None:
    """Limits the importance map of an environment texture. Cycles rebuilds it in every pass, because colours change;
    its default width of 4096 takes longer than rendering."""
    widths = [image.size[0] for image in _images(world.node_tree)] if world and world.node_tree else []
    if widths and world.cycles.sampling_method == "AUTOMATIC":
        world.cycles.sampling_method = "MANUAL"
        world.cycles.sample_map_resolution = min(max(*widths, 4), WORLD_MAP_WIDTH)


def _images(tree: bpy.types.NodeTree):
    for node in tree.nodes:
        if node.bl_idname in ("ShaderNodeTexEnvironment", "ShaderNodeTexImage") and node.image:
            yield node.image
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
            yield from _images(node.node_tree)


def set_border(scene: bpy.types.Scene, box_px: tuple[int, int, int, int] | None) -> None:
    """Renders only this box (left, top, right, bottom), with the same rays."""
    render = scene.render
    render.use_border = box_px is not None
    if box_px:
        (left, top, right, bottom), width, height = box_px, render.resolution_x, render.resolution_y
        # Blender multiplies by the size and truncates: half a pixel keeps rounding errors from the result.
        render.border_min_x, render.border_max_x = (left + 0.5) / width, (right + 0.5) / width
        render.border_min_y, render.border_max_y = 1 - (bottom - 0.5) / height, 1 - (top - 0.5) / height


@contextlib.contextmanager
def sample_subset(scene: bpy.types.Scene, first: int, count: int):
    """Renders only these samples of the sequence of scene.cycles.samples."""
    subset = {"use_sample_subset": True, "sample_offset": first, "sample_subset_length": count}
    with changed([(scene.cycles, subset)]):
        yield


def _no_engine_traceback(unraisable) -> None:
    """Hides a harmless error: Blender 4.5 frees a persistent engine before its Python object, whose __del__ fails."""
    if not (unraisable.exc_type is ReferenceError and "CyclesRender" in str(unraisable.exc_value)):
        sys.__unraisablehook__(unraisable)


sys.unraisablehook = _no_engine_traceback


@contextlib.contextmanager
def quiet(*descriptors: int, into: BinaryIO | None = None):
    """Discards what Blender prints to the C stdout for every frame, and to `descriptors`; `into`: a file gets it."""
    sys.stdout.flush()
    with discarded(1, *descriptors, into=into):
        try:
            yield
        finally:
            sys.stdout.flush()


class Film:
    """Renders the scene to linear float pixels without a file. Blender keeps no result in the background; Cycles'
    engine has it."""

    def __init__(self, scene: bpy.types.Scene):
        self._scene = scene

    def render(self) -> np.ndarray:
        """[3, height, width], float32, row 0 at the top."""
        return self.passes("Combined")["Combined"][:3]

    def passes(self, *names: str, inspect: Callable | None = None) -> dict[str, np.ndarray]:
        """Passes of Cycles by name, each [channels, height, width] of the picture or of `set_border`'s box. inspect:
        called with the render's own depsgraph before Cycles reads the scene from it; a viewport's depsgraph
        lacks what only renders show."""
        results = self._run(inspect, True)
        if not results or any(name not in results[-1] for name in names):
            raise PecsError(f"Cycles of Blender {bpy.app.version_string}: no {', '.join(names)}", ExitCode.UNSUPPORTED)
        return {name: results[-1][name] for name in names}

    def parts(self, boxes_px: list, *names: str) -> Iterator[dict[str, np.ndarray]]:
        """`passes` of boxes (left, top, right, bottom) of the picture."""
        whole = 0, 0, self._scene.render.resolution_x, self._scene.render.resolution_y
        for box in boxes_px:
            set_border(self._scene, None if box == whole else box)
            yield self.passes(*names)
        set_border(self._scene, None)

    def inspect(self, inspect: Callable) -> None:
        """Calls `inspect` as `passes` does, and renders nothing."""
        self._run(inspect, False)

    def _run(self, inspect: Callable | None, renders: bool) -> list[dict[str, np.ndarray]]:
        stop.check()
        # Cycles keeps its data, and ignores changes of its own settings unless the scene is tagged. The setter of this
        # property tags the scene's settings only; `update_tag` also tags all objects: Cycles would rebuild its BVH.
        self._scene.render.film_transparent = False
        with _engine_results(inspect, renders) as results, quiet():
            bpy.ops.render.render(scene=self._scene.name)
        stop.check()
        return results


@contextlib.contextmanager
def _engine_results(inspect: Callable | None, renders: bool):
    """Collects what Cycles' engine renders in this context: per view layer, passes by name, row 0 at the top."""
    from cycles import CyclesRender  # Blender's add-on
    from cycles import engine as cycles_engine

    render, update, results, errors = CyclesRender.render, CyclesRender.update, [], []

    def update_in_order(engine, data, depsgraph):
        """Cycles puts what appears behind all that it has kept, and samples of lights depend on their order. So if one
        appears or vanishes, Cycles starts as in a new process."""
        if renders:
            known, before = getattr(engine, "pecs_lights", ({}, None))
            shown = ((one.object, one.random_id) for one in depsgraph.object_instances)
            lights = [(thing.name_full, number) for thing, number in shown if _emits(thing, known)]
            if engine.session and before not in (None, lights):
                cycles_engine.free(engine)
                engine.session = None
            engine.pecs_lights = known, lights
        update(engine, data, depsgraph)

    def render_and_keep(engine, depsgraph):
        try:
            if inspect:
                inspect(depsgraph)
        except Exception as e:  # Blender would print it and continue
            errors.append(e)
            return
        if renders:
            render(engine, depsgraph)
            results.extend(_passes_by_name(engine.get_result()))

    CyclesRender.render, CyclesRender.update = render_and_keep, update_in_order
    try:
        yield results
    finally:
        CyclesRender.render, CyclesRender.update = render, update
    if errors:
        raise errors[0]


def _emits(thing: bpy.types.Object, known: dict[str, bool]) -> bool:
    """known: of objects by name."""
    name = thing.name_full
    if name not in known:
        trees = [slot.material.node_tree for slot in thing.material_slots if slot.material]
        known[name] = thing.type == "LIGHT" or any(map(_may_emit, trees))
    return known[name]


def _may_emit(tree: bpy.types.NodeTree | None) -> bool:
    for node in tree.nodes if tree else ():
        emission = node.inputs.get("Emission Strength")
        if node.type == "EMISSION" or (emission and (emission.is_linked or emission.default_value)):
            return True
        if node.type == "GROUP" and _may_emit(node.node_tree):
            return True
    return False


# Names of passes in Blender 4.5 -> 5.
_NEW_NAMES = {"DiffDir": "Diffuse Direct", "DiffInd": "Diffuse Indirect", "DiffCol": "Diffuse Color"}


def _passes_by_name(result):
    size = result.resolution_y, result.resolution_x
    for layer in result.layers:
        values = np.empty(sum(p.channels for p in layer.passes) * size[0] * size[1], np.float32)
        layer.passes.foreach_get("rect", values)
        passes = {}
        for p in layer.passes:
            count = p.channels * size[0] * size[1]
            picture, values = values[:count].reshape(*size, p.channels), values[count:]
            passes[_NEW_NAMES.get(p.name, p.name)] = np.ascontiguousarray(picture[::-1].transpose(2, 0, 1))
        yield passes


@contextlib.contextmanager
def for_one_sample(scene: bpy.types.Scene, camera: bpy.types.Object, size: tuple[int, int] | None = None):
    """Settings for the first hit of the ray through each pixel's centre, of the whole picture or of a smaller one of
    the same film. Restores all settings at the end."""
    render, cycles, layer = scene.render, scene.cycles, scene.view_layers[0]
    whole = render.resolution_x, render.resolution_y
    width, height = size or whole
    aspect = {"pixel_aspect_x": whole[0] / width, "pixel_aspect_y": whole[1] / height}
    ray = {"samples": 1, "max_bounces": 0, "transparent_max_bounces": 1024, "filter_width": 0.01}
    ray["shading_system"] = False  # shaders in OSL write no AOVs
    changes = (
        (scene, {"camera": camera}),
        (render, {"use_border": False, "resolution_x": width, "resolution_y": height} | aspect),
        (cycles, ray),
        (layer, {"use_pass_position": True, "use_pass_z": True, "pass_alpha_threshold": 0.5}),
        (layer.cycles, {"denoising_store_passes": False}),
    )
    with changed(changes):
        yield


@contextlib.contextmanager
def changed(changes):
    """Sets properties of pairs (thing, {name: value}), and restores them at the end."""
    saved = [(thing, {key: getattr(thing, key) for key in values}) for thing, values in changes]
    try:
        _set_all(changes)
        yield
    finally:
        _set_all(saved)


def picture_size(scene: bpy.types.Scene, width: int, height: int, **settings: Any):
    """This size of the picture, and settings of Cycles, until the end of the context."""
    size = {"resolution_x": width, "resolution_y": height}
    return changed(((scene.render, size), (scene.cycles, settings)))


def _set_all(changes) -> None:
    for thing, values in changes:
        for key, value in values.items():
            setattr(thing, key, value)


def save_picture(picture: np.ndarray, path: Path, scene: bpy.types.Scene) -> None:
    """Writes [height, width, 3] to an EXR file, bit-exact (`configure` sets the format)."""
    height, width, _ = picture.shape
    image = bpy.data.images.new(path.stem, width, height, float_buffer=True, is_data=True)
    fill(image, picture)
    image.save_render(str(path), scene=scene)
    bpy.data.images.remove(image)


def fill(image: bpy.types.Image, picture: np.ndarray) -> None:
    """Sets all pixels of an image; picture: [height, width, 3] or, grey, [height, width, 1]."""
    rgba = np.ones((*picture.shape[:2], 4), np.float32)
    rgba[..., :3] = picture[::-1]  # Blender's row 0 is at the bottom
    image.pixels.foreach_set(rgba.ravel())


def interpolated(lambda_nm, values):
    return lambda nm: np.interp(nm, lambda_nm, values)


def new_camera(name: str) -> bpy.types.Object:
    camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    unit_m = bpy.context.scene.unit_settings.scale_length
    camera.data.clip_start, camera.data.clip_end = 1e-5 / unit_m, 1e4 / unit_m
    bpy.context.scene.collection.objects.link(camera)
    return camera


def pinhole_camera(name: str, focal_mm: float, film_width_mm: float) -> bpy.types.Object:
    camera = new_camera(name)
    camera.data.sensor_fit = "HORIZONTAL"
    camera.data.sensor_width = film_width_mm
    camera.data.lens = focal_mm
    return camera


def orthographic_camera(name: str, width_m: float) -> bpy.types.Object:
    camera = new_camera(name)
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = width_m
    return camera
