# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles as a measuring instrument: fixed sampling, box pixels, no view transform, float pixels out."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..core.errors import UNSUPPORTED, RenderError

SETTINGS = {  # what is the same for every render, and recorded with it
    "use_adaptive_sampling": False,  # the number of samples must not depend on the picture
    "use_denoising": False,
    "pixel_filter_type": "BOX",  # a pixel integrates over its own square
    "filter_width": 1.0,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "min_light_bounces": 2,  # no Russian roulette within them: less noise for the time
    "caustics_reflective": True,
    "caustics_refractive": True,
    "blur_glossy": 0.0,
    "light_sampling_threshold": 0.0,  # else dim light samples are thinned out at random: tenfold noise
    "use_light_tree": False,  # it is rebuilt when anything moves, and still pixels would get other samples
    "use_auto_tile": False,
    "use_fast_gi": False,
    "film_exposure": 1.0,
}
BOUNCES = (  # a .blend's own
    "max_bounces",
    "diffuse_bounces",
    "glossy_bounces",
    "transmission_bounces",
    "volume_bounces",
    "transparent_max_bounces",
)


def empty_scene() -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = None  # even a black world would be drawn as a light, every second sample
    return scene


def white_furnace() -> bpy.types.Scene:
    """A further scene: nothing but radiance 1 from everywhere."""
    scene = bpy.data.scenes.new("white furnace")
    scene.world = bpy.data.worlds.new("white")
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"].inputs
    background["Color"].default_value, background["Strength"].default_value = (1.0, 1.0, 1.0, 1.0), 1.0
    return scene


@dataclass(frozen=True)
class Sampling:
    """samples: per pixel. device: CPU, or a compute device type of Cycles. denoise: OpenImageDenoise with albedo and
    normals. threads 0: all. bounces: Cycles settings."""

    samples: int
    seed: int
    bounces: dict
    threads: int = 0
    device: str = "CPU"
    denoise: bool = False


def device_names(device: str) -> list[str]:
    """The devices of a type, switched on; throws where there are none."""
    if device == "CPU":
        return ["CPU"]
    preferences = bpy.context.preferences.addons["cycles"].preferences
    offered = [item[0] for item in preferences.get_device_types(bpy.context)]
    if device in offered:
        preferences.compute_device_type = device
        preferences.refresh_devices()
        for found in preferences.devices:
            found.use = found.type == device
        names = [found.name for found in preferences.devices if found.use]
        if names:
            return names
    raise RenderError(UNSUPPORTED, f"--device: got {device}, wanted one that this machine has; CPU works everywhere")


def configure(scene: bpy.types.Scene, width: int, height: int, sampling: Sampling) -> None:
    scene.render.engine = "CYCLES"
    for key, value in (SETTINGS | sampling.bounces).items():
        setattr(scene.cycles, key, value)
    scene.cycles.device = "CPU" if sampling.device == "CPU" else "GPU"
    scene.cycles.samples = sampling.samples
    scene.cycles.seed = sampling.seed
    scene.cycles.use_animated_seed = False  # a static pixel gets the same samples in every frame
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.render.use_motion_blur = False
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.use_border = scene.render.use_multiview = scene.render.use_freestyle = False
    scene.render.film_transparent = False
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0
    scene.render.dither_intensity = 0.0
    scene.render.threads_mode = "FIXED" if sampling.threads else "AUTO"
    if sampling.threads:
        scene.render.threads = sampling.threads
    if sampling.denoise:
        scene.cycles.use_denoising, scene.cycles.denoiser = True, "OPENIMAGEDENOISE"
        scene.cycles.denoising_input_passes, scene.cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "ACCURATE"
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGB", "32", "NONE"
    scene.view_settings.view_transform = "Raw"


def set_border(scene: bpy.types.Scene, box_px: tuple[int, int, int, int] | None) -> None:
    """Renders only left, top, right, bottom; the rest of the picture is then black. Rays are the same."""
    render = scene.render
    render.use_border, render.use_crop_to_border = box_px is not None, False
    if box_px:
        (left, top, right, bottom), width, height = box_px, render.resolution_x, render.resolution_y
        render.border_min_x, render.border_max_x = left / width, right / width
        render.border_min_y, render.border_max_y = 1 - bottom / height, 1 - top / height


