# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that wrap (Blender's do not), areas of the windows, and what operators share."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from functools import lru_cache

import bpy

PIXELS_PER_LETTER = 6.0  # mean letter width of Blender's font


def areas(*kinds: str) -> Iterator[bpy.types.Area]:
    """Areas of these kinds, such as "VIEW_3D", in all windows."""
    for window in bpy.context.window_manager.windows:
        yield from (area for area in window.screen.areas if area.type in kinds)


def redraw(*kinds: str) -> None:
    for area in areas(*kinds):
        area.tag_redraw()


def redraw_panels() -> None:
    """The properties, the sidebar of the 3-D viewport alone, and the status bar."""
    redraw("PROPERTIES")
    for area in areas("VIEW_3D"):
        next(region for region in area.regions if region.type == "UI").tag_redraw()
    for window in bpy.context.window_manager.windows:
        window.workspace.status_text_set_internal(None)  # the only call that redraws the status bar


def wrapped(layout, text: str, icon: str = "NONE", alert: bool = False) -> None:
    """Draws a text as several labels that fit the width of the panel."""
    region = bpy.context.region
    width_px = (region.width if region else 400) / (bpy.context.preferences.system.ui_scale or 1) - 60
    column = layout.column(align=True)
    column.alert = alert
    column.scale_y = 0.8
    for number, line in enumerate(_lines(text, max(20, int(width_px / PIXELS_PER_LETTER)))):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


_lines = lru_cache(64)(textwrap.wrap)


def duration(seconds: float) -> str:
    return f"{seconds:.4g} s" if seconds >= 1 else f"{seconds * 1e3:.4g} ms"


def props(layout, owner, *names: str) -> None:
    for name in names:
        layout.prop(owner, name)


def labelled(layout, text: str):
    """A row of the panel with a label at the left, as Blender draws properties."""
    split = layout.split(factor=0.4)
    label = split.row()
    label.alignment = "RIGHT"
    label.label(text=text)
    return split.row(align=True)


# Numbers whose 0 stands for a choice of PECS: name of the choice, and the number that replaces it first.
AUTO = {
    "focus_m": ("Infinity", 1.0),
    "fnumber": ("Wide Open", 8.0),
    "film_width_mm": ("Chip Width", 10.0),
    "bands": ("Auto", 3),
    "samples": ("Auto", 32),
    "min_nm": ("Auto", 400.0),
    "max_nm": ("Auto", 700.0),
    "threads": ("Auto", 1),
    "noise_events": ("No Limit", 0.1),
    "window_ms": ("Auto", 1.0),
    "slow_motion": ("Auto", 100.0),
    "compare_ms": ("All", 100.0),
    "erc_mhz": ("No Limit", 10.0),
}


def auto(layout, owner, *names: str) -> None:
    """Draws numbers of AUTO: a button with the name of the choice, or the number with an X that returns to it."""
    for name in names:
        if getattr(owner, name):
            row = layout.row(align=True)
            row.prop(owner, name)
            button = row.operator("pecs.auto", text="", icon="X")
        else:
            button = labelled(layout, owner.bl_rna.properties[name].name).operator("pecs.auto", text=AUTO[name][0])
        button.owner, button.name = owner.path_from_id(), name


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
        redraw_panels()  # also the one in which the button was not pressed
        if message:
            self.report({"INFO"}, message)
        return {"FINISHED"}


class Edit(Action):
    """An Action that Blender can undo. `setting`: an attribute of the PECS settings, and the value that it gets."""

    bl_options = {"REGISTER", "UNDO"}
    setting: tuple = ()

    def act(self, context) -> str | None:
        setattr(context.scene.pecs, *self.setting)
