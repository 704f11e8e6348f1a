"""The sensor on frames in memory.

    events = pecs.simulate(frames, t_us, chip="imx636", seed=1)   # frames [T, H, W], linear light

    events, taken = pecs.simulate(frames, t_us, chip="davis346", chip_frames=True)  # and the frames of a DAVIS

    with pecs.Sensor(1280, 720) as sensor:                        # frame by frame
        for t_us, frame in camera:
            events = sensor.push(frame, t_us)
        events = sensor.finish()

`photocurrent_a` is the photocurrent of a pixel of value 1 (255 in uint8, 65535 in uint16): it decides how fast the
photoreceptor is. Frames may be NumPy arrays, or tensors of PyTorch and others on the CPU. Integers are taken as sRGB,
floating point as linear light, as `pecs sense` takes pictures; `encoding` ("linear", "srgb") overrides.
"""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._c_types import DOUBLES, FLOATS, INT, INT64, POINTER, TEXT, times_from, unmasked
from ._library import Handle, function, options_bytes, take_json
from ._model import callbacks, raising
from ._options import SensorOptions, library_options
from .chip import Chip
from .events import EVENT_DTYPE, Events
from .motion import CHANNEL_COUNTS

if TYPE_CHECKING:
    from typing_extensions import Unpack

_open = function("pecs_sensor_open", POINTER, TEXT, POINTER)
_frames = (POINTER, FLOATS, DOUBLES, INT64)  # sensor, frames, their times, count
_push = function("pecs_sensor_push", INT64, *_frames, INT)
_push_moving = function("pecs_sensor_push_moving", INT64, *_frames, FLOATS, INT, INT)
_events = function("pecs_sensor_events", INT64, POINTER, POINTER, INT64)
_labels = function("pecs_sensor_labels", INT64, POINTER, POINTER, INT64)
_chip_frames = function("pecs_sensor_frames", INT64, POINTER, POINTER, POINTER, ctypes.POINTER(INT), INT64)
_dropped = function("pecs_sensor_dropped", INT64, POINTER)
_dropped_by_stage = function("pecs_sensor_dropped_by_stage", POINTER, POINTER)
_int64 = ctypes.POINTER(ctypes.c_int64)
_bad_values = function("pecs_sensor_bad_values", INT, POINTER, _int64, _int64)
_close = function("pecs_sensor_close", None, POINTER, error=False)

_CHUNK_BYTES = 64 << 20
LABELS = ("signal", "leak", "noise", "hot", "render", "unsure", "frame")
STAGES = ("none", "roi", "mask", "afk", "trail", "erc")  # as numbered in the file of dropped events
LABELLED_DTYPE = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1"), ("label", "u1")])


class ChipFrames(NamedTuple):
    """Frames that a DAVIS takes with its event pixels (docs/reference/sensor.md#frames-of-a-davis).

    values: [N, H, W] of the ADC, below 2**bits. begin_us, end_us: [N], exposure of the middle row.
    """

    values: NDArray[np.uint16]
    begin_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    bits: int


def _as_array(frames: ArrayLike) -> NDArray[Any]:
    """NumPy's view of anything with the array interface, or of a tensor on the CPU with DLPack alone."""
    if not hasattr(frames, "__array__") and hasattr(frames, "__dlpack__"):
        return np.from_dlpack(frames)  # type: ignore[arg-type]
    return unmasked("frames", frames)


def _to_linear(frames: ArrayLike, encoding: str | None) -> NDArray[np.float32]:
    """Linear light, 1 = full scale; contiguous float32 comes back as it is."""
    frames = _as_array(frames)
    if encoding not in (None, "linear", "srgb"):
        raise ValueError(f"encoding: got {encoding!r}, wanted 'linear' or 'srgb'")
    srgb = encoding == "srgb" or (encoding is None and frames.dtype.kind == "u")
    if frames.dtype.kind != "f" and frames.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"frames: got {frames.dtype}, wanted uint8, uint16 or floating point")
    if frames.dtype.kind == "u":
        top = np.iinfo(frames.dtype).max
        table = np.arange(top + 1) / top
        # The order of an index decides that of the result; the library takes rows.
        return (_from_srgb(table) if srgb else table).astype(np.float32)[np.ascontiguousarray(frames)]
    return np.ascontiguousarray(_from_srgb(frames) if srgb else frames, np.float32)


