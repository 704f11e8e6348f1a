"""The whole sensor: a stack in, an event file out."""

from __future__ import annotations

import ctypes
import json
import warnings
from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING, Any

from ._c_types import POINTER, TEXT
from ._errors import PecsError
from ._library import function, path_bytes, take_json
from ._options import SenseOptions, library_options
from .chip import Chip

if TYPE_CHECKING:
    from typing_extensions import Unpack

_Progress = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_void_p)
_sense = function("pecs_sense", POINTER, TEXT, TEXT, TEXT, _Progress, POINTER)


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
    progress: Callable[[float], object] | None = None,
    **options: Unpack[SenseOptions],
) -> dict[str, Any]:
    """Simulates an event file from an EXR stack, as `pecs sense` does, and returns its report.

        report = pecs.sense("out/stack", "out/events.raw", chip="imx636", seed=1)
        report["results"]["events"], report["config"]["chip"]["values"]

    chip: a name, a path, or a `pecs.Chip`. Options:

    - overrides, model, parameters, noise, seed, threads, readout: as of `pecs.Sensor`.
    - white_a: photocurrent [A] of white, for models that take no light.
    - format: of the output; by its name if not given.
    - fps, or times_us (a text file): times of frames without any.
    - fnumber: of the lens, for a stack of radiance. gain, photocurrent_a: for relative light
      (`Chip.amperes_per_unit`).
    - bands: "all" (default), or "mc:N" for N bands drawn by their light.
    - labels: an NPY file for each event's cause (`pecs.sensor.LABELS`).
    - warmup_loops: of a periodic stack, before the output begins (0). start_us, duration_us: begin (0) and length of
      the output.
    - motion: light between frames follows the stack's layer `motion`, if there is one (True).

    `progress` is called with the share done, 0 to 1; an exception from it stops the work. Raises PecsNotFoundError,
    PecsInputError and PecsOutputError; warns of values that no light has, of events that the readout lost, and of a
    duration beyond the end of the stack.
    """
    watched = _Watched(progress)
    paths = path_bytes(stack), path_bytes(output)
    try:
        report: dict[str, Any] = take_json(
            _sense(*paths, json.dumps(library_options(chip, options, SenseOptions)).encode(), watched.function, None)
        )
    except PecsError:
        if watched.raised:
            raise watched.raised from None
        raise
    for line in report.pop("warnings"):
        warnings.warn(line, stacklevel=2)
    return report
