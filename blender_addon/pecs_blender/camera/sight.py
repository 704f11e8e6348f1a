# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through the pixels' centres, and the projection of scene points onto the film.

Cycles' Position pass is of the first sample, which goes through the pixel's centre, whatever the filter. A lens camera
would send that ray anywhere through the pupil; so another camera sends each pixel's chief ray from the pupil's centre,
in the prescription's direction (pecs.Lens.directions, with the inverse pecs.Lens.pixels). Without a lens, it is the
scene's own camera without depth of field.

Camera axes are those of pecs.Lens: x right, y down, z forward, in the scene's unit. Film coordinates are in pixels; the
centre of the first pixel is (0.5, 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..scene import cycles
from ..scene.source import FLIP
from .lens import osl_camera
from .stage import Stage

CHIEF_RAYS = """
shader chief_rays(output point position = 0, output vector direction = 0, output color throughput = 1) {{
  vector raster = camera_shader_raster_position();
  color d = texture("{path}", raster[0], 0.5 * (1 - raster[1]), "interp", "closest");
  direction = vector(d[0], d[1], d[2]);
}}
"""
NEAR_FIELD = 0.98  # of the lens's field; the slope from here to the edge extrapolates the image map beyond it


@dataclass(frozen=True)
class Viewpoint:
    """A camera at one instant. camera: the scene's own. camera_from_world: [4, 4]. clip_from_camera: [4, 4], None for
    cameras that are neither perspective nor orthographic. lens: whether the rays are a lens's. focus: what also decides
    the light of a camera without a lens."""

    camera: bpy.types.Object
    camera_from_world: np.ndarray
    clip_from_camera: np.ndarray | None
    lens: bool
    focus: tuple | None

    def same(self, other: Viewpoint) -> bool:
        """Whether both are bit-identical; an unknown projection never is."""
        if (self.camera, self.focus) != (other.camera, other.focus):
            return False
        if not np.array_equal(self.camera_from_world, other.camera_from_world):
            return False
        if self.lens or other.lens:
            return self.lens and other.lens
        mine, others = self.clip_from_camera, other.clip_from_camera
        return mine is not None and others is not None and np.array_equal(mine, others)


class Sight:
    """name: of the camera and its files. size: of the picture, by default the stage's."""

    def __init__(self, stage: Stage, name: str, size: tuple[int, int] | None = None):
        self._stage, self.size = stage, size or stage.size
        self._per_pixel = np.array(self.size) / stage.size  # pixels here per pixel of the stage
        self._sharp: dict[bpy.types.Camera, bpy.types.Camera] = {}
        if stage.lens:
            directions = self._lens_directions()
            x, y, z = np.moveaxis(directions, -1, 0)
            self._slopes = np.stack([x, y]) / z
            self._field = self._lens_field()
            seen = np.nan_to_num(directions * (1, -1, 1))  # Cycles' camera axes; without a chief ray, no surface
            path = stage.scratch / f"{name}.exr"
            # The picture twice, the second upside down: OSL's v starts at the top, in Blender 5.2 at the bottom.
            both = np.concatenate([seen, seen[::-1]])
            cycles.save_picture(both.astype(np.float32), path, stage.source.scene)
            self._camera = osl_camera(name, CHIEF_RAYS.format(path=path.as_posix()), stage.scratch)
        else:
            self._camera = bpy.data.objects.new(name, stage.source.own_camera.data)
            stage.source.scene.collection.objects.link(self._camera)
            bpy.context.view_layer.update()  # a scene folder's camera may just have been made

    def camera(self) -> bpy.types.Object:
        """The camera, moved to the scene's camera."""
        source = self._stage.source
        if self._stage.lens:
            source.place([self._camera])
        else:
            own = source.own_camera
            sharp = self._sharp_copy(own.data)
            if self._camera.data != sharp:  # assigning the same data would re-evaluate the scene
                self._camera.data = sharp
            if self._camera.parent != own:  # a copy of its matrix would lack the shear of scaled parents
                self._camera.parent = own
        return self._camera

    def _sharp_copy(self, own: bpy.types.Camera) -> bpy.types.Camera:
        if own not in self._sharp:
            self._sharp[own] = own.copy()
            self._sharp[own].animation_data_clear()
        sharp = self._sharp[own]
        for p in own.bl_rna.properties:  # at the current time
            if p.type in ("INT", "FLOAT", "ENUM") and not (p.is_readonly or getattr(p, "is_array", False)):
                if getattr(sharp, p.identifier) != (value := getattr(own, p.identifier)):
                    setattr(sharp, p.identifier, value)
        sharp.dof.use_dof = False
        return sharp

    def view(self, depsgraph: bpy.types.Depsgraph) -> Viewpoint:
        """The camera as evaluated in a render's depsgraph."""
        camera, lens = self._camera.evaluated_get(depsgraph), self._stage.lens is not None
        world = np.array(camera.matrix_world, float)
        world[:3, :3] /= np.linalg.norm(world[:3, :3], axis=0)
        clip, (width, height) = None, self.size
        if not lens and camera.data.type in ("PERSP", "ORTHO"):
            aspect = dict(zip(("scale_x", "scale_y"), 1 / self._per_pixel, strict=True))
            clip = np.array(camera.calc_matrix_camera(depsgraph, x=width, y=height, **aspect), float) @ FLIP
        own = self._stage.source.own_camera
        focus = None if lens else _focus(own.evaluated_get(depsgraph).data.dof, depsgraph)
        return Viewpoint(own, FLIP @ np.linalg.inv(world), clip, lens, focus)

    def points(self, view: Viewpoint, positions: np.ndarray) -> np.ndarray:
        """Points in camera axes [3, height, width] on the rays of the pixels' centres, at the depths of positions
        [3, height, width] in the world."""
        seen = transformed(view.camera_from_world, positions)
        rays = self.rays(view)
        if rays is not None:
            origins, along = rays
            seen[:2] = origins + along * seen[2]
        return seen

    def rays(self, view: Viewpoint) -> tuple[np.ndarray, np.ndarray] | None:
        """x and y of each pixel's ray at z = 0, and their slope in z: [2, height, width] each; None if unknown."""
        if view.lens:
            return np.broadcast_to(0.0, self._slopes.shape), self._slopes
        if view.clip_from_camera is None:
            return None
        clip = view.clip_from_camera
        x, y = self.centres()
        ndc = np.stack([2 * x / self.size[0] - 1, 1 - 2 * y / self.size[1]])
        # Row r of clip . (x, y, z, 1) = ndc_r times row 3, which has z and 1 alone; a row has x or y, z and 1.
        origin, along = (np.stack([(ndc[r] * clip[3, c] - clip[r, c]) / clip[r, r] for r in (0, 1)]) for c in (3, 2))
        return origin, along

    def centres(self) -> np.ndarray:
        """[2, height, width]"""
        width, height = self.size
        return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5))

    def film(self, view: Viewpoint, points: np.ndarray, infinite: np.ndarray) -> np.ndarray:
        """Pixels [2, n] of points [3, n] in camera axes, which are directions where `infinite` [n] is set; NaN for
        points that have no image."""
        if view.lens:
            return self._lens_pixels(points)
        if view.clip_from_camera is None:
            return np.full((2, points.shape[1]), np.nan)
        clip = view.clip_from_camera
        x, y, w = (clip[r, :3] @ points + np.where(infinite, 0, clip[r, 3]) for r in (0, 1, 3))
        with np.errstate(all="ignore"):
            ndc = np.where(w > 0, np.stack([x, -y]) / w, np.nan)
        return (ndc + 1) / 2 * np.array(self.size)[:, None]

    # The lens

    def _setting(self) -> dict:
        lens, (width, height) = self._stage.lens, self._stage.size
        return {
            "width": width,
            "height": height,
            "pixel_pitch_mm": lens.pixel_pitch_mm,
            "lambda_nm": float(self._stage.lambda_nm.mean()),
            "focus_bands_nm": lens.focus_bands(self._stage.lambda_nm),
            "film_shift_mm": lens.shift_mm,
            "film_tilt_deg": lens.tilt_deg,
            **lens.setting,
        }

    def _lens_directions(self) -> np.ndarray:
        """[height, width, 3]"""
        pixels = np.moveaxis(self.centres(), 0, -1) / self._per_pixel
        return self._stage.lens.lens.directions(pixels, **self._setting())

    def _lens_field(self) -> float:
        """Tangent of the field angle up to which the lens's image map is defined in all directions."""
        azimuth = np.arange(8) * np.pi / 4
        low, high = 0.0, 100.0
        for _ in range(30):
            middle = (low + high) / 2
            rim = np.stack([middle * np.cos(azimuth), middle * np.sin(azimuth), np.ones(8)], -1)
            known = np.isfinite(self._stage.lens.lens.pixels(rim, **self._setting())).all()
            low, high = (middle, high) if known else (low, middle)
        return low * (1 - 1e-6)

    def _lens_pixels(self, points: np.ndarray) -> np.ndarray:
        """Extrapolates linearly beyond the field."""
        if not points.size:
            return np.empty((2, 0))
        x, y, z = points
        with np.errstate(all="ignore"):
            tangent = np.where(z > 0, np.hypot(x, y) / z, np.nan)
        beyond = np.flatnonzero(tangent > self._field)
        rim = points[:, beyond] / z[beyond]
        rim[:2] *= self._field / tangent[beyond]
        seen = np.concatenate([points, rim * [[NEAR_FIELD], [NEAR_FIELD], [1]]], 1)
        seen[:, beyond] = rim
        pixels = self._stage.lens.lens.pixels(seen.T, **self._setting()).T
        pixels, near = pixels[:, : points.shape[1]], pixels[:, points.shape[1] :]
        further = (tangent[beyond] / self._field - 1) / (1 - NEAR_FIELD)
        pixels[:, beyond] += further * (pixels[:, beyond] - near)
        return pixels * self._per_pixel[:, None]


def _focus(dof: bpy.types.CameraDOFSettings, depsgraph: bpy.types.Depsgraph) -> tuple | None:
    on = dof.focus_object
    place = on and tuple(map(tuple, on.evaluated_get(depsgraph).matrix_world))
    return (dof.focus_distance, dof.aperture_fstop, place) if dof.use_dof else None


def transformed(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[4, 4], points [3, ...]"""
    return (matrix[:3, :3] @ points.reshape(3, -1) + matrix[:3, 3:]).reshape(points.shape)
