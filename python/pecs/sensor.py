"""The sensor on frames in memory, and the bands to render for a chip.

    events = pecs.simulate(frames, t_us, chip="imx636", seed=1)   # frames [T, H, W], linear light

    with pecs.Sensor(1280, 720) as sensor:                        # frame by frame
        for t_us, frame in camera:
            events = sensor.push(frame, t_us)
        events = sensor.finish()

`photocurrent_a` is the photocurrent of a pixel of value 1 (255 in uint8, 65535 in uint16): it decides how fast the
photoreceptor is. Frames may be NumPy arrays, or tensors of PyTorch and others on the CPU. uint8 is taken as sRGB,
everything else as linear light; `encoding` overrides.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._library import Handle, function, json_function
from .events import EVENT_DTYPE

_bands = json_function("pecs_bands")
_open = function("pecs_sensor_open", ctypes.c_void_p, ctypes.c_char_p)
_push = function(
    "pecs_sensor_push",
    ctypes.c_int64,
    ctypes.c_void_p,
    np.ctypeslib.ndpointer(np.float32, flags="C_CONTIGUOUS"),
    np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS"),
    ctypes.c_int64,
    ctypes.c_int,
)
_events = function("pecs_sensor_events", None, ctypes.c_void_p, ctypes.c_void_p, error=False)
_labels = function("pecs_sensor_labels", None, ctypes.c_void_p, ctypes.c_void_p, error=False)
_dropped = function("pecs_sensor_dropped", ctypes.c_int64, ctypes.c_void_p, error=False)
_close = function("pecs_sensor_close", None, ctypes.c_void_p, error=False)

_CHUNK_BYTES = 64 << 20
LABELS = ("signal", "leak", "noise", "hot")
LABELLED_DTYPE = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1"), ("label", "u1")])


def _as_array(frames: ArrayLike) -> NDArray[Any]:
    """NumPy's view of anything with the array interface, or of a tensor on the CPU with DLPack alone."""
    if not hasattr(frames, "__array__") and hasattr(frames, "__dlpack__"):
        return np.from_dlpack(frames)
    return np.asarray(frames)


def _to_linear(frames: ArrayLike, encoding: str | None) -> NDArray[np.float32]:
    """Linear light, 1 = full scale; contiguous float32 comes back as it is."""
    frames = _as_array(frames)
    if encoding not in (None, "linear", "srgb"):
        raise ValueError(f"encoding: got {encoding!r}, wanted 'linear' or 'srgb'")
    srgb = encoding == "srgb" or (encoding is None and frames.dtype == np.uint8)
    if frames.dtype.kind == "u":
        top = np.iinfo(frames.dtype).max
        table = np.arange(top + 1, dtype=np.float64) / top if top < 1 << 16 else None
        if table is None:
            raise ValueError(f"frames: got {frames.dtype}, wanted uint8, uint16 or floating point")
        return (_from_srgb(table) if srgb else table).astype(np.float32)[frames]
    if frames.dtype.kind != "f":
        raise ValueError(f"frames: got {frames.dtype}, wanted uint8, uint16 or floating point")
    return np.ascontiguousarray(_from_srgb(frames) if srgb else frames, np.float32)


def _from_srgb(v: NDArray[Any]) -> NDArray[Any]:
    """IEC 61966-2-1."""
    return np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4)


