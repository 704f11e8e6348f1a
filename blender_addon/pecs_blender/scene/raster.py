# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's raster engine EEVEE: direct light with shadows, and the world's light without occlusion. Colours, lamps and
units are those of Cycles; reflections, refraction and light between surfaces are not traced."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from pecs._errors import ExitCode, PecsError

from .. import stop
from .cycles import changed, quiet

ENGINE = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"
SETTINGS = {  # the same for every render, and recorded with it
    "use_raytracing": False,  # in the space of the screen: it depends on what is in view
    "use_shadows": True,
    "shadow_step_count": 16,
    "light_threshold": 2e-9,  # of the brightest lamp's power: there the reach of lamps ends
    "clamp_surface_direct": 0.0,
    "clamp_surface_indirect": 0.0,
    "clamp_volume_direct": 0.0,
    "clamp_volume_indirect": 0.0,
    "use_bokeh_jittered": True,  # depth of field by samples, as a path tracer's
    "use_overscan": False,
}
FACTORS = ("diffuse_factor", "specular_factor", "transmission_factor", "volume_factor")  # of lamps, for EEVEE alone
CAMERAS = "PERSP", "ORTHO"  # it draws others as PERSP
FILTER_PX = 1.0  # radius of its Blackman-Harris filter, as sharp as the box of a pixel
NEAREST = 1e-6  # of the camera's farthest distance: the depth buffer has 24 bits
TRY = f"""
import bpy
scene = bpy.context.scene
scene.render.engine, scene.eevee.taa_render_samples = "{ENGINE}", 1
scene.render.resolution_x = scene.render.resolution_y = 4
bpy.ops.render.render()
"""


def approximated(emitting: list[str]) -> str:
    """What EEVEE does otherwise. emitting: names of materials."""
    lamps = f"; surfaces that emit light nothing: {', '.join(emitting)}" if emitting else ""
    return f"engine eevee: light between surfaces, reflections and refraction are not traced{lamps}"


def check_graphics() -> None:
    """Draws a small picture in another process: without graphics, Blender aborts. Raises PecsError."""
    blender = [bpy.app.binary_path, "--background", "--factory-startup", "--python-expr"]
    command = [*(blender if bpy.app.binary_path else [sys.executable, "-c"]), TRY]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        wanted = "a graphics card, or software OpenGL (Debian: libegl1 and libgl1-mesa-dri)"
        raise PecsError(f"--engine eevee: got no OpenGL, wanted {wanted}", ExitCode.UNSUPPORTED)


class Film:
    """Renders the scene to linear float pixels. scratch: folder of the file that Blender writes: in the background, it
    keeps no result."""

    def __init__(self, scene: bpy.types.Scene, samples: int, scratch: Path):
        self._scene, self._samples, self._file = scene, samples, scratch / "raster.exr"
        for material in bpy.data.materials:
            material.use_backface_culling = material.use_backface_culling_shadow = False
        for light in bpy.data.lights:
            light.use_custom_distance = False
            for name in FACTORS:
                setattr(light, name, 1.0)

    def parts(self, boxes_px: list, *_names: str) -> Iterator[dict[str, np.ndarray]]:
        """As cycles.Film.parts, but "Combined" is the only pass: parts of one picture."""
        picture = self._picture()
        for left, top, right, bottom in boxes_px:
            yield {"Combined": picture[:, top:bottom, left:right]}

    def _picture(self) -> np.ndarray:
        """[3, height, width], float32, row 0 at the top."""
        stop.check()
        render = {"engine": ENGINE, "filepath": str(self._file), "filter_size": FILTER_PX}
        eevee = {name: value for name, value in SETTINGS.items() if hasattr(self._scene.eevee, name)}
        camera = self._scene.camera.data
        if camera.type not in CAMERAS:
            wanted = "PERSP or ORTHO, or --engine cycles"
            raise PecsError(f"{camera.name}: type: got {camera.type}, wanted {wanted}", ExitCode.UNSUPPORTED)
        near = {"clip_start": max(camera.clip_start, camera.clip_end * NEAREST)}
        eevee["light_threshold"] *= _brightest_w()
        eevee["taa_render_samples"] = self._samples
        with changed([(self._scene.render, render), (self._scene.eevee, eevee), (camera, near)]), quiet(2):
            bpy.ops.render.render(scene=self._scene.name, write_still=True)
        stop.check()
        image = bpy.data.images.load(str(self._file))
        values = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
        image.pixels.foreach_get(values)
        picture = values.reshape(image.size[1], image.size[0], -1)[::-1, :, :3].transpose(2, 0, 1)
        bpy.data.images.remove(image)
        return np.ascontiguousarray(picture)


def _brightest_w() -> float:
    """Power of the brightest lamp. Farther lamps than the threshold allows are missing; with a reach far beyond the
    scene, shadows are."""
    lamps = [light for light in bpy.data.lights if light.type != "SUN"]  # a sun has no reach
    return max((light.energy * max(light.color) * 2**light.exposure for light in lamps), default=0.0)
