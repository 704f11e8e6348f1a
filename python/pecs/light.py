"""The light of a rendered stack at any time, and over exposures (docs/reference/sensor.md, Motion between frames)."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._c_types import DOUBLE, DOUBLES, FLOATS, INT64, POINTER, TEXT, times_from
from ._library import Handle, function, options_bytes, path_bytes, take_json
from .chip import Chip, ScaleOptions, chip_options

if TYPE_CHECKING:
    from typing_extensions import Unpack

_open = function("pecs_light_open", POINTER, TEXT, TEXT)
_info = function("pecs_light_info", POINTER, POINTER)
_at = function("pecs_light_at", INT64, POINTER, DOUBLES, INT64, POINTER, INT64)
_exposure = function("pecs_light_exposure", INT64, POINTER, DOUBLE, DOUBLE, DOUBLE, INT64, FLOATS, INT64)
_close = function("pecs_light_close", None, POINTER, error=False)

_Chip = str | PathLike[str] | Chip


class Light(Handle):
    """The photocurrent of a stack at any time, as `pecs sense` gives it to the pixels.

    Light between frames is warped along the stack's motion; without motion it is interpolated at the pixel. Memory: the
    frames of two intervals. Increasing times are the fastest.

        with pecs.Light("stack", ["red.json", "green.json", "blue.json"]) as light:
            sharp = light.at(5000.0)                          # [3, height, width]
            blurred = light.mean(5000.0, 9000.0)              # global shutter
            rolling = light.exposure(5000.0, 4000.0, row_delay_us=20.0)

    Parameters
    ----------
    stack : str or path
        The stack.
    chips : Chip, str, path, or a sequence of these
        One chip or several. The colours of a camera are chips whose quantum efficiencies are its responses.
    fps : float, optional
        Frame rate [Hz] of a folder without stack.json.
    motion : bool
        Warp along the stack's motion. Default True.
    threads : int
        Number of threads. Default 0: all.
    fnumber, gain, photocurrent_a : float, optional
        As in `Chip.amperes_per_unit`.

    Attributes
    ----------
    shape : (int, int, int)
        Chips, height, width.
    end_us : float or None
        Last time [us] from the first frame; None: the stack is periodic.
    along_motion : bool
        Whether light is warped.

    Raises
    ------
    PecsNotFoundError
        There is no such stack.
    PecsInputError
        A time is outside the stack.
    """

    _free = staticmethod(_close)

    def __init__(
        self,
        stack: str | PathLike[str],
        chips: _Chip | Sequence[_Chip],
        *,
        fps: float | None = None,
        motion: bool = True,
        threads: int = 0,
        **scale: Unpack[ScaleOptions],
    ):
        several = [chips] if isinstance(chips, (str, PathLike, Chip)) else list(chips)
        options = {"chips": [chip_options(chip) for chip in several], "fps": fps, "motion": motion, **scale}
        options |= {"threads": threads}
        super().__init__(_open(path_bytes(stack), options_bytes(options)))
        info: dict[str, Any] = take_json(self._call(_info))
        self.shape: tuple[int, int, int] = (info["chips"], info["height"], info["width"])
        self.end_us: float | None = info["end_us"]
        self.along_motion: bool = info["motion"]

    def at(self, t_us: ArrayLike) -> NDArray[np.float32]:
        """The photocurrent [A] without dark current at a time [us] from the first frame, [chips, height, width], or at
        several, [times, chips, height, width]."""
        times = times_from(t_us)
        if times.ndim > 1:
            raise ValueError(f"t_us: got shape {times.shape}, wanted one time or a list")
        out = np.empty((*times.shape, *self.shape), np.float32)
        self._call(_at, np.ascontiguousarray(times), times.size, out.ctypes.data, out.size)
        return out

    def mean(self, begin_us: float, end_us: float, steps: int | None = None) -> NDArray[np.float32]:
        """The mean photocurrent [A] over a time [us] from the first frame, of a global shutter, [chips, height,
        width]. `steps` as in `exposure`."""
        return self.exposure(begin_us, end_us - begin_us, steps=steps)

    def exposure(
        self, begin_us: float, exposure_us: float, row_delay_us: float = 0.0, steps: int | None = None
    ) -> NDArray[np.float32]:
        """The mean photocurrent over each row's exposure, of a rolling shutter.

        The exposure is cut into equal cells, each with the light of its middle. With a row delay, the cells begin at
        `begin_us`, and those at the ends of a row's exposure count in part; all rows together may have 2^20 cells.

        Parameters
        ----------
        begin_us : float
            Start [us] of row 0 from the first frame.
        exposure_us : float
            Exposure [us] of each row.
        row_delay_us : float
            Delay [us] from row to row; negative: the last row comes first. Default 0.
        steps : int, optional
            Number of cells. Default: as many as keep all motion below half a pixel per cell (without motion: four per
            interval).

        Returns
        -------
        float32 array
            [A], [chips, height, width].
        """
        if steps is not None and steps < 1:
            raise ValueError(f"steps: got {steps}, wanted 1 or more")
        out = np.empty(self.shape, np.float32)
        self._call(_exposure, begin_us, exposure_us, row_delay_us, steps or 0, out, out.size)
        return out
