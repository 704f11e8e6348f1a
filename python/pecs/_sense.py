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

    - overrides, biases, bias_file, preset, model, parameters, noise, seed, threads, readout, and the stages: as of
      `pecs.Sensor`.
    - white_a: photocurrent [A] of white, for models that take no light.
    - format: of the output; by its name if not given.
    - fps, or times_us (a text file): times of frames without any.
    - fnumber: of the lens, for a stack of radiance. gain, photocurrent_a: for relative light
      (`Chip.amperes_per_unit`).
    - bands: "all" (default), or "mc:N" for N bands drawn by their light.
    - labels: an NPY file for each event's cause (`pecs.sensor.LABELS`).
    - dropped: an NPY file of the events that a stage dropped: t, x, y, p, stage (`pecs.sensor.STAGES`).
    - warmup_us: light before the first frame, extrapolated, and pixels that begin at random distances from their
      thresholds, as pixels that have been on (0: at rest).
    - warmup_loops: of a periodic stack, before the output begins (0). start_us, duration_us: begin (0) and length of
      the output.
    - render_noise: factor on the renderer's noise in the estimate of the events that come from it (1); 0: no estimate.
    - motion: light between frames follows the stack's layer `motion`, if there is one (True).

    `progress` is called with the share done, 0 to 1; an exception from it stops the work. Raises PecsNotFoundError,
    PecsInputError and PecsOutputError; warns of values that no light has, of events that the readout lost, and of a
    duration beyond the end of the stack.
    """
    raised: list[BaseException] = []  # by progress (Ctrl-C too): it stops the work, and comes out behind it

    @_Progress
    def watch(done: float, _user: int | None) -> int:
        try:
            if progress:
                progress(done)
        except BaseException as e:
            raised.append(e)
        return not raised

    paths, given = (path_bytes(stack), path_bytes(output)), library_options(chip, options, SenseOptions)
    try:
        report: dict[str, Any] = take_json(_sense(*paths, json.dumps(given).encode(), watch, None))
    except PecsError:
        if raised:
            raise raised[0] from None
        raise
    for line in report.pop("warnings"):
        warnings.warn(line, stacklevel=2)
    return report