def _from_srgb(v: NDArray[Any]) -> NDArray[Any]:
    """IEC 61966-2-1."""
    return np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4)


class Sensor(Handle):
    """Simulate events frame by frame. The events of an interval are returned with the second frame after it, or by
    `finish`.

        with pecs.Sensor(640, 480, "davis346", overrides={"contrast_threshold_on": 0.25}, seed=2) as sensor:
            events = [sensor.push(frame, t_us) for frame, t_us in frames]

    Any thread may push; pushes wait for each other.

    Parameters
    ----------
    width, height : int
        Size of the frames [pixels].
    chip : str, path or Chip
        Name of a shipped profile, a .json file or a `Chip`. Default "imx636".
    overrides : dict of str to float, optional
        Values of the chip, by the keys and units of `Chip.info`.
    biases : dict of str to float, optional
        Offsets to the factory settings, such as {"diff_on": 35} (docs/reference/sensor.md).
    bias_file : str or path, optional
        A Metavision .bias file or camera settings (.json).
    preset : str or path, optional
        One of `pecs.presets()`: its model, parameters and overrides (given ones win), and an ideal readout.
    model : str or callable
        One of `pecs.models()`, or a model of your own (docs/howto/add_pixel_model.md). Default "pecs". For models that
        take grey values, 1 is white.
    parameters : dict of str to float, optional
        Of the model.
    noise : bool
        Photon noise, leak, background events and mismatch. Default True.
    seed : int
        Of all random numbers. Default 1.
    readout : str
        "chip" (default; row arbiter, rate limit, time base) or "ideal".
    roi : sequence of (int, int, int, int), optional
        Windows x, y, width, height [pixels]; pixels outside all of them are off.
    mask : str or path, optional
        File of pixels whose events are dropped.
    afk_hz, afk_pass_hz : (float, float), optional
        Anti-flicker: band [Hz] whose flicker is dropped, or kept; at most one of both.
    afk_counts : (int, int), optional
        Anti-flicker: a block flickers once this many periods are counted, until fewer than the second number are left.
        Default (6, 4).
    trail_us, stc_us, stc_keep_us : int, optional
        Keep the first event of a burst, the second, or all but the first [us]; at most one of these.
    erc_hz : float, optional
        Event rate control: largest number of events per second.
    labels : bool
        Events have a field `label`, the cause as an index into `pecs.sensor.LABELS`. Default False.
    photocurrent_a : float
        Photocurrent [A] of a pixel of value 1 (255 in uint8, 65535 in uint16). Default 1e-12.
    chip_frames : bool
        The chip also takes frames (davis346, davis240c): `take_frames`. Default False.
    encoding : str, optional
        "linear" or "srgb". Default: "srgb" for integers, "linear" for floating point.
    time_unit : str, optional
        "s", "ms", "us" or "ns": unit of the frames' times. Default: us; times less than 1 us apart on average, and four
        or more that are all half a second or more apart, are then refused.
    threads : int
        Number of threads; the events do not depend on it. Default 0: all.

    Attributes
    ----------
    dropped : int
        Number of events that the readout lost so far.
    dropped_by_stage : dict of str to int
        Number of events that each digital stage dropped so far.
    bad_values : dict of str to int
        Number of pixels of the frames that were not finite or negative so far.

    Raises
    ------
    PecsNotFoundError
        The chip is unknown.
    PecsInputError
        An option is unknown, a value is wrong, or the frames are larger than the chip.
    """

    _free = staticmethod(_close)

    def __init__(
        self,
        width: int,
        height: int,
        chip: str | PathLike[str] | Chip = "imx636",
        *,
        chip_frames: bool = False,
        **options: Unpack[SensorOptions],
    ):
        self.shape = (height, width)
        self.encoding = options.get("encoding")
        self.labels = options.get("labels", False)
        self.dropped = 0  # events that the readout lost, so far
        self.dropped_by_stage: dict[str, int] = {}  # events that each stage behind it dropped, so far
        self.bad_values = {"not_finite": 0, "negative": 0}  # of the frames, so far
        self._warns = True
        self._chip_frames = ChipFrames(np.empty((0, height, width), np.uint16), *np.empty((2, 0), np.int64), 0)
        given = {"width": width, "height": height, "photocurrent_a": 1e-12, "chip_frames": chip_frames}
        self._raised: list[BaseException] = []  # by a model of the caller's
        text = options_bytes(given | library_options(chip, options, SensorOptions))
        self._model, model = callbacks(options.get("model"), self._raised)
        with raising(self._raised):
            super().__init__(_open(text, model))

    def push(
        self, frame: ArrayLike, t_us: float | ArrayLike, last: bool = False, motion: ArrayLike | None = None
    ) -> Events:
        """Simulate one frame or several.

        Negative values are taken as 0; a pixel whose value is not finite keeps its last one. Both are counted in
        `bad_values`, and the first push that has some warns.

        Parameters
        ----------
        frame : array
            [H, W], or [T, H, W].
        t_us : float or array
            Increasing times [us], at least 1 us apart; [T] for several frames.
        last : bool
            No frame follows; the sensor closes. Default False.
        motion : array, optional
            Motion in the interval before each frame, [channels, H, W] or [T, channels, H, W] as `pecs.carry` takes it:
            20 channels, or optical flow in 2 or 4; NaN: unknown. Light between the frames is then warped along it. That
            of the very first frame is ignored.

        Returns
        -------
        Events
            t [us], x, y [pixels], p (1: ON), sorted by t.

        Raises
        ------
        ValueError
            A shape is wrong, or times do not increase by at least 1 us.
        """
        frames = _to_linear(frame, self.encoding)
        times = np.ascontiguousarray(np.atleast_1d(times_from(t_us)))
        if frames.ndim == 2:
            frames = frames[None]
        if frames.shape[1:] != self.shape or times.shape != frames.shape[:1]:
            raise ValueError(
                f"frames: got shape {frames.shape} at {times.size} times, wanted {(times.size, *self.shape)}"
            )
        return self._push(frames, times, last, None if motion is None else self._motion(motion, len(frames)))

    def _motion(self, motion: ArrayLike, frames: int) -> NDArray[np.float32]:
        out = np.ascontiguousarray(_as_array(motion), np.float32)
        out = out[None] if out.ndim == 3 else out
        if out.ndim != 4 or (len(out), *out.shape[2:]) != (frames, *self.shape) or out.shape[1] not in CHANNEL_COUNTS:
            counts = " | ".join(map(str, CHANNEL_COUNTS))
            raise ValueError(f"motion: got shape {out.shape}, wanted ({frames}, {counts}, *{self.shape})")
        return out

    def finish(self) -> Events:
        """Return the events of the last interval and close the sensor."""
        return self._push(np.empty((0, *self.shape), np.float32), np.empty(0), True)

    def _push(
        self,
        frames: NDArray[np.float32],
        times: NDArray[np.float64],
        last: bool,
        motion: NDArray[np.float32] | None = None,
    ) -> Events:
        with self._use() as handle, raising(self._raised):
            if motion is None:
                count = _push(handle, frames, times, len(frames), last)
            else:
                count = _push_moving(handle, frames, times, len(frames), motion, motion.shape[1], last)
            out = np.empty(count, EVENT_DTYPE)
            _events(handle, out.ctypes.data, len(out))
            self.dropped = _dropped(handle)
            self.dropped_by_stage = take_json(_dropped_by_stage(handle))
            if self.labels:
                labels = np.empty(len(out), np.uint8)
                _labels(handle, labels.ctypes.data, len(labels))
                plain, out = out, np.empty(len(out), LABELLED_DTYPE)
                out[list("txyp")] = plain
                out["label"] = labels
            self._add_chip_frames(handle)
            self._count_bad_values(handle)
            if last:
                self.close()
        return Events(out, self.shape[1], self.shape[0])

    def take_frames(self) -> ChipFrames:
        """Return the frames that the chip completed since the last call, also after `finish`. Exposure k begins k
        periods after the first light."""
        values, begin_us, end_us, bits = taken = self._chip_frames
        self._chip_frames = ChipFrames(values[:0], begin_us[:0], end_us[:0], bits)
        return taken

    def _add_chip_frames(self, handle: int) -> None:
        bits = INT()
        if not (count := _chip_frames(handle, None, None, bits, 0)):
            return
        values, exposures = np.empty((count, *self.shape), np.uint16), np.empty((count, 2), np.int64)
        _chip_frames(handle, values.ctypes.data, exposures.ctypes.data, bits, count)
        known = self._chip_frames
        new = zip(known[:3], (values, *exposures.T), strict=True)
        self._chip_frames = ChipFrames(*map(np.concatenate, new), bits.value)

    def _count_bad_values(self, handle: int) -> None:
        counts = ctypes.c_int64(), ctypes.c_int64()
        _bad_values(handle, *map(ctypes.byref, counts))
        self.bad_values = {"not_finite": counts[0].value, "negative": counts[1].value}
        if self._warns and any(self.bad_values.values()):
            self._warns = False
            _warn(self.bad_values, 4)


