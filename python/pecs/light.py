"""The light of a rendered stack at any time, and over exposures (docs/reference/sensor.md, Motion between frames)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._c_types import DOUBLE, DOUBLES, FLOATS, INT64, POINTER, TEXT
from ._library import Handle, function, path_bytes, take_json
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
    """The photocurrent [A] of a stack at any time, as `pecs sense` gives it to the pixels: carried along the stack's
    motion between its frames, pictures between them included; without motion, blended at the pixel. Planes are
    float32, without dark current, as of `Chip.photocurrent`.

        with pecs.Light("stack", ["red.json", "green.json", "blue.json"]) as light:
            sharp = light.at(5000.0)                          # [3, height, width]
            blurred = light.mean(5000.0, 9000.0)              # global shutter
            rolling = light.exposure(5000.0, 4000.0, row_delay_us=20.0)

    chips: one `Chip`, name or file, or several: the colours of a camera are chips whose QE are its responses. Times
    count in microseconds from the first frame, as events do, to `end_us` (None: a stack with a period, which
    repeats without end). Times may come in any order; increasing ones are the fastest. Memory: two intervals' frames.
    Options as of `Chip.amperes_per_unit`; `fps`: for a folder without stack.json; `motion=False`: blended at the pixel
    all the same; `threads`: 0 is all. Raises PecsNotFoundError for no stack, PecsInputError for a time outside.
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
        super().__init__(_open(path_bytes(stack), json.dumps(options).encode()))
        info: dict[str, Any] = take_json(self._call(_info))
        self.shape: tuple[int, int, int] = (info["chips"], info["height"], info["width"])
        self.end_us: float | None = info["end_us"]
        self.along_motion: bool = info["motion"]

    def at(self, t_us: ArrayLike) -> NDArray[np.float32]:
        """The light at a time, [chips, height, width], or at several, [times, chips, height, width]."""
        times = np.asarray(t_us, np.float64)
        if times.ndim > 1:
            raise ValueError(f"t_us: got shape {times.shape}, wanted one time or a list")
        out = np.empty((*times.shape, *self.shape), np.float32)
        self._call(_at, np.ascontiguousarray(times), times.size, out.ctypes.data, out.size)
        return out

    def mean(self, begin_us: float, end_us: float, steps: int | None = None) -> NDArray[np.float32]:
        """The mean of the light from `begin_us` to `end_us`, [chips, height, width]: the picture of a global shutter.
        `steps` as of `exposure`."""
        return self.exposure(begin_us, end_us - begin_us, steps=steps)

    def exposure(
        self, begin_us: float, exposure_us: float, row_delay_us: float = 0.0, steps: int | None = None
    ) -> NDArray[np.float32]:
        """The mean of the light over each row's exposure, [chips, height, width]: row y is exposed for `exposure_us`
        from `begin_us + y * row_delay_us` on (rolling shutter; negative: the last row comes first).

        The exposure is cut into `steps` equal cells, each with the light of its middle; None: so many that nothing
        moves more than half a pixel from one to the next, and more than the pictures between two frames (without
        motion: four per interval). With a row delay the cells begin at `begin_us` and those at the ends of a row's
        exposure count in part; all rows together may have 2^20 cells. No planes are kept.
        """
        if steps is not None and steps < 1:
            raise ValueError(f"steps: got {steps}, wanted 1 or more")
        out = np.empty(self.shape, np.float32)
        self._call(_exposure, begin_us, exposure_us, row_delay_us, steps or 0, out, out.size)
        return out
