"""Options that `Sensor`, `simulate` and `sense` share, once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike, fspath
from typing import Any, TypedDict

import numpy as np

from ._errors import bad_input
from ._model import name_of
from .chip import Chip, chip_options, numbers_by_name


class PixelOptions(TypedDict, total=False):
    overrides: Mapping[str, float] | None
    biases: Mapping[str, float] | None
    bias_file: str | PathLike[str] | None
    preset: str | PathLike[str] | None
    model: str | Callable[..., Any]
    parameters: Mapping[str, float] | None
    noise: bool
    seed: int
    readout: str
    roi: Sequence[Sequence[int]] | None
    mask: str | PathLike[str] | None
    afk_hz: Sequence[float] | None
    afk_pass_hz: Sequence[float] | None
    afk_counts: Sequence[int] | None
    trail_us: int | None
    stc_us: int | None
    stc_keep_us: int | None
    erc_hz: float | None
    threads: int


# Options of the chip's digital stages.
STAGE_KEYS = ("roi", "mask", "afk_hz", "afk_pass_hz", "afk_counts", "trail_us", "stc_us", "stc_keep_us", "erc_hz")


class SensorOptions(PixelOptions, total=False):
    """Options of `Sensor` and `simulate`; `Sensor` describes them."""

    labels: bool
    photocurrent_a: float
    encoding: str | None
    time_unit: str | None


class SenseOptions(PixelOptions, total=False):
    """Options of `sense`, which describes them."""

    white_a: float | None
    format: str | None
    fps: float | None
    times_us: str | PathLike[str] | None
    time_unit: str | None
    fnumber: float | None
    gain: float | None
    photocurrent_a: float | None
    bands: str
    frames: str | PathLike[str] | None
    labels: str | PathLike[str] | None
    dropped: str | PathLike[str] | None
    warmup_loops: int
    warmup_us: int
    start_us: int
    duration_us: int | None
    render_noise: float
    motion: bool


def library_options(chip: str | PathLike[str] | Chip, options: Mapping[str, Any], kind: type) -> dict[str, Any]:
    """Options of a `kind` as the C library takes them. Raises TypeError for an unknown one."""
    for key in options.keys() - kind.__annotations__.keys():
        raise TypeError(f"unexpected option {key!r}; the options are {', '.join(kind.__annotations__)}")
    out = {key: fspath(value) if isinstance(value, PathLike) else value for key, value in options.items()}
    out.pop("encoding", None)  # the frames are converted here
    if callable(model := out.get("model")):
        out["model"] = name_of(model)
    for key in ("afk_hz", "afk_pass_hz", "afk_counts", "roi"):
        if out.get(key) is not None:
            out[key] = np.asarray(out[key]).tolist()
    for key, name in (("parameters", "param"), ("biases", "bias")):
        out[name] = numbers_by_name(key, out.pop(key, None))
    if not isinstance(noise := out.pop("noise", True), (bool, np.bool_)):  # not None, nor a factor
        raise bad_input("noise", "", noise, "True or False")
    out["no_noise"] = not noise
    return chip_options(chip, out.pop("overrides", None)) | out