def _no_engine_traceback(unraisable) -> None:
    """Blender 4.5 frees a persistent engine before Python's half of it, whose __del__ then fails; it means nothing."""
    if not (unraisable.exc_type is ReferenceError and "CyclesRender" in str(unraisable.exc_value)):
        sys.__unraisablehook__(unraisable)


sys.unraisablehook = _no_engine_traceback


@contextlib.contextmanager
def quiet(*descriptors: int):
    """Blender prints to the C stdout for every frame; keep the terminal for progress and errors. While it opens a file,
    to stderr (2) as well."""
    sys.stdout.flush()
    null = os.open(os.devnull, os.O_WRONLY)
    saved = {fd: os.dup(fd) for fd in (1, *descriptors)}
    for fd in saved:
        os.dup2(null, fd)
    try:
        yield
    finally:
        sys.stdout.flush()
        for fd, copy in saved.items():
            os.dup2(copy, fd)
            os.close(copy)
        os.close(null)


class Film:
    """Renders the scene and hands over linear float pixels. One temporary file, removed at close()."""

    def __init__(self, scene: bpy.types.Scene):
        self._scene = scene
        self._folder = tempfile.TemporaryDirectory(
            prefix="pecs_", dir="/dev/shm" if Path("/dev/shm").is_dir() else None
        )
        scene.render.filepath = str(Path(self._folder.name) / "film.exr")

    def __enter__(self) -> Film:
        return self

    def __exit__(self, *_) -> None:
        self._folder.cleanup()

    def render(self) -> np.ndarray:
        """[3, height, width], float32, row 0 at the top."""
        with quiet():
            bpy.ops.render.render(write_still=True, scene=self._scene.name)
            image = bpy.data.images.load(self._scene.render.filepath, check_existing=False)
        try:
            width, height = image.size
            pixels = np.empty(height * width * image.channels, np.float32)
            image.pixels.foreach_get(pixels)
        finally:
            bpy.data.images.remove(image)
        return np.ascontiguousarray(pixels.reshape(height, width, -1)[::-1, :, :3].transpose(2, 0, 1))


def interpolated(lambda_nm, values):
    return lambda nm: np.interp(nm, lambda_nm, values)


def _new_camera(name: str) -> bpy.types.Object:
    camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    camera.data.clip_start, camera.data.clip_end = 1e-5, 1e4
    bpy.context.scene.collection.objects.link(camera)
    return camera


def pinhole_camera(name: str, focal_mm: float, film_width_mm: float) -> bpy.types.Object:
    camera = _new_camera(name)
    camera.data.sensor_fit = "HORIZONTAL"
    camera.data.sensor_width = film_width_mm
    camera.data.lens = focal_mm
    return camera


def orthographic_camera(name: str, width_m: float) -> bpy.types.Object:
    camera = _new_camera(name)
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = width_m
    return camera


def lens_camera(name: str, osl: str, folder: Path) -> bpy.types.Object:
    """A camera whose rays come from OSL source (pecs.Lens.camera); compiled into `folder`."""
    import _cycles

    if not _cycles.with_osl:
        raise RenderError(
            UNSUPPORTED,
            f"lens: got Blender {bpy.app.version_string} built without OSL, wanted blender.org's or `pip install bpy` "
            "(--lens none renders with the scene's own camera here)",
        )
    source, compiled = folder / f"{name}.osl", folder / f"{name}.oso"
    source.write_text(osl)
    with quiet():
        ok = _cycles.osl_compile(str(source), str(compiled))
    if not ok or not compiled.is_file():
        raise RenderError(
            UNSUPPORTED, f"{source}: the lens shader does not compile in Blender {bpy.app.version_string}"
        )
    camera = _new_camera(name)
    camera.data.type = "CUSTOM"
    camera.data.custom_mode = "EXTERNAL"
    with quiet(), open(os.devnull, "w") as null, contextlib.redirect_stderr(null):
        camera.data.custom_filepath = str(compiled)  # the wheel lacks oslquery: a harmless traceback
    return camera
