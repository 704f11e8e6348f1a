# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of stacks and events, and opening files outside Blender."""

from __future__ import annotations

import secrets
import tempfile
import webbrowser
from functools import cache
from pathlib import Path

import bpy
import pecs

from .preferences import preferences


class _State:
    unsaved: Path | None = None


state = _State()


def _unsaved() -> str:
    """Folder of the outputs of a file that was never saved: none of another file, session or user. A job makes it."""
    state.unsaved = state.unsaved or Path(tempfile.gettempdir(), f"pecs_{secrets.token_hex(4)}")
    return str(state.unsaved)


def _path(text: str, extension: str) -> Path:
    """The path set in the panel, or one in NAME_events in the preferred folder, of NAME.blend."""
    start = None if bpy.data.filepath else _unsaved()
    if text:
        return Path(bpy.path.abspath(text, start=start))
    name = Path(bpy.data.filepath).stem or "untitled"
    return Path(bpy.path.abspath(preferences().output_folder or "//", start=start), f"{name}_events", name + extension)


def stack(scene) -> Path:
    """Stack of the next render."""
    return _path(scene.pecs.output, ".stack")


def rendered(scene) -> Path:
    """Stack that the next simulation reads: the last new version, if one was rendered."""
    last = scene.pecs.last_stack
    return Path(last) if last and Path(last).parent == stack(scene).parent else stack(scene)


def events(scene) -> Path:
    return _path(scene.pecs.sensor.output, extension(scene.pecs.sensor.format))


def open_outside(path: Path) -> str:
    """Opens a file in the system's program; the message about it."""
    try:
        opened = webbrowser.open(path.as_uri())
    except (OSError, webbrowser.Error):
        opened = False
    return str(path) if opened else f"{path}: the system has no program to open it"


@cache
def extension(event_format: str) -> str:
    return next((f["extensions"][0] for f in pecs.event_formats() if f["name"] == event_format), ".raw")


@bpy.app.handlers.persistent
def on_load(*_) -> None:
    """Runs when another file is opened."""
    state.unsaved = None