class Sensor(Handle):
    """Frames in, events out. An interval's events come with the second frame after it, or at `finish`.

    `model`: pecs, or another simulator's (esim, v2e, voltmeter, icns; docs/models.md) with its `parameters`; 1 is then
    white. `overrides`: values of the chip. `readout`: "chip" (row arbiter, rate limit, time base) or "ideal".
    `labels`: events have a field `label`, why each came (index into `pecs.sensor.LABELS`).
    """

    _free = staticmethod(_close)

    def __init__(
        self,
        width: int,
        height: int,
        chip: str | PathLike[str] = "imx636",
        *,
        seed: int = 1,
        overrides: Mapping[str, float] | None = None,
        model: str = "pecs",
        parameters: Mapping[str, float] | None = None,
        noise: bool = True,
        readout: str = "chip",
        labels: bool = False,
        photocurrent_a: float = 1e-12,
        encoding: str | None = None,
        threads: int = 0,
    ):
        self.shape = (height, width)
        self.encoding = encoding
        self.labels = labels
        self.dropped = 0  # events that the readout lost, so far
        options = {
            "width": width,
            "height": height,
            "chip": fspath(chip),
            "overrides": {k: float(v) for k, v in (overrides or {}).items()},
            "model": model,
            "parameters": {k: float(v) for k, v in (parameters or {}).items()},
            "no_noise": not noise,
            "readout": readout,
            "labels": labels,
            "seed": seed,
            "threads": threads,
            "photocurrent_a": photocurrent_a,
        }
        self._handle = _open(json.dumps(options).encode())

    def push(self, frame: ArrayLike, t_us: float | ArrayLike, last: bool = False) -> NDArray[np.void]:
        """One frame [H, W], or several [T, H, W], at rising times in us. Returns t, x, y, p (`pecs.EVENT_DTYPE`)."""
        frames = _to_linear(frame, self.encoding)
        times = np.ascontiguousarray(np.atleast_1d(t_us), np.float64)
        if frames.ndim == 2:
            frames = frames[None]
        if frames.shape[1:] != self.shape or times.shape != frames.shape[:1]:
            raise ValueError(
                f"frames: got shape {frames.shape} at {times.size} times, wanted {(times.size, *self.shape)}"
            )
        return self._push(frames, times, last)

    def finish(self) -> NDArray[np.void]:
        """The events of the last interval; nothing can be pushed after it."""
        return self._push(np.empty((0, *self.shape), np.float32), np.empty(0), True)

    def _push(self, frames: NDArray[np.float32], times: NDArray[np.float64], last: bool) -> NDArray[np.void]:
        out = np.empty(_push(self._alive(), frames, times, len(frames), last), EVENT_DTYPE)
        _events(self._alive(), out.ctypes.data)
        self.dropped = _dropped(self._alive())
        if self.labels:
            labels = np.empty(len(out), np.uint8)
            _labels(self._alive(), labels.ctypes.data)
            plain, out = out, np.empty(len(out), LABELLED_DTYPE)
            for name in EVENT_DTYPE.names:
                out[name] = plain[name]
            out["label"] = labels
        if last:
            self.close()
        return out


def simulate(
    frames: ArrayLike, t_us: ArrayLike, chip: str | PathLike[str] = "imx636", **options: Any
) -> NDArray[np.void]:
    """All events of frames [T, H, W] at times `t_us` (us, rising); options as for `Sensor`."""
    frames, times = _as_array(frames), np.asarray(t_us, np.float64)
    if frames.ndim != 3 or times.shape != frames.shape[:1] or len(times) < 2:
        raise ValueError(f"frames: got shape {frames.shape} at {times.size} times, wanted [T, H, W] at T >= 2 times")
    step = max(1, _CHUNK_BYTES // (4 * frames[0].size))
    with Sensor(frames.shape[2], frames.shape[1], chip, **options) as sensor:
        chunks = [sensor.push(frames[i : i + step], times[i : i + step]) for i in range(0, len(times), step)]
        return np.concatenate([*chunks, sensor.finish()])


def bands(
    chip: str | PathLike[str] = "imx636",
    n: int = 6,
    placement: str = "gauss",
    illuminant: str | Sequence[tuple[float, float]] | None = None,
    min_nm: float | None = None,
    max_nm: float | None = None,
) -> list[dict[str, float]]:
    """Wavelengths and quadrature weights: [{"lambda_nm": .., "weight_nm": ..}, ...], rising.

    `placement`: "gauss", "strata" (of equal light, at their medians) or "uniform". `illuminant`: a name of
    lens_data/spectra, a .csv file, "blackbody:T", "daylight:T", or (lambda_nm, power) pairs, linear in between; the
    bands then integrate reflectances under it.
    """
    if illuminant is not None and not isinstance(illuminant, str):
        illuminant = [[float(x), float(p)] for x, p in illuminant]
    return _bands(
        {
            "chip": fspath(chip),
            "n": n,
            "placement": placement,
            "illuminant": illuminant,
            "min_nm": min_nm,
            "max_nm": max_nm,
        }
    )["bands"]
