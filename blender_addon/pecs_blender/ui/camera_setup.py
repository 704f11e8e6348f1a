# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets up the scene's camera as an event camera and restores it; field of view and focus in the viewport."""

from __future__ import annotations

import contextlib
import json
import math

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty, StringProperty
from mathutils import Matrix, Vector

from ..job.resolve import film_width_mm_of
from . import field, frustum, library, settings
from .interface import Edit, props

BEFORE = "pecs_before"  # custom property of the camera with its state before set_up
OF_CAMERA = ("type", "sensor_fit", "sensor_width", "sensor_height", "lens", "shift_x", "shift_y")
OF_DOF = ("use_dof", "focus_distance", "aperture_fstop")
OF_RENDER = ("resolution_x", "resolution_y", "resolution_percentage", "pixel_aspect_x", "pixel_aspect_y")
OF_PECS = ("lens", "chip", "focus_m", "fnumber", "film_width_mm")
NO_CHIP_SIZE = (346, 260)


def _camera(scene):
    """The scene's camera; None if another kind of object has its place."""
    return scene.camera if scene.camera and scene.camera.type == "CAMERA" else None


def _groups(scene, camera) -> dict[str, tuple]:
    return {
        "camera": (camera, OF_CAMERA),
        "dof": (camera.dof, OF_DOF),
        "render": (scene.render, OF_RENDER),
        "pecs": (scene.pecs, OF_PECS),
    }


def snapshot(scene, camera) -> str:
    """Values that set_up changes, as JSON text."""
    groups = _groups(scene, camera).items()
    return json.dumps({group: {name: getattr(owner, name) for name in names} for group, (owner, names) in groups})


def set_up(scene, thing, before: str) -> field.Field | None:
    """Sets the camera object `thing` to chip, lens, f-number and focus of the scene's PECS settings. It gets the field
    of view of the lens or, without a lens, keeps its own. `before`: snapshot for `restore`. Returns the lens's field.
    Raises pecs.PecsError before any change."""
    camera, s, render = thing.data, scene.pecs, scene.render
    chip = library.chip(s.chip)
    width, height = (chip.width, chip.height) if chip.width else NO_CHIP_SIZE
    film_mm = s.film_width_mm or film_width_mm_of(chip, width)
    view = None
    if settings.has_lens(s):
        fnumber = settings.plain(s.fnumber) or None
        focus_m, lens = settings.focus_m(scene), library.version("lens", s.lens)
        view = field.field(field.Setting(*lens, focus_m, fnumber, film_mm, width, height))
    if BEFORE not in camera:
        camera[BEFORE] = before
    across = view.width_per_distance if view else _width_per_distance(scene, camera)

    scene.camera = thing
    settings.set_size(render, width, height)
    settings.set_pinhole(camera, film_mm, film_mm * height / width, film_mm / across)
    if view:
        camera.dof.use_dof, camera.dof.aperture_fstop = True, view.fnumber
        if s.focus_m:
            camera.dof.focus_distance = s.focus_m
    return view


def _width_per_distance(scene, camera) -> float:
    """Width of the camera's field of view per unit of distance."""
    if camera.type != "PERSP":
        return 1.0
    frame = [corner.x / -corner.z for corner in camera.view_frame(scene=scene)]
    return max(frame) - min(frame)


def restore(scene, thing) -> None:
    """Restores the values from before set_up."""
    before = json.loads(thing.data[BEFORE])
    for group, (owner, names) in _groups(scene, thing.data).items():
        for name in names:
            with contextlib.suppress(TypeError):  # the lens file was removed
                setattr(owner, name, before[group][name])
    del thing.data[BEFORE]


def distance_ahead(camera, thing) -> float:
    """Distance from the entrance pupil to the plane through an object's origin, in the scene's units."""
    to = camera.matrix_world.normalized().inverted() @ thing.matrix_world.translation
    return -to.z


def _focus_on_object(self, context) -> None:
    scene, thing = context.scene, self.focus_object
    if thing and scene.camera and (distance := distance_ahead(scene.camera, thing)) > 0:
        scene.pecs.focus_m = distance


class PecsCamera(bpy.types.PropertyGroup):
    show_field: BoolProperty(
        name="Show Field",
        default=True,
        description="Draw the lens's field of view, with distortion, up to the focus plane",
    )
    focus_object: PointerProperty(
        name="Focus On",
        type=bpy.types.Object,
        update=_focus_on_object,
        description="Sets the focus to the plane through the current origin of this object",
    )


