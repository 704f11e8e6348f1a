"""The whole sensor: a stack in, an event file out."""

from __future__ import annotations

import ctypes
import json
import warnings
from collections.abc import Callable, Mapping
from os import PathLike, fspath
from typing import Any

from ._errors import PecsError
from ._library import function, path_bytes, take_json
from .chip import Chip, chip_options

_Progress = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_void_p)
_sense = function(
    "pecs_sense", ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p, ctypes.c_char_p, _Progress, ctypes.c_void_p
)


class _Watched:
    """A progress function for C, through which an exception (Ctrl-C too) stops the work and comes out behind it."""

    def __init__(self, progress: Callable[[float], object] | None):
        self.progress = progress
        self.raised: BaseException | None = None
        self.function = _Progress(self._call)

    def _call(self, done: float, _user: int | None) -> int:
        try:
            if self.progress:
                self.progress(done)
        except BaseException as e:
            self.raised = e
        return self.raised is None


def sense(
    stack: str | PathLike[str],
    output: str | PathLike[str],
    *,
    chip: str | PathLike[str] | Chip = "imx636",
    overrides: Mapping[str, float] | None = None,
    model: str = "pecs",
    parameters: Mapping[str, float] | None = None,
    white_a: float | None = None,
    noise: bool = True,
    seed: int = 1,
    threads: int = 0,
    readout: str = "chip",
    format: str | None = None,
    fps: float | None = None,
    times_us: str | PathLike[str] | None = None,
    fnumber: float | None = None,
    gain: float | None = None,
    photocurrent_a: float | None = None,
    bands: str = "all",
    labels: str | PathLike[str] | None = None,
    warmup_loops: int = 0,
    start_us: int = 0,
    duration_us: int | None = None,
    motion: bool = True,
    progress: Callable[[float], object] | None = None,
) -> dict[str, Any]:
    """Turns an EXR stack into an event file, as `pecs sense` does, and returns its report.

        report = pecs.sense("out/stack", "out/events.raw", chip="imx636", seed=1)
        report["results"]["events"], report["config"]["chip"]["values"]

    chip, overrides, model, parameters, noise, seed, threads, readout: as of `pecs.Sensor`. `white_a`: photocurrent [A]
    of white for models that take no light. `format`: of the output, else by its name. `fps` or `times_us` (a text
    file): the times of frames without any. `fnumber`: of the lens, for a stack of radiance; `gain`, `photocurrent_a`:
    for relative light (`Chip.amperes_per_unit`). `bands`: "all", or "mc:N" for N bands drawn by their light. `labels`:
    an NPY file for each event's cause (`pecs.sensor.LABELS`). `warmup_loops`: of a periodic stack, before the output
    begins; `start_us`, `duration_us`: begin and length of the output, in us. `motion`: light between
    the frames is carried along the stack's layer `motion`, if it has one; else frames alone.

    `progress` is called with the share done, 0 to 1; an exception from it stops the work. Raises PecsNotFoundError,
    PecsInputError and PecsOutputError; warns of values that no light has, of events that the readout lost, and of a
    duration that the stack does not have.
    """
    options = chip_options(chip, overrides) | {
        "model": model,
        "param": {key: float(value) for key, value in (parameters or {}).items()},
        "white_a": white_a,
        "no_noise": not noise,
        "seed": seed,
        "threads": threads,
        "readout": readout,
        "format": format,
        "fps": fps,
        "times_us": None if times_us is None else fspath(times_us),
        "fnumber": fnumber,
        "gain": gain,
        "photocurrent_a": photocurrent_a,
        "bands": bands,
        "labels": None if labels is None else fspath(labels),
        "warmup_loops": warmup_loops,
        "start_us": start_us,
        "duration_us": duration_us,
        "motion": motion,
    }
    watched = _Watched(progress)
    paths = path_bytes(stack), path_bytes(output)
    try:
        report: dict[str, Any] = take_json(_sense(*paths, json.dumps(options).encode(), watched.function, None))
    except PecsError:
        if watched.raised:
            raise watched.raised from None
        raise
    for line in report.pop("warnings"):
        warnings.warn(line, stacklevel=2)
    return report