def _warn(bad_values: Mapping[str, int], depth: int) -> None:
    if any(bad_values.values()):
        counts = f"{bad_values['not_finite']} not finite, {bad_values['negative']} negative"
        warnings.warn(f"frames: values that no light has: {counts}", stacklevel=depth + 1)


@overload
def simulate(
    frames: ArrayLike,
    t_us: ArrayLike,
    chip: str | PathLike[str] | Chip = "imx636",
    *,
    progress: Callable[[float], object] | None = None,
    chip_frames: Literal[False] = False,
    **options: Unpack[SensorOptions],
) -> Events: ...


@overload
def simulate(
    frames: ArrayLike,
    t_us: ArrayLike,
    chip: str | PathLike[str] | Chip = "imx636",
    *,
    progress: Callable[[float], object] | None = None,
    chip_frames: Literal[True],
    **options: Unpack[SensorOptions],
) -> tuple[Events, ChipFrames]: ...


def simulate(
    frames: ArrayLike,
    t_us: ArrayLike,
    chip: str | PathLike[str] | Chip = "imx636",
    *,
    progress: Callable[[float], object] | None = None,
    chip_frames: bool = False,
    **options: Unpack[SensorOptions],
) -> Events | tuple[Events, ChipFrames]:
    """Simulate the events of frames.

        events = pecs.simulate(frames, 1000 * np.arange(len(frames)), chip="imx636", photocurrent_a=1e-12)

    Parameters
    ----------
    frames : array
        [T, H, W], at least two; floating point is linear light, uint8 and uint16 are sRGB.
    t_us : array
        [T], increasing times [us], at least 1 us apart.
    chip : str, path or Chip
        The chip. Default "imx636".
    progress : callable, optional
        Called with the share done, 0 to 1; an exception from it stops the work.
    chip_frames : bool
        Also return the frames that the chip takes (davis346, davis240c). Default False.
    **options
        As in `Sensor`.

    Returns
    -------
    Events
        t [us], x, y [pixels], p (1: ON), sorted by t; with `labels=True` also `label`. With `chip_frames=True`, a pair
        of these and `ChipFrames`.
    """
    frames, times = _as_array(frames), times_from(t_us)
    if frames.ndim != 3 or times.shape != frames.shape[:1] or len(times) < 2:
        raise ValueError(f"frames: got shape {frames.shape} at {times.size} times, wanted [T, H, W] at T >= 2 times")
    step = max(1, _CHUNK_BYTES // (4 * max(frames[0].size, 1)))
    with Sensor(frames.shape[2], frames.shape[1], chip, chip_frames=chip_frames, **options) as sensor:
        sensor._warns = False
        parts = []
        for i in range(0, len(times), step):
            parts.append(sensor.push(frames[i : i + step], times[i : i + step]))
            if progress:
                progress(min(1.0, (i + step) / len(times)))
        parts.append(sensor.finish())
        _warn(sensor.bad_values, 2)
        events = Events(np.concatenate(parts, dtype=parts[0].dtype), frames.shape[2], frames.shape[1])
        return (events, sensor.take_frames()) if chip_frames else events
