"""The whole sensor: a stack in, an event file out."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING, Any

from ._c_types import POINTER, TEXT
from ._library import function, options_bytes, path_bytes, take_json
from ._model import callbacks, raising
from ._options import SenseOptions, library_options
from .chip import Chip

if TYPE_CHECKING:
    from typing_extensions import Unpack

_Progress = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_void_p)
_sense = function("pecs_sense", POINTER, TEXT, TEXT, TEXT, POINTER, _Progress, POINTER)


def sense(
    stack: str | PathLike[str],
    output: str | PathLike[str],
    *,
    chip: str | PathLike[str] | Chip = "imx636",
    progress: Callable[[float], object] | None = None,
    **options: Unpack[SenseOptions],
) -> dict[str, Any]:
    """Simulate an event file from a stack, as `pecs sense` does. Pictures and video require the program `pecs sense`.

        report = pecs.sense("out/stack", "out/events.raw", chip="imx636", seed=1)
        report["results"]["events"], report["config"]["chip"]["values"]

    Warns of values that are not finite or negative, of events that the readout lost, and of a duration beyond the end
    of the stack.

    Parameters
    ----------
    stack : str or path
        EXR stack, or folder of EXR files.
    output : str or path
        Event file; its extension selects the format.
    chip : str, path or Chip
        The chip. Default "imx636".
    progress : callable, optional
        Called with the share done, 0 to 1; an exception from it stops the work.
    overrides, biases, bias_file, preset, model, parameters, noise, seed, readout, threads
        As in `Sensor`.
    roi, mask, afk_hz, afk_pass_hz, afk_counts, trail_us, stc_us, stc_keep_us, erc_hz
        As in `Sensor`.
    white_a : float, optional
        Photocurrent [A] of white, for models that take grey values. Default: 99.5 % of the first frame.
    format : str, optional
        Of the output. Default: by its extension.
    fps : float, optional
        Frame rate [Hz] of frames without times.
    times_us : str or path, optional
        Text file of the frames' times [us].
    time_unit : str, optional
        "s", "ms", "us" or "ns": unit of `times_us`. Default: us; times that are hardly us are refused.
    fnumber : float, optional
        Of the lens, for a stack of radiance. Default: that of the stack.
    gain, photocurrent_a : float, optional
        As in `Chip.amperes_per_unit`, for relative light.
    bands : str
        "all" (default), or "mc:N" for N bands drawn by their light.
    frames : str or path, optional
        The chip also takes frames (davis346, davis240c): a new folder of PNG with images.txt, or the output itself, if
        it is AEDAT4.
    labels : str or path, optional
        NPY file of each event's cause (`pecs.sensor.LABELS`).
    dropped : str or path, optional
        NPY file of the events that a stage dropped: t, x, y, p, stage (`pecs.sensor.STAGES`).
    warmup_loops : int
        Loops of a periodic stack before the output begins. Default 0.
    warmup_us : int
        Light before the first frame [us], extrapolated, for pixels that have been on. Default 0: pixels are at rest.
    start_us : int
        Begin of the output [us]. Default 0.
    duration_us : int, optional
        Length of the output [us]. Default: to the end of the stack.
    render_noise : float
        Factor on the renderer's noise in the estimate of its events. Default 1; 0: no estimate.
    motion : bool
        Warp light between frames along the stack's layer `motion`, if there is one. Default True.

    Returns
    -------
    dict
        The report, as in the run record (.run.json).

    Raises
    ------
    PecsNotFoundError
        The input or the chip is missing.
    PecsInputError
        The input or an option is wrong.
    PecsOutputError
        The output cannot be written.
    """
    raised: list[BaseException] = []  # by progress or the model: it stops the work, and comes out behind it

    @_Progress
    def watch(done: float, _user: int | None) -> int:
        try:
            if progress:
                progress(done)
        except BaseException as e:
            raised.append(e)
        return not raised

    paths, given = (path_bytes(stack), path_bytes(output)), library_options(chip, options, SenseOptions)
    _kept, model = callbacks(options.get("model"), raised)
    with raising(raised):
        report: dict[str, Any] = take_json(_sense(*paths, options_bytes(given), model, watch, None))
    for line in report.pop("warnings"):
        warnings.warn(line, stacklevel=2)
    return report
