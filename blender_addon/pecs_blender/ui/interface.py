# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts in the language of Blender's interface, and labels that wrap, which Blender's do not."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

import bpy

CONTEXT = "PECS"  # of the texts of languages/*.json that Blender has, too, and means otherwise
PIXELS_PER_LETTER = 6.0  # of Blender's own font, about


def say(text: str, **values) -> str:
    """A text of languages/*.json; {names} in it are `values`. Blender itself translates what has none of them: labels,
    properties, tooltips."""
    return bpy.app.translations.pgettext_iface(text, CONTEXT).format(**values)


def areas(*kinds: str) -> Iterator[bpy.types.Area]:
    """Areas of these kinds, such as "VIEW_3D", in all windows."""
    for window in bpy.context.window_manager.windows:
        yield from (area for area in window.screen.areas if area.type in kinds)


def redraw(*kinds: str) -> None:
    for area in areas(*kinds):
        area.tag_redraw()


def wrapped(layout, text: str, icon: str = "NONE", alert: bool = False) -> None:
    """As many labels as the panel's width asks for, of a text that is translated already."""
    region = bpy.context.region
    width_px = (region.width if region else 400) / (bpy.context.preferences.system.ui_scale or 1) - 60
    column = layout.column(align=True)
    column.alert = alert
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, max(20, int(width_px / PIXELS_PER_LETTER)))):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


def problem(layout, one) -> None:
    """A checks.Problem with its button."""
    wrapped(layout, one.text, "ERROR" if one.is_error else "INFO", alert=one.is_error)
    if one.mend:
        layout.operator(one.mend)
