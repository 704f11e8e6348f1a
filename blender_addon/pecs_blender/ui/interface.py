# SPDX-License-Identifier: GPL-3.0-or-later
"""Translated texts, labels that wrap (Blender's do not), areas of the windows, and what operators share."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

import bpy

CONTEXT = "PECS"  # translation context of texts that Blender itself has with another meaning
PIXELS_PER_LETTER = 6.0  # mean letter width of Blender's font


def say(text: str, **values) -> str:
    """The translation of a text (languages/*.json) with `values` for its {names}. Blender itself translates labels,
    properties and tooltips."""
    return bpy.app.translations.pgettext_iface(text, CONTEXT).format(**values)


def areas(*kinds: str) -> Iterator[bpy.types.Area]:
    """Areas of these kinds, such as "VIEW_3D", in all windows."""
    for window in bpy.context.window_manager.windows:
        yield from (area for area in window.screen.areas if area.type in kinds)


def redraw(*kinds: str) -> None:
    for area in areas(*kinds):
        area.tag_redraw()


def wrapped(layout, text: str, icon: str = "NONE", alert: bool = False) -> None:
    """Draws a translated text as several labels that fit the width of the panel."""
    region = bpy.context.region
    width_px = (region.width if region else 400) / (bpy.context.preferences.system.ui_scale or 1) - 60
    column = layout.column(align=True)
    column.alert = alert
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, max(20, int(width_px / PIXELS_PER_LETTER)))):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


def props(layout, owner, *names: str) -> None:
    for name in names:
        layout.prop(owner, name)


def progress(layout, job) -> None:
    """Draws a background.BackgroundJob with the button that stops it."""
    row = layout.row(align=True)
    row.progress(factor=job.progress, text=job.text)
    row.operator("pecs.stop", icon="CANCEL", text="")


def problem(layout, one) -> None:
    """Draws a checks.Problem with the button that fixes it."""
    wrapped(layout, one.text, "ERROR" if one.is_error else "INFO", alert=one.is_error)
    if one.fix:
        layout.operator(one.fix)


class Action:
    """An operator `pecs.NAME`, a class PECS_OT_NAME, that does its work in act(context), which may return a message.
    Errors are reported."""

    def __init_subclass__(cls, **more) -> None:
        super().__init_subclass__(**more)
        cls.bl_idname = "pecs." + cls.__name__.removeprefix("PECS_OT_")

    ERRORS: tuple[type[Exception], ...] = (RuntimeError, OSError)  # others are defects

    @classmethod
    def why_not(cls, context) -> str:
        """Why the operator is disabled; empty if it is not."""
        return ""

    @classmethod
    def poll(cls, context) -> bool:
        if text := cls.why_not(context):
            cls.poll_message_set(text)
        return not text

    def execute(self, context):
        try:
            message = self.act(context)
        except self.ERRORS as e:
            self.report({"ERROR"}, str(e))
            return {"CANCELLED"}
        if message:
            self.report({"INFO"}, message)
        return {"FINISHED"}
