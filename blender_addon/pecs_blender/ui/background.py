# SPDX-License-Identifier: GPL-3.0-or-later
"""Background jobs: a child process that renders a copy of the file or runs the program. A timer polls it, not a modal
operator, so that it continues when another file is opened.

To add a button with progress: a class in event_operators.py (or operators.py, for renders) whose job(context) returns a
BackgroundJob, and a line in panel.py; describe it in docs/start/panel.md. Progress comes from the command's JSON lines.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
from pecs._errors import ExitCode
from pecs._platform import KILLED, die_with_parent, end_of
from pecs._progress import status_of

from ..spectral.spectra import OCIO
from . import disk
from .interface import redraw_panels, wrapped

POLL_S = 0.2  # interval of polls
STOPPED = (ExitCode.INTERRUPTED, ExitCode.TERMINATED, *KILLED)  # KILLED before its handler is installed
COPIES = "pecs_copy_"  # prefix of the folders of copies that jobs render
READ_S = 2.0  # timeout for the remaining output of a process that has ended
MAX_LINES = 10_000  # kept of standard output
PROGRAMS = ("pecs", "pecs_blender")  # how a line with an error begins


def clock(seconds: float) -> str:
    minutes, s = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{s:02}" if hours else f"{minutes}:{s:02}"


@dataclass
class BackgroundJob:
    """label: name in the panel. done: makes the message of success. for_file: the result belongs to the open file, so
    that opening another one stops the job. continues: a stopped job resumes when it is run again. tasks: labels of the
    tasks in its JSON progress lines (docs/reference/exit_codes.md) that differ from the job's label; that of "" is the
    text before the first line. render_s: time of all images by the plan; None: not planned."""

    label: str
    command: list[str]
    output: Path
    done: Callable[[BackgroundJob], str]
    for_file: bool = False
    continues: bool = False
    tasks: dict[str, str] = field(default_factory=dict)
    render_s: float | None = None

    def __post_init__(self):
        self.last_line, self.answer, self.folder = "", [], self.output
        self.plan: dict[str, float] = {}
        self._error, self._task, self._done, self._total = "", "", 0, 1
        self._left_s, self._left_at, self._stopping = None, 0.0, False
        self._start = time.monotonic()
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        environment = {k: v for k, v in os.environ.items() if k not in OCIO} | {"PECS_PROGRESS": "json"}
        command = die_with_parent(self.command)  # no job survives its Blender
        self._process = subprocess.Popen(command, env=environment, text=True, errors="replace", **pipes)
        readers = ((self._read, self._process.stderr), (self._read_answer, self._process.stdout))
        self._readers = [threading.Thread(target=read, args=(stream,), daemon=True) for read, stream in readers]
        for reader in self._readers:
            reader.start()

    def _read(self, stream) -> None:
        for line in stream:
            if status := status_of(line):
                self._take_status(status)
                continue
            program, colon, message = line.strip().partition(": ")
            if colon and program in PROGRAMS:  # an error; later lines of Blender do not replace it
                self._error = message
            self.last_line = self._error or line.strip() or self.last_line

    def _take_status(self, status: dict) -> None:
        if "folder" in status:
            self.folder = Path(status["folder"])
        self.plan = status.get("plan", self.plan)
        if "progress" in status and status.get("total"):
            self._task, self._done, self._total = status["progress"], status["done"], status["total"]
            planned_s = self.render_s if (self._task, self._done) == ("render", 0) else None
            self._left_s, self._left_at = status.get("left_s", planned_s), time.monotonic()

    def _read_answer(self, stream) -> None:
        for line in stream:
            if len(self.answer) < MAX_LINES:
                self.answer.append(line.rstrip())

    @property
    def progress(self) -> float:
        """Finished share of the current task."""
        return self._done / self._total

    @property
    def step(self) -> str:
        """Such as "Image 2 of 8" or "Simulate 25%"."""
        if not self._task:
            return self.tasks.get("", "Starting {job}").format(job=self.label)
        if self._task == "render":
            return f"Image {min(self._done + 1, self._total):,} of {self._total:,}"
        return f"{self.tasks.get(self._task, self.label)} {self.progress:.0%}"

    @property
    def text(self) -> str:
        """The step and the time left, or the time so far if the time left is unknown."""
        now = time.monotonic()
        if self._stopping:
            return f"{self.label}: stopping"
        if self._left_s is not None and self.progress < 1:
            return f"{self.step}, " + f"{clock(self._left_s - (now - self._left_at))} left"
        return f"{self.step}, {clock(now - self._start)}"

    def returncode(self) -> int | None:
        """Exit code; None while the process runs."""
        code = self._process.poll()
        if code is not None:
            for reader in self._readers:
                reader.join(READ_S)
        return code

    @property
    def is_stopping(self) -> bool:
        """Whether the user stopped it."""
        return self._stopping

    def stop(self) -> None:
        """Terminates the process; the second call kills it."""
        (self._process.kill if self._stopping else self._process.terminate)()
        self._stopping = True


def remove_copy(command: list[str]) -> None:
    for word in command:
        if (folder := Path(word).parent).name.startswith(COPIES):
            shutil.rmtree(folder, ignore_errors=True)


@dataclass
class Next:
    """A job that starts when those before it have succeeded. make: starts it."""

    command: list[str]
    make: Callable[[], BackgroundJob]


class _State:
    job: BackgroundJob | None = None
    queue: list[Next] = []
    message, is_error = "", False  # result of the last job
    offer_exists = False  # whether it could not write a stack, perhaps since one with other settings exists
    shown = ""  # text of the job at the last redraw
    scores: dict[str, Any] = {}  # JSON of the last comparison
    # Results for the open file, by scene name: of the light probe, of the plan, and checks.Problem of the scene checks.
    light: dict[str, dict[str, Any]] = {}
    plan: dict[str, dict[str, Any]] = {}
    problems: dict[str, list] = {}


state = _State()


def start(job: BackgroundJob, queue: Iterable[Next] = ()) -> None:
    state.job, state.queue, state.message, state.offer_exists = job, list(queue), "", False
    bpy.app.timers.register(poll, first_interval=POLL_S, persistent=True)


def poll() -> float | None:
    """Seconds until the next poll; None if no job runs."""
    job = state.job
    if not job:
        return None
    code = job.returncode()
    if code is not None or job.text != state.shown:  # a redraw costs Blender more than the poll
        state.shown = job.text
        redraw_panels()
    if code is None:
        return POLL_S
    remove_copy(job.command)
    disk.forget()
    stopped = job.is_stopping and code in STOPPED
    state.job, state.is_error = None, code != 0 and not stopped
    state.offer_exists = job.continues and code == ExitCode.BAD_OUTPUT
    try:
        state.message = _ending(job, code)
    except Exception as e:  # the result cannot be shown; the panel must accept the next job
        state.message, state.is_error = f"{job.label}: {e}", True
    if state.queue and code == 0:
        try:
            state.job = state.queue[0].make()
            del state.queue[0]
            return POLL_S
        except Exception as e:  # as above
            state.message, state.is_error = f"{job.label}: the next job cannot start: {e}", True
    _drop_queue()
    if state.is_error:
        pop_up(state.message)
    return None


def _drop_queue() -> None:
    for one in state.queue:
        remove_copy(one.command)
    state.queue = []


def _ending(job: BackgroundJob, code: int) -> str:
    if code == 0:
        return job.done(job)
    if job.is_stopping and code in STOPPED:
        return f"Stopped at {job.step}" + (f". Press {job.label} to resume" if job.continues else "")
    if end := end_of(code):
        return f"{job.label} was ended by {end}" + ". Finished frames are kept" * job.continues
    line = job.last_line.partition("; --")[0]  # without the hint of command-line options
    return line or f"{job.label} ended with code {code}"


@bpy.app.handlers.persistent
def on_load(*_) -> None:
    """Runs when another file is opened. A job for the open file (a preview, say) stops; other jobs continue."""
    disk.forget()
    state.light.clear()
    state.plan.clear()
    state.problems.clear()
    state.message, state.is_error, state.offer_exists, state.scores = "", False, False, {}
    if state.job and state.job.for_file:
        state.job.stop()


def pop_up(text: str) -> None:
    if not bpy.app.background:
        icon = "ERROR" if state.is_error else "INFO"
        bpy.context.window_manager.popup_menu(lambda menu, _: wrapped(menu.layout, text), title="PECS", icon=icon)


def unregister() -> None:
    if state.job:  # includes Blender's exit
        state.job.stop()
        remove_copy(state.job.command)
        _drop_queue()
    if bpy.app.timers.is_registered(poll):
        bpy.app.timers.unregister(poll)
    state.job, state.message, state.scores = None, "", {}
