# SPDX-License-Identifier: GPL-3.0-or-later
"""Background jobs: a child process that renders the saved file or runs the program. A timer polls it, not a modal
operator, so that it continues when another file is opened."""

from __future__ import annotations

import ctypes
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy

from .interface import redraw, say

POLL_S, STATUS_S = 0.2, 1.0  # interval of polls, and of redraws of the status bar
STOPPED = (130, 143, -15, -9)  # docs/reference/exit_codes.md; by signal before its handler is installed
PHASES = {"render": "Render", "sense": "Simulate", "reconstruct": "Video"}  # by what a program calls its work
READ_S = 2.0  # timeout for the remaining output of a process that has ended
MAX_LINES = 10_000  # kept of standard output
PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def _die_with_us() -> None:
    """Nobody would stop a job whose Blender was killed (Linux, prctl(2)); exec keeps it."""
    if hasattr(_libc, "prctl"):
        _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def clock(seconds: float) -> str:
    minutes, s = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{s:02}" if hours else f"{minutes}:{s:02}"


@dataclass
class BackgroundJob:
    """label: name in the panel. done: makes the message of success. for_file: the result belongs to the open file, so
    that opening another one stops the job. continues: a stopped job resumes when it is run again."""

    label: str
    command: list[str]
    output: Path
    done: Callable[[BackgroundJob], str]
    for_file: bool = False
    continues: bool = False

    def __post_init__(self):
        self.last_line, self.progress, self.answer, self.folder = "", 0.0, [], self.output
        self._said, self._phase, self._left_s, self._left_at, self._stopping = "", "", None, 0.0, False
        self._start = time.monotonic()
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        self._process = subprocess.Popen(
            self.command,
            **pipes,
            text=True,
            errors="replace",
            preexec_fn=_die_with_us if sys.platform == "linux" else None,
        )
        readers = ((self._read, self._process.stderr), (self._read_answer, self._process.stdout))
        self._readers = [threading.Thread(target=read, args=(stream,), daemon=True) for read, stream in readers]
        for reader in self._readers:
            reader.start()

    def _read(self, stream) -> None:
        for line in stream:
            if found := re.match(r"pecs\w*: (.*)", line):  # what Blender says at its end does not count
                self._said, line = found[1], ""
            self.last_line = self._said or line.strip() or self.last_line
            if found := re.match(r"([\w-]+): (\d+)(?:/| of )(\d+)(?:, (\d+) s left)?", line):
                self._phase, self.progress = found[1], int(found[2]) / max(1, int(found[3]))
                self._left_s, self._left_at = found[4] and float(found[4]), time.monotonic()
            elif found := re.match(r"render: into (.*)", line):
                self.folder = Path(found[1])

    def _read_answer(self, stream) -> None:
        for line in stream:
            if len(self.answer) < MAX_LINES:
                self.answer.append(line.rstrip())

    @property
    def text(self) -> str:
        """Progress, such as "Render 25%, 0:12 left, 0:04 so far"."""
        now = time.monotonic()
        if self._stopping:
            return say("{job}: stopping", job=say(self.label))
        begun = f"{say(PHASES.get(self._phase, self.label))} {self.progress:.0%}"
        parts = [begun if self._phase else say("{job}: starting", job=say(self.label))]
        if self._left_s is not None and self.progress < 1:
            parts.append(say("{time} left", time=clock(self._left_s - (now - self._left_at))))
        return ", ".join([*parts, say("{time} so far", time=clock(now - self._start))])

    def returncode(self) -> int | None:
        """Exit code; None while the process runs."""
        code = self._process.poll()
        if code is not None:
            for reader in self._readers:
                reader.join(READ_S)
        return code

    def stop(self) -> None:
        """Terminates the process; the second call kills it."""
        (self._process.kill if self._stopping else self._process.terminate)()
        self._stopping = True


class _State:
    job: BackgroundJob | None = None
    message, is_error = "", False  # result of the last job
    status_at = 0.0  # time of the last redraw of the status bar
    scores: tuple[str, list[tuple[str, str]]] = "", []  # last comparison: title; rows of label and value


state = _State()


def start(job: BackgroundJob) -> None:
    state.job, state.message = job, ""
    bpy.app.timers.register(poll, first_interval=POLL_S, persistent=True)


def poll() -> float | None:
    """Seconds until the next poll; None if no job runs."""
    job = state.job
    if not job:
        return None
    code = job.returncode()
    _redraw(code is not None)
    if code is None:
        return POLL_S
    state.job, state.is_error = None, code != 0 and code not in STOPPED
    try:
        state.message = _ending(job, code)
    except Exception as e:  # the result cannot be shown; the panel must accept the next job
        state.message, state.is_error = f"{say(job.label)}: {e}", True
    if state.is_error:
        _pop_up(state.message)
    return None


def _ending(job: BackgroundJob, code: int) -> str:
    if code == 0:
        return job.done(job)
    if code in STOPPED:
        text = "Stopped at {share:.0%}. Press {job} to resume" if job.continues else "Stopped at {share:.0%}"
        return say(text, share=job.progress, job=say(job.label))
    line = job.last_line.partition("; --")[0]  # without the hint of command-line options
    return line or say("{job} ended with code {code}", job=say(job.label), code=code)


@bpy.app.handlers.persistent
def stop_preview(*_) -> None:
    """Stops a job for the open file (a preview, say) when another file is opened; other jobs continue."""
    if state.job and state.job.for_file:
        state.job.stop()


def _redraw(at_once: bool) -> None:
    redraw("PROPERTIES")
    # Not at every poll, since it hides the hints of the active tool.
    if at_once or time.monotonic() - state.status_at >= STATUS_S:
        state.status_at = time.monotonic()
        for window in bpy.context.window_manager.windows:
            window.workspace.status_text_set_internal(None)  # the only call that redraws the status bar


def _pop_up(text: str) -> None:
    if not bpy.app.background:
        bpy.context.window_manager.popup_menu(lambda menu, _: menu.layout.label(text=text), title="PECS", icon="ERROR")


def register() -> None:
    bpy.app.handlers.load_pre.append(stop_preview)


def unregister() -> None:
    if state.job:  # includes Blender's exit
        state.job.stop()
    if bpy.app.timers.is_registered(poll):
        bpy.app.timers.unregister(poll)
    bpy.app.handlers.load_pre.remove(stop_preview)
    state.job, state.message, state.scores = None, "", ("", [])
