"""Options that `Sensor`, `simulate` and `sense` share, once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import Any, TypedDict

import numpy as np

from .chip import Chip, chip_options, numbers_by_name


class PixelOptions(TypedDict, total=False):
    overrides: Mapping[str, float] | None  # values of the chip, by the keys and units of `Chip.info`
    biases: Mapping[str, float] | None  # offsets to the factory settings: {"diff_on": 35}
    bias_file: str | PathLike[str] | None  # a Metavision .bias file or camera settings (.json)
    preset: str | PathLike[str] | None  # one of `pecs.presets()`: model, parameters and overrides at once
    model: str  # one of `pecs.models()`; default "pecs"
    parameters: Mapping[str, float] | None  # of the model
    noise: bool  # photon noise, leak, background events and mismatch; default True
    seed: int  # default 1
    readout: str  # "chip" (row arbiter, rate limit, time base; default) or "ideal"
    roi: Sequence[Sequence[int]] | None  # windows x, y, width, height: pixels outside all of them are off
    mask: str | PathLike[str] | None  # file of pixels whose events are dropped
    afk_hz: Sequence[float] | None  # anti-flicker: low, high of a band whose flicker is dropped; or afk_pass_hz: kept
    afk_pass_hz: Sequence[float] | None
    afk_counts: Sequence[int] | None  # periods counted before a block flickers, and left while it does; default (6, 4)
    trail_us: int | None  # keep the first event of a burst; or stc_us: the second; or stc_keep_us: all but the first
    stc_us: int | None
    stc_keep_us: int | None
    erc_hz: float | None  # event rate control: most events per second
    threads: int  # default 0: all; the events are the same with any number


# Options of the chip's digital stages.
STAGE_KEYS = ("roi", "mask", "afk_hz", "afk_pass_hz", "afk_counts", "trail_us", "stc_us", "stc_keep_us", "erc_hz")


class SensorOptions(PixelOptions, total=False):
    """Options of `Sensor` and `simulate`."""

    labels: bool  # events have a field `label`, an index into `pecs.sensor.LABELS`; default False
    photocurrent_a: float  # photocurrent [A] of a pixel of value 1; default 1e-12
    encoding: str | None  # of the frames: "linear", "srgb", or None (srgb for integers); default None
    time_unit: str | None  # of t_us: "s", "ms", "us" or "ns"; default None: us, and others are refused


class SenseOptions(PixelOptions, total=False):
    """Options of `sense`."""

    white_a: float | None  # photocurrent [A] of white, for models that take no light
    format: str | None  # of the output; default: by its name
    fps: float | None  # times of frames without any; or times_us
    times_us: str | PathLike[str] | None  # a text file
    time_unit: str | None  # of its times: "s", "ms", "us" or "ns"; default None: us, and others are refused
    fnumber: float | None  # of the lens, for a stack of radiance
    gain: float | None  # for relative light, as of `Chip.amperes_per_unit`
    photocurrent_a: float | None  # likewise
    bands: str  # "all" (default), or "mc:N" for N bands drawn by their light
    labels: str | PathLike[str] | None  # an NPY file for each event's cause (`pecs.sensor.LABELS`)
    dropped: str | PathLike[str] | None  # an NPY file of the events that a stage dropped (`pecs.sensor.STAGES`)
    warmup_loops: int  # of a periodic stack, before the output begins; default 0
    warmup_us: int  # light before the first frame, extrapolated, for pixels that have been on; default 0
    start_us: int  # begin of the output; default 0
    duration_us: int | None  # length of the output; default: to the end of the stack
    render_noise: float  # factor on the renderer's noise in the estimate of its events, 0: no estimate; default 1
    motion: bool  # light between frames follows the stack's layer `motion`, if there is one; default True


def library_options(chip: str | PathLike[str] | Chip, options: Mapping[str, Any], kind: type) -> dict[str, Any]:
    """Options of a `kind` as the C library takes them. Raises TypeError for an unknown one."""
    for key in options.keys() - kind.__annotations__.keys():
        raise TypeError(f"unexpected option {key!r}; the options are {', '.join(kind.__annotations__)}")
    out = {key: fspath(value) if isinstance(value, PathLike) else value for key, value in options.items()}
    out.pop("encoding", None)  # the frames are converted here
    for key in ("afk_hz", "afk_pass_hz", "afk_counts", "roi"):
        if out.get(key) is not None:
            out[key] = np.asarray(out[key]).tolist()
    for key, name in (("parameters", "param"), ("biases", "bias")):
        out[name] = numbers_by_name(key, out.pop(key, None))
    out["no_noise"] = not out.pop("noise", True)
    return chip_options(chip, out.pop("overrides", None)) | out
