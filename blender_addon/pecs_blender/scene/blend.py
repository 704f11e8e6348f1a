# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend file as a source of renders: opened and checked, never written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from pecs._errors import ExitCode, PecsError, PecsInputError, PecsNotFoundError, bad_input
from pecs._platform import link_folder

from ..spectral.spectra import Spectrum
from ..spectral.spectral_scene import curves
from . import content, cycles
from .outside_files import missing_files, things, unreadable_pictures
from .source import Source

MOST_NAMES = 5  # in a note
LEAST_SHEAR = 1e-3  # cosine between axes
MOST_APART = 0.25  # of the steps of time: Blender's own
ORIGINAL = "pecs_original.txt"  # in a temporary copy's folder: the original's folder


class BlendScene(Source):
    def __init__(
        self, path: Path, scene_name: str | None, illuminant: Spectrum, allow_scripts: bool, camera: str | None = None
    ):
        """camera: renders instead of the scene's own, also after markers."""
        if not path.is_file():
            raise PecsNotFoundError(f"{path}: no such file")
        try:
            with cycles.quiet(2):
                bpy.ops.wm.open_mainfile(filepath=str(path.absolute()), load_ui=False, use_scripts=allow_scripts)
        except RuntimeError as e:
            raise PecsInputError(f"{path}: {' '.join(str(e).split())}") from None
        if scene_name and scene_name not in bpy.data.scenes:
            names = ", ".join(s.name for s in bpy.data.scenes)
            raise bad_input(path, "--scene-name", repr(scene_name), f"one of {names}")
        self.scene = bpy.data.scenes[scene_name] if scene_name else bpy.context.scene
        if bpy.context.window:
            bpy.context.window.scene = self.scene
        original = path.absolute().with_name(ORIGINAL)
        self.folder = Path(os.fsdecode(original.read_bytes())) if original.is_file() else original.parent
        check(path, self.scene, allow_scripts)
        if camera:
            self.scene.camera = _camera(path, self.scene, camera)
            self.scene.timeline_markers.clear()
        if not self.scene.camera:
            raise bad_input(path, f"scene {self.scene.name!r}", "no camera", "an active camera")
        if self.scene.frame_end < self.scene.frame_start:
            raise bad_input(path, f"scene {self.scene.name!r}", "zero frames", "an end after the start")
        layers = self.scene.view_layers
        layers.move(next((i for i, layer in enumerate(layers) if layer.use), 0), 0)  # the first that renders
        _show_in_viewports()
        _hold_settings(self.scene)
        render = self.scene.render
        self.size = tuple(n * render.resolution_percentage // 100 for n in (render.resolution_x, render.resolution_y))
        self._fps = render.fps / render.fps_base
        self.duration_s = (self.scene.frame_end - self.scene.frame_start + 1) / self._fps
        self.unit_m = self.scene.unit_settings.scale_length
        self.lens = {"lens": "none", "stop_diameter_mm": None, "focus_m": None}
        self.bounces = {key: getattr(self.scene.cycles, key) for key in cycles.BOUNCES}
        self.record = {
            "name": path.stem,
            "scene": self.scene.name,
            "content_sha256": content.digest(self.scene),
            "illuminant": illuminant.name,
        }
        _simulate(self.scene)
        self._illuminant, self.own_camera = illuminant, self.scene.camera
        self._cuts = _cuts(self.scene)
        fstop = self.camera_at(0.0).data.dof.aperture_fstop  # content.digest has moved the scene there
        self.fnumber = float(f"{fstop:.6g}") if 0.1 <= fstop <= 1e4 else None
        self.notes = tuple(notes(self.scene))
        self.scene.timeline_markers.clear()  # Blender would replace a lens camera by a marker's camera at every render
        for layer in self.scene.view_layers:
            layer.use = layer == self.scene.view_layers[0]

    def _frame(self, t_s: float) -> float:
        """t = 0 is the scene's first frame."""
        return round(self.scene.frame_start + t_s * self._fps, 6)

    def check_times(self, times_ns: list[int]) -> None:
        """Blender's frames have 32 bits: late ones are far apart."""
        speed = self.scene.render.frame_map_old / self.scene.render.frame_map_new
        frame = np.float32(self._frame(times_ns[-1] * 1e-9) * speed)
        apart_s, least_s = np.spacing(frame) / (speed * self._fps), np.diff(times_ns).min(initial=10**18) * 1e-9
        if apart_s > MOST_APART * least_s:
            got = f"times {apart_s * 1e6:.3g} us apart near frame {frame:.0f}"
            wanted = f"at most {MOST_APART * least_s * 1e6:.3g} us at this --fps: an animation at earlier frames"
            raise bad_input(f"{self.record['name']}.blend", "frames", got, wanted)

    def camera_at(self, t_s: float) -> bpy.types.Object:
        """The last marker's camera, of several at one frame the first one's; before the first marker, its camera. As
        Blender does, in remapped time."""
        render, frame = self.scene.render, self._frame(t_s)
        frame = round(frame * render.frame_map_old / render.frame_map_new, 6)
        passed = [cut for cut in self._cuts if cut[0] <= frame] or self._cuts[:1]
        return max(passed, key=lambda cut: cut[0])[1] if passed else self.own_camera

    def set_time(self, t_s: float) -> None:
        frame = self._frame(t_s)
        self.scene.camera = self.own_camera = self.camera_at(t_s)
        if self.path:
            self.own_camera.matrix_world = self.on_path(t_s)
        if self.placed:
            self.placed.pose(t_s)
        self.scene.frame_set(int(frame // 1), subframe=frame % 1)
        self.own_camera = self.scene.camera  # scripts may switch it

    def follow(self, path) -> None:
        super().follow(path)
        for camera in {self.own_camera, *(camera for _, camera in self._cuts)}:  # nothing else may move them
            camera.animation_data_clear()
            camera.constraints.clear()
            camera.parent = None

    def make_camera(self, focal_mm: float, film_width_mm: float) -> None:
        pass  # the file's own, unchanged, with its depth of field

    def place(self, cameras) -> None:
        world = self.own_camera.matrix_world
        axes = np.array(world)[:3, :3] / np.linalg.norm(np.array(world)[:3, :3], axis=0)
        is_mirrored = np.linalg.det(axes) < 0
        if is_mirrored or np.abs(axes.T @ axes - np.eye(3)).max() > LEAST_SHEAR:
            got = "a negative scale, which mirrors it" if is_mirrored else "shear by its parents' scale"
            raise bad_input(f"{self.record['name']}.blend", f"camera {self.own_camera.name!r}", got, "none with a lens")
        location, rotation, _ = world.decompose()
        for camera in cameras:
            camera.rotation_mode = "QUATERNION"
            camera.location, camera.rotation_quaternion = location, rotation

    def radiance_per_unit(self, spectral) -> float:
        """Blender's watts are radiant watts of the illuminant: radiance 1 is 1 W m^-2 sr^-1 over the illuminant's
        table."""
        return self._illuminant.luminous() / self._illuminant.power()


def _show_in_viewports() -> None:
    """Lamps and materials that are hidden, at some time or always, would keep the values of the file there."""
    for action in bpy.data.actions:
        for strip in (strip for layer in action.layers for strip in layer.strips):
            for curve in (curve for bag in strip.channelbags for curve in bag.fcurves):
                curve.mute |= curve.data_path == "hide_viewport"
    for one in (*bpy.data.objects, *bpy.data.collections):
        animation = getattr(one, "animation_data", None)  # collections have none
        for driver in animation.drivers if animation else ():
            driver.mute |= driver.data_path == "hide_viewport"
        one.hide_viewport = False


def _is_unbaked(thing: bpy.types.bpy_struct) -> bool:
    """Whether it is a cache of physics, or a domain of fluids, that is not baked."""
    if isinstance(thing, bpy.types.FluidModifier):
        return bool(thing.domain_settings) and not thing.domain_settings.has_cache_baked_any
    return isinstance(thing, bpy.types.PointCache) and not thing.is_baked


def _simulate(scene: bpy.types.Scene) -> None:
    """Bakes physics, and plays simulation nodes, in memory: Blender computes them frame by frame from the first one on,
    and neither adaptive steps nor shards go through the frames so."""
    with cycles.quiet(), bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
        if any(_is_unbaked(one) for one in things(scene)):
            bpy.ops.ptcache.bake_all(bake=True)
    nodes = (node.bl_idname for group in bpy.data.node_groups for node in group.nodes)
    if "GeometryNodeSimulationInput" in nodes:
        for frame in range(scene.frame_start, scene.frame_end + 2):
            scene.frame_set(frame)
    scene.frame_set(scene.frame_start)


def _hold_settings(scene: bpy.types.Scene) -> None:
    """Animation of what PECS sets (in many files a driver gives each frame another seed), and caches that Cycles reads
    itself, once for all frames."""
    for cache in bpy.data.cache_files:
        if hasattr(cache, "use_render_procedural"):  # before Blender 5
            cache.use_render_procedural = False
    for curve in curves(scene):
        curve.mute |= curve.data_path.startswith(("cycles.", "eevee.", "render.", "view_layers["))


def _camera(path: Path, scene: bpy.types.Scene, name: str) -> bpy.types.Object:
    cameras = {thing.name: thing for thing in scene.objects if thing.type == "CAMERA"}
    if name not in cameras:
        raise bad_input(path, "--camera", repr(name), f"one of {_list(sorted(cameras))}" if cameras else "no camera")
    return cameras[name]


def save_copy(folder: Path) -> Path:
    """Saves the open file, as it is in memory, into an empty folder. BlendScene takes files with relative paths from
    the original's folder, which a file there names: a property of the scene could be set by any .blend."""
    here = Path(bpy.data.filepath or "untitled.blend")
    copy = folder / here.name
    if bpy.data.filepath:
        caches = f"blendcache_{here.stem}"  # physics baked to the disk
        if here.with_name(caches).is_dir():
            link_folder(copy.with_name(caches), here.with_name(caches))
        copy.with_name(ORIGINAL).write_bytes(os.fsencode(here.parent.resolve()))
    bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True, relative_remap=True)
    return copy


def check(path: Path, scene: bpy.types.Scene, allow_scripts: bool) -> None:
    """Raises PecsError for scripts that must not run, files that are missing and physics whose cache only Blender may
    write. path: of the file that was read."""
    for driver in () if allow_scripts else python_drivers():
        raise PecsError(f"{path}: {driver}; --allow-scripts runs it", ExitCode.UNSUPPORTED)
    for missing in missing_files(scene):
        raise PecsNotFoundError(f"{path}: {missing}")
    for unreadable in unreadable_pictures():
        raise PecsInputError(f"{path}: {unreadable}")
    for one in things(scene):
        if _is_unbaked(one) and getattr(one, "use_disk_cache", True):
            got = "physics with a disk cache that is not baked"
            raise bad_input(path, repr(one.id_data.name), got, "baked physics")


def notes(scene: bpy.types.Scene) -> Iterator[str]:
    """On what a render leaves out of the scene."""
    first, *others = scene.view_layers
    elsewhere = {thing.name for layer in others if layer.use for thing in layer.objects} - {*first.objects.keys()}
    if elsewhere:
        yield f"only view layer {first.name!r} is rendered, without {_list(sorted(elsewhere))} of other view layers"
    if scene.render.pixel_aspect_x != scene.render.pixel_aspect_y:
        aspect = f"{scene.render.pixel_aspect_x:g}:{scene.render.pixel_aspect_y:g}"
        yield f"pixels are square; the file's pixel aspect of {aspect} is ignored"
    drawn = [thing.name for thing in first.objects if thing.type == "GREASEPENCIL" and not thing.hide_render]
    if drawn:
        yield f"grease pencil is not rendered: {_list(drawn)}"
    if scene.render.use_multiview:
        yield "stereo is ignored: one view is rendered"
    if scene.render.use_border:
        yield "the whole picture is rendered; the file's render region is ignored"
    if (exposure := scene.cycles.film_exposure) != 1:
        yield f"the file's film exposure is ignored; --light-scale {exposure:g} has its effect"
    stops = {round(camera.data.dof.aperture_fstop, 4) for _, camera in _cuts(scene)}
    if len(stops) > 1:
        named = ", ".join(f"f/{stop:g}" for stop in sorted(stops))
        yield f"the markers' cameras have {named}; the stack has one f-number: the first frame's, or --fnumber"


def _list(names: list[str]) -> str:
    return ", ".join(map(repr, names[:MOST_NAMES])) + (
        f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    )


def _cuts(scene: bpy.types.Scene) -> list[tuple[int, bpy.types.Object]]:
    """Frames of the markers that switch the camera, in their order."""
    cuts = [(m.frame, m.camera) for m in scene.timeline_markers if m.camera and not m.camera.hide_render]
    return sorted(cuts, key=lambda cut: cut[0])


def python_drivers() -> Iterator[str]:
    """Drivers beyond Blender's simple expressions."""
    for block in _all_ids():
        for holder in (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None)):
            for curve in getattr(getattr(holder, "animation_data", None), "drivers", ()):
                driver = curve.driver
                if driver.type == "SCRIPTED" and not driver.is_simple_expression:
                    yield f"{block.name}: {curve.data_path}: Python driver {driver.expression!r}"


def _all_ids():
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION":
            for block in getattr(bpy.data, prop.identifier):
                if isinstance(block, bpy.types.ID):
                    yield block
