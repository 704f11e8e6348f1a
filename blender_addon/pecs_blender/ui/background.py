# SPDX-License-Identifier: GPL-3.0-or-later
"""A render in a process of its own, on the file as saved. A timer looks after it, not a modal operator: it goes on when
another file is opened."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import bpy

from . import settings

POLL_S = 0.2
PREVIEW_STACK = "preview_stack"  # the folder's name
STOPPED = (130, 143, -15)  # docs/reference/exit_codes.md; by signal, before it was ready for one


class Job:
    """`pecs render`; its last line and how far it is (0 ... 1). done: what to say when it has ended well."""

    def __init__(self, scene, output: Path, extra: list[str], done: Callable[[Job], str]):
        command = [sys.executable, "-m", "pecs_blender", "render", bpy.data.filepath]  # the wheel has no program
        if bpy.app.binary_path:
            command = [bpy.app.binary_path, "--background", bpy.data.filepath, "--command", "pecs", "render"]
        command += ["-o", str(output), *settings.arguments(scene), *extra]
        self.output, self.last_line, self.progress, self.done = output, "", 0.0, done
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stderr:
            self.last_line = line.strip() or self.last_line
            if found := re.match(r"render: (\d+)(?:/| of )(\d+)", line):
                self.progress = int(found[1]) / int(found[2])

    def returncode(self) -> int | None:
        """None while it runs."""
        code = self._process.poll()
        if code is not None:
            self._reader.join()
        return code

    def stop(self) -> None:
        self._process.terminate()


class _State:
    job: Job | None = None
    message, is_error = "", False  # how the last one ended


state = _State()


def start(job: Job) -> None:
    state.job, state.message = job, ""
    bpy.app.timers.register(poll, first_interval=POLL_S, persistent=True)


def poll() -> float | None:
    """Seconds to the next look; None when nothing runs."""
    job = state.job
    if not job:
        return None
    _redraw()
    code = job.returncode()
    if code is None:
        return POLL_S
    state.job, state.is_error = None, code != 0 and code not in STOPPED
    if code == 0:
        state.message = job.done(job)
    elif code in STOPPED:
        state.message = f"Stopped at {job.progress:.0%}; Render stack continues"
    else:
        state.message = job.last_line or f"Blender ended with code {code}"
        _pop_up(state.message)
    return None


@bpy.app.handlers.persistent
def stop_preview(*_) -> None:
    """Another file is opened: a preview belongs to the one that goes, a stack to nobody."""
    if state.job and state.job.output.name == PREVIEW_STACK:
        state.job.stop()


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "PROPERTIES":
                area.tag_redraw()


def _pop_up(text: str) -> None:
    if not bpy.app.background:
        bpy.context.window_manager.popup_menu(lambda menu, _: menu.layout.label(text=text), title="PECS", icon="ERROR")
