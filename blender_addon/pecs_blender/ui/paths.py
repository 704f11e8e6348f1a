# SPDX-License-Identifier: GPL-3.0-or-later
"""Where stacks, events and what is made of them lie; and what shows them outside."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import bpy

from .interface import say
from .preferences import preferences


def _beside(text: str, ending: str) -> Path:
    """The place given, or the preferred folder and the .blend's name."""
    if text:
        return Path(bpy.path.abspath(text))
    return Path(bpy.path.abspath(preferences().output_folder or "//"), (default_name() or "untitled") + ending)


def default_name() -> str:
    return Path(bpy.data.filepath).stem


def stack(scene) -> Path:
    """That the next render writes."""
    return _beside(scene.pecs.output, ".stack")


def rendered(scene) -> Path:
    """That the next simulation reads: what was rendered last, where a new version has another name."""
    last = scene.pecs.last_stack
    return Path(last) if last and Path(last).parent == stack(scene).parent else stack(scene)


def events(scene) -> Path:
    return _beside(scene.pecs.sensor.output, ending(scene.pecs.sensor.format))


def open_outside(path: Path) -> str:
    """A page, a picture or a video, in what the system opens it with; what to say of it."""
    try:
        opened = webbrowser.open(path.as_uri())
    except (OSError, webbrowser.Error):
        opened = False
    return str(path) if opened else say("{path}: nothing here opens it", path=path)


def ending(event_format: str) -> str:
    import pecs

    return next((f["extensions"][0] for f in pecs.event_formats() if f["name"] == event_format), ".raw")
