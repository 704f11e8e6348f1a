# SPDX-License-Identifier: GPL-3.0-or-later
"""The Render menu (which F3 searches), progress in the status bar, Esc, and the manual page of this version, for
the operator and for Blender's *Online Manual*."""

from __future__ import annotations

import textwrap
from pathlib import Path

import bpy

from . import background, event_operators, library, paths, settings
from .interface import Action, progress

_PAGES = {"panel": "start/panel.md", "fit_camera": "howto/fit_camera.md"}  # in the zip as manual/NAME.html

_GROUPS = (  # operators in the Render menu
    "run run_cameras render sense",
    "check_scene probe_light plan preview stop",
    "view show_events reconstruct report compare open_folder",
    "chip_resolution pick_chip pick_lens wide_open match_lens draw_lens override_add",
)


def _page(name: str = "panel") -> Path:
    in_zip, in_checkout = Path(__file__).parents[1] / f"manual/{name}.html", Path(__file__).parents[3] / "docs"
    return in_zip if in_zip.is_file() else in_checkout / _PAGES[name]


def _manual_pages() -> tuple[str, tuple[tuple[str, str], ...]]:
    """For bpy.utils.register_manual_map."""
    ours = ("bpy.ops.pecs.*", "bpy.types.pecs*", "bpy.types.scene.pecs*")
    return _page().as_uri(), tuple((pattern, "") for pattern in ours)


class PECS_OT_manual(Action, bpy.types.Operator):
    """Open the manual in the browser"""

    bl_label = "Manual"

    def act(self, _context) -> str:
        return paths.open_outside(_page())


class PECS_OT_fit_camera(Action, bpy.types.Operator):
    """Open the page that fits a chip profile to recordings of your camera. Profiles in the folder Own Chips of the
    preferences are listed here"""

    bl_label = "Fit My Camera"

    def act(self, _context) -> str:
        return paths.open_outside(_page("fit_camera"))


def _choices(layout, kind: str) -> None:
    """Chips or lenses, by the names that their makers gave them."""
    named = {library.title(kind, name): name for name, _ in library.names(kind)}
    every = [("The scene's camera", library.SCENES_CAMERA)] if kind == "lens" else []
    for title, name in [*every, *sorted(named.items())]:
        item = layout.operator("wm.context_set_string", text=title, translate=False)
        item.data_path, item.value = f"scene.pecs.{kind}", name
    layout.separator()
    layout.operator(f"pecs.pick_{kind}", icon="FILEBROWSER")


class PECS_MT_chip(bpy.types.Menu):
    bl_label = "Chip"
    bl_description = "Sensor chip: pixels, spectral response, thresholds and noise"

    def draw(self, _context) -> None:
        _choices(self.layout, "chip")
        self.layout.operator("pecs.fit_camera", icon="HELP")


class PECS_MT_lens(bpy.types.Menu):
    bl_label = "Lens"
    bl_description = "Lens through which Cycles renders, or the scene's camera"

    def draw(self, _context) -> None:
        _choices(self.layout, "lens")


class PECS_MT_preset(bpy.types.Menu):
    """Settings of other simulators, as papers and repositories give them."""

    bl_label = "Published Setting"

    def draw(self, _context) -> None:
        layout = self.layout
        layout.operator("pecs.use_preset", text="The chip's values", translate=False).name = ""
        for name, preset in sorted(settings.published().items()):
            layout.operator("pecs.use_preset", text=f"{name}: {preset['description']}", translate=False).name = name


class PECS_MT_render(bpy.types.Menu):
    bl_label = "PECS: Event Camera"

    def draw(self, context) -> None:
        layout = self.layout
        for group in _GROUPS:
            for name in group.split():
                if name == "view":
                    for kind, (label, _) in event_operators.KINDS.items():
                        layout.operator("pecs.view", text=f"View Events: {label}").kind = kind
                else:
                    layout.operator(f"pecs.{name}")
            layout.separator()
        layout.operator("pecs.manual", icon="HELP")


def _in_render_menu(self, _context) -> None:
    self.layout.separator()
    self.layout.menu("PECS_MT_render")


def _in_status_bar(self, _context) -> None:
    if job := background.state.job:
        row = self.layout.row()
        row.ui_units_x = 16  # fits the text
        progress(row, job)
    elif text := background.state.message:
        icon = "ERROR" if background.state.is_error else "INFO"
        self.layout.label(text=textwrap.shorten(text, 80, placeholder="…"), icon=icon)


MENUS = {"TOPBAR_MT_render": _in_render_menu, "STATUSBAR_HT_header": _in_status_bar}
_keys: list[tuple] = []  # keymap and item


def register() -> None:
    if ours := bpy.context.window_manager.keyconfigs.addon:
        properties = ours.keymaps.new("Property Editor", space_type="PROPERTIES")
        _keys.append((properties, properties.keymap_items.new("pecs.stop", "ESC", "PRESS")))
        screen = ours.keymaps.new("Screen")  # beside F12 and Ctrl F12, Blender's own renders
        _keys.append((screen, screen.keymap_items.new("pecs.run", "F12", "PRESS", ctrl=True, shift=True)))
    bpy.utils.register_manual_map(_manual_pages)


def unregister() -> None:
    for keymap, item in _keys:
        keymap.keymap_items.remove(item)
    _keys.clear()
    bpy.utils.unregister_manual_map(_manual_pages)
