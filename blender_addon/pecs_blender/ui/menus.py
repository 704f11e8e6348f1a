# SPDX-License-Identifier: GPL-3.0-or-later
"""Where else the buttons are: the Render menu, and so F3; the progress in the status bar, and Esc; the manual."""

from __future__ import annotations

import bpy

from . import background, event_operators, manual
from .words import say


class PECS_MT_render(bpy.types.Menu):
    bl_label = "PECS: event camera"

    def draw(self, context) -> None:
        layout = self.layout
        for name in ("run", "render", "sense"):
            layout.operator(f"pecs.{name}")
        layout.separator()
        for name in ("check_scene", "probe_light", "plan", "preview", "stop"):
            layout.operator(f"pecs.{name}")
        layout.separator()
        for kind, (label, _) in event_operators.KINDS.items():
            layout.operator("pecs.view", text=say("View events: {kind}", kind=say(label))).kind = kind
        for name in ("reconstruct", "report", "compare", "open_folder"):
            layout.operator(f"pecs.{name}")
        layout.separator()
        for name in ("chip_resolution", "pick_lens", "wide_open", "match_lens", "draw_lens", "override_add"):
            layout.operator(f"pecs.{name}")
        layout.separator()
        layout.operator("pecs.manual", icon="HELP")


def _in_render_menu(self, _context) -> None:
    self.layout.separator()
    self.layout.menu("PECS_MT_render")


def _in_status_bar(self, _context) -> None:
    if job := background.state.job:
        row = self.layout.row(align=True)
        row.ui_units_x = 16  # wide enough for its words
        row.progress(factor=job.progress, text=job.text)
        row.operator("pecs.stop", icon="CANCEL", text="")


CLASSES = (PECS_MT_render,)


_keys: list[tuple] = []  # of ours


def register() -> None:
    if ours := bpy.context.window_manager.keyconfigs.addon:
        properties = ours.keymaps.new("Property Editor", space_type="PROPERTIES")
        _keys.append((properties, properties.keymap_items.new("pecs.stop", "ESC", "PRESS")))
    bpy.types.TOPBAR_MT_render.append(_in_render_menu)
    bpy.types.STATUSBAR_HT_header.append(_in_status_bar)
    bpy.utils.register_manual_map(manual.pages)


def unregister() -> None:
    for keymap, item in _keys:
        keymap.keymap_items.remove(item)
    _keys.clear()
    bpy.utils.unregister_manual_map(manual.pages)
    bpy.types.STATUSBAR_HT_header.remove(_in_status_bar)
    bpy.types.TOPBAR_MT_render.remove(_in_render_menu)
