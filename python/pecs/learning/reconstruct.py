"""Events of a file to pictures, window after window."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .._config import Fields, parse_json
from .._errors import PecsInputError, UsageError, bad_input, existing, optional_module
from .._files import check_outputs, read_bytes
from ..events import EventReader
from ..representations import voxel_grid
from .filter import HighPass
from .limits import WHOLE, NetworkConfig
from .smooth import smooth as smoothed
from .video import Range, VideoWriter
from .windows import Window, windows

NETWORK_FORMAT = "2"
STATE = "state"  # prefix of the names of a network's states: state_NUMBER_LEVEL
_STATE_NAME = re.compile(rf"{STATE}_[0-9]{{1,3}}_([0-9])")
MOST_CHANNELS = WHOLE["channels"][1] << 10  # of a state
MOST_BYTES = 1 << 30  # of a network
USUAL_US = 20_000.0  # length of a window
LATE = 0.4  # of the time constant of the photoreceptors: how late events show the light, in the middle
CUTOFF_HZ = 1.0
METHODS = ("network", "filter")
WEIGHTS = Path(__file__).with_name("network.onnx")  # the network that PECS includes; its record is inside


def late_us(corner_hz: float | None) -> float:
    """How much earlier the picture of a window was than the window's end: in dim light, events come late."""
    return 1e6 * LATE / (2 * np.pi * corner_hz) if corner_hz else 0.0


def compressed(grid: NDArray[np.float32], window_us: float) -> NDArray[np.float32]:
    """Planes that a network takes, [..., bins + 1, H, W], from the voxel grids [..., bins, H, W] of windows of this
    length: sign(v) ln(1 + |v|), so that a hot pixel is no outlier, and a plane of the length."""
    values = np.sign(grid) * np.log1p(np.abs(grid))
    shape = (*grid.shape[:-3], 1, *grid.shape[-2:])
    return np.concatenate([values, np.full(shape, np.log10(window_us / USUAL_US), np.float32)], -3)


class Method(Protocol):
    """The picture at the end of a window: [H, W], 0 … 1."""

    kind: str

    def __call__(self, window: Window) -> NDArray[np.float64]: ...


class Filter:
    """`HighPass`, scaled by `Range`."""

    kind = "filter"

    def __init__(self, width: int, height: int, cutoff_hz: float):
        self._filter, self._range = HighPass(width, height, cutoff_hz), Range()

    def __call__(self, window: Window) -> NDArray[np.float64]:
        return self._range(self._filter.push(window.events, window.end_us))


class Network:
    """A network as `pecs train` writes it: inputs `planes` [1, bins + 1, H, W] (`compressed`) and its states, outputs
    `picture` [1, 1, H, W], `late_us` before the window's end, and the next states."""

    kind = "network"

    def __init__(self, path: Path, width: int, height: int, threads: int = 0):
        model = network_bytes(path)
        runtime = optional_module("onnxruntime", "onnxruntime", "reconstruct without --method filter", "learning")
        runtime.set_default_logger_severity(4)  # its errors are exceptions, too
        options = runtime.SessionOptions()
        options.intra_op_num_threads = threads
        # Spinning threads slow down other processes.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 4
        try:
            self._session = runtime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        except Exception as e:  # ONNX Runtime raises many types
            raise PecsInputError(f"{path}: {_first_line(e)}, wanted a network in ONNX") from None
        said = self._session.get_modelmeta().custom_metadata_map
        if said.get("pecs_network") != NETWORK_FORMAT:
            raise bad_input(
                path, "pecs_network", said.get("pecs_network"), f"{NETWORK_FORMAT}: a network of `pecs train`"
            )
        record = Fields(parse_json(said.get("record", ""), f"{path}: record"), path, "record")
        config = NetworkConfig.read(record.table("network"))
        self._path, self.record = path, record.content
        self._bins, self.size = config.bins, (height, width)
        step = 2**config.levels
        self._pad = -height % step, -width % step
        self._states = self._first_states(config.levels)

    def _first_states(self, levels: int) -> dict[str, NDArray[np.float32]]:
        """Zeros. Raises PecsInputError for inputs that no network of `pecs train` has."""
        found: dict[str, NDArray[np.float32]] = {}
        inputs = self._session.get_inputs()
        for entry in inputs[1:]:
            name = _STATE_NAME.fullmatch(entry.name)
            channels = entry.shape[1] if len(entry.shape) == 4 else None
            if name and int(name[1]) <= levels and isinstance(channels, int) and 0 < channels <= MOST_CHANNELS:
                size = (n + more >> int(name[1]) for n, more in zip(self.size, self._pad, strict=True))
                found[entry.name] = np.zeros([1, channels, *size], np.float32)
        names = [entry.name for entry in inputs]
        if names != ["planes", *found] or len(self._session.get_outputs()) != len(names):
            raise bad_input(self._path, "inputs", names, f"planes, and states such as {STATE}_0_1")
        return found

    def __call__(self, window: Window) -> NDArray[np.float64]:
        height, width = self.size
        grid = voxel_grid(window.events, width, height, self._bins, window.begin_us, window.end_us)
        grid = np.pad(grid, ((0, 0), *((0, n) for n in self._pad)))
        planes = compressed(grid, window.end_us - window.begin_us)[None]
        try:
            picture, *states = self._session.run(None, {"planes": planes, **self._states})
        except Exception as e:  # ONNX Runtime raises many types
            raise PecsInputError(f"{self._path}: {_first_line(e)}, wanted a network that runs") from None
        shapes = [(1, 1, *grid.shape[1:]), *(state.shape for state in self._states.values())]
        for answer, shape in zip((picture, *states), shapes, strict=True):
            if getattr(answer, "shape", None) != shape or answer.dtype != np.float32:
                got = f"{getattr(answer, 'dtype', type(answer).__name__)} {list(getattr(answer, 'shape', []))}"
                raise bad_input(self._path, "answer", got, f"float32 {list(shape)}")
            if not np.isfinite(answer).all():
                value = answer[~np.isfinite(answer)][0]
                raise bad_input(self._path, "answer", str(value), "finite numbers")
        self._states = dict(zip(self._states, states, strict=True))
        return np.clip(picture[0, 0, :height, :width].astype(np.float64), 0, 1)


