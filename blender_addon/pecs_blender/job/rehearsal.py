# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks what `pecs run` passes to `pecs sense` before anything is rendered: the program reads all of it, and a stack
like the one to come, up to the first frame, which is empty here."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from pecs._errors import PecsError
from pecs._files import check_folder, existing_folder

from ..camera.plan import Plan
from ..scene.source import Source
from ..truth import layer_class

OUTPUTS = ("--labels", "--dropped")  # options of `pecs sense` that name a file to write


def rehearse(sense: list[str], events: Path, stack: Path, words: list[str], source: Source, plan: Plan) -> None:
    """Raises the error of `sense STACK -o EVENTS WORDS` if there is one."""
    with tempfile.TemporaryDirectory(prefix="pecs_") as scratch:
        outputs, elsewhere = [events], list(words)
        for index, word in enumerate(words[1:], 1):
            if words[index - 1] in OUTPUTS:
                outputs.append(Path(word))
                elsewhere[index] = str(Path(scratch, outputs[-1].name))
        for file in outputs:
            _check_folder(file, stack)
        empty = Path(scratch) / "stack"
        _write(empty, source, plan)
        command = [*sense, str(empty), "-o", str(Path(scratch, events.name)), *elsewhere]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", stdin=subprocess.DEVNULL)
        message = done.stderr.strip().rpartition("\n")[2].removeprefix("pecs: ")
        if done.returncode and not message.startswith(str(empty / "frame_")):
            message = message.replace(f"{empty}: ", "").replace(f"{scratch}{os.sep}", "")
            raise PecsError(message, done.returncode if done.returncode > 0 else None)


def _check_folder(file: Path, stack: Path) -> None:
    folder = file.absolute().parent
    if not folder.exists() and folder in stack.absolute().parents:  # made with the stack
        folder = existing_folder(folder)
    check_folder(file, folder)


def _write(empty: Path, source: Source, plan: Plan) -> None:
    """A stack of the first and the last instant."""
    grid = plan.instants.grid
    through_lens = (plan.view.lens or source.lens["lens"]) != "none"
    info: dict[str, Any] = {
        **plan.view.record(through_lens, source.fnumber),
        "bands": [{"lambda_nm": 550.0, "weight_nm": 100.0}],
        "times_ns": grid.times_ns[:: max(1, len(grid.times_ns) - 1)],
        "period_ns": grid.period_ns,
        **{"lens": None, "scene": {}, "render": {}, "versions": {}},
        "layers": [layer_class("motion").entry()] if "motion" in plan.layers else [],
    }
    empty.mkdir()
    (empty / "stack.json").write_text(json.dumps(info))
    for index in range(len(info["times_ns"])):
        (empty / f"frame_{index:06d}.exr").touch()