class _SetUp(Edit):
    """Operator with its own lens, chip, f-number and focus; unset ones come from the panel."""

    def draw(self, _context) -> None:
        layout = self.layout
        layout.use_property_split = True
        props(layout, self, "lens", "chip", "fnumber", "focus")

    def take_panel(self, scene) -> None:
        """Copies set properties to the panel's settings, and fills the unset ones from there."""
        for mine, name in (("lens", "lens"), ("chip", "chip"), ("fnumber", "fnumber"), ("focus", "focus_m")):
            if self.properties.is_property_set(mine):
                setattr(scene.pecs, name, getattr(self, mine))
            else:
                setattr(self, mine, getattr(scene.pecs, name))

    def set_up(self, context, thing) -> str:
        """Sets the camera object up; returns the message."""
        scene = context.scene
        before = snapshot(scene, thing.data)
        self.take_panel(scene)
        try:
            view = set_up(scene, thing, before)
        except Exception:
            for name, value in json.loads(before)["pecs"].items():
                setattr(scene.pecs, name, value)
            raise
        width, height = scene.render.resolution_x, scene.render.resolution_y
        return f"{thing.name}: {width} x {height} pixels, {view.words() if view else 'no lens'}"


_CHOICES = {
    "lens": StringProperty(name="Lens", search=settings.lenses),
    "chip": StringProperty(name="Chip", search=library.search(lambda: library.names("chip"))),
    "fnumber": FloatProperty(name="f-number", min=0, description="f-number of the lens; 0: wide open"),
    "focus": FloatProperty(
        name="Focus", min=0, subtype="DISTANCE", unit="LENGTH", description="Focus distance; 0: infinity"
    ),
}


class PECS_OT_setup_camera(_SetUp, bpy.types.Operator):
    """Set the scene's camera to the film size, resolution and field of view of the chip and lens"""

    bl_label = "Set Up Event Camera"

    @classmethod
    def why_not(cls, context) -> str:
        text = "The scene has no camera. Add one with Add > Camera > Event Camera"
        return "" if _camera(context.scene) else text

    def act(self, context) -> str:
        return self.set_up(context, context.scene.camera)


class PECS_OT_add_camera(_SetUp, bpy.types.Operator):
    """Add a camera with the film size, resolution and field of view of the chip and lens"""

    bl_label = "Add Event Camera"

    def act(self, context) -> str:
        scene = context.scene
        thing = bpy.data.objects.new("Event Camera", bpy.data.cameras.new("Event Camera"))
        thing.location = scene.cursor.location
        thing.rotation_euler = (math.pi / 2, 0, 0)
        try:
            message = self.set_up(context, thing)
        except Exception:
            bpy.data.cameras.remove(thing.data)
            raise
        context.collection.objects.link(thing)
        for other in context.selected_objects:
            other.select_set(False)
        thing.select_set(True)
        context.view_layer.objects.active = thing
        return message


PECS_OT_setup_camera.__annotations__ = dict(_CHOICES)
PECS_OT_add_camera.__annotations__ = dict(_CHOICES)


class PECS_OT_restore_camera(Edit, bpy.types.Operator):
    """Restore the camera, resolution and lens from before the setup"""

    bl_label = "Restore Camera"

    @classmethod
    def poll(cls, context) -> bool:
        camera = _camera(context.scene)
        return camera is not None and BEFORE in camera.data

    def act(self, context) -> None:
        restore(context.scene, context.scene.camera)


class PECS_GGT_focus(bpy.types.GizmoGroup):
    """An arrow at the focus plane that sets the focus distance."""

    bl_label = "PECS Focus"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT"}

    @classmethod
    def poll(cls, context) -> bool:
        scene = context.scene
        chosen = scene.camera is not None and context.object == scene.camera
        return chosen and settings.has_lens(scene.pecs) and scene.pecs_camera.show_field

    def setup(self, context) -> None:
        self.arrow = self.gizmos.new("GIZMO_GT_arrow_3d")
        self.arrow.target_set_prop("offset", context.scene.pecs, "focus_m")
        self.arrow.color, self.arrow.alpha = (0.337, 0.706, 0.914), 0.8
        self.arrow.color_highlight, self.arrow.alpha_highlight = (1, 1, 1), 1
        self.refresh(context)

    def refresh(self, context) -> None:
        matrix = context.scene.camera.matrix_world.normalized()
        self.arrow.matrix_basis = matrix @ Matrix.Rotation(math.pi, 4, Vector((1, 0, 0)))

    draw_prepare = refresh


_handles: list = []


def _add_menu(self, _context) -> None:
    self.layout.operator("pecs.add_camera", text="Event Camera", icon="OUTLINER_OB_CAMERA")


PROPERTIES = {(bpy.types.Scene, "pecs_camera"): PointerProperty(type=PecsCamera)}
MENUS = {"VIEW3D_MT_camera_add": _add_menu}


def register() -> None:
    if not bpy.app.background:
        _handles.append(bpy.types.SpaceView3D.draw_handler_add(frustum.draw, (), "WINDOW", "POST_VIEW"))


def unregister() -> None:
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    if bpy.app.timers.is_registered(frustum._show):
        bpy.app.timers.unregister(frustum._show)