def network_bytes(path: Path) -> bytes:
    """The model, loaded from memory, so that what is checked is what runs. Raises PecsInputError for one that names
    other files: weights that lie outside of it have a key "location", and so do files in ORT's own format."""
    model = read_bytes(existing(path, "a network (.onnx)"), MOST_BYTES)
    if b"location" in model or model[4:8] == b"ORTM":
        raise bad_input(path, "", "weights in another file", "an ONNX file that contains its weights")
    return model


def _first_line(error: Exception) -> str:
    line = next(iter(str(error).splitlines()), type(error).__name__)
    return line if len(line) < 200 else line[:197] + "..."


def reconstruct(
    source: str | PathLike[str],
    output: str | PathLike[str],
    *,
    method: str = METHODS[0],
    weights: str | PathLike[str] | None = None,
    fps: float = 100.0,
    cutoff_hz: float | None = None,
    corner_hz: float | None = None,
    smooth: bool = False,
    playback_fps: float | None = None,
    size: tuple[int, int] | None = None,
    threads: int = 0,
    progress: Callable[[int], None] | None = None,
) -> dict[str, Any]:
    """A video of an event file, `fps` pictures per second of the recording, shown at `playback_fps` (fps if None).

    method: one of `METHODS`. weights: a network (.onnx); None: the one that PECS includes. cutoff_hz: of the filter;
    None: `CUTOFF_HZ`. corner_hz: of the photoreceptors in the mean light: each picture is `late_us` before the end of
    its window; None: at the end. smooth: the network also uses the events after a picture. size: width and height, for
    a file that does not say. progress: called with the number of pictures so far. Returns what was done.
    Raises PecsNotFoundError for missing files, PecsInputError for wrong ones, PecsOutputError.
    """
    source, output = Path(source), Path(output)
    chosen = _weights(method, weights, cutoff_hz, smooth)
    check_outputs([source, chosen], [output])
    with EventReader(source, size=size) as reader:
        width, height = reader.info["width"], reader.info["height"]
        if not width or not height:
            raise UsageError(f"{source}: the file does not state its size; pass --size WxH")
        network = Network(chosen, width, height, threads) if chosen else None
        make: Method = network or Filter(width, height, cutoff_hz or CUTOFF_HZ)
        length_us, late = 1e6 / fps, late_us(corner_hz)
        found, events, early = windows(reader, length_us, late), 0, math.ceil(late / length_us)
        first = next(found, None)  # a recording that has none leaves no unfinished video
        if first is None:
            raise PecsInputError(f"{source}: the file has no events")

        def counted() -> Iterator[Window]:
            nonlocal events
            for window in chain([first], found):
                events += len(window.events)
                yield window

        pictures = smoothed(network, counted(), length_us) if network and smooth else map(make, counted())
        with VideoWriter(output, width, height, playback_fps or fps) as video:
            for number, picture in enumerate(pictures):
                if number < early:  # of a time before the first event
                    continue
                video.write(np.round(255 * picture).astype(np.uint8))
                if progress:
                    progress(video.count)
            if not video.count:
                got = f"{number + 1} windows of {length_us:g} us"
                raise bad_input(source, "times", got, f"more than {late:.0f} us, by which events are late (--corner)")
            return {
                "source": str(source),
                "method": make.kind,
                "weights": str(chosen) if chosen else None,
                "pictures": video.count,
                "events": events,
                "width": width,
                "height": height,
                "fps": fps,
            }


def _weights(method: str, weights: str | PathLike[str] | None, cutoff_hz: float | None, smooth: bool) -> Path | None:
    """None: the filter."""
    if method not in METHODS:
        raise UsageError(f"method: got {method!r}, wanted one of {', '.join(METHODS)}")
    if method == "filter":
        if weights is not None:
            raise UsageError(f"--weights {weights}: the filter has no weights")
        if smooth:
            raise UsageError("--smooth: the filter uses no later events (--method network does)")
        return None
    if cutoff_hz is not None:
        raise UsageError(f"--cutoff {cutoff_hz:g}Hz: the network has no cutoff frequency (--method filter has one)")
    return WEIGHTS if weights is None else Path(weights)
