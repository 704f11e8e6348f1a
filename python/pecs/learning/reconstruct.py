"""Events of a file to pictures, window after window."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError, UsageError, bad_input, existing, optional_module
from .._files import check_outputs
from ..events import EVENT_DTYPE, EventReader
from ..representations import voxel_grid
from .filter import HighPass
from .video import Range, VideoWriter

NETWORK_FORMAT = "1"
STATE = "state"  # prefix of the names of a network's states
METHODS = ("filter", "firenet", "e2vid")
WEIGHTS = Path(__file__).with_name("firenet.onnx")  # the network that PECS includes; firenet.json records its training


@dataclass(frozen=True)
class Window:
    """Events with begin_us <= t < end_us."""

    begin_us: float
    end_us: float
    events: NDArray[np.void]


def windows(reader: EventReader, length_us: float) -> Iterator[Window]:
    """Consecutive windows, empty ones too, from the first event to the window of the last event."""
    kept: list[NDArray[np.void]] = []
    begin_us, number = None, 0
    for block in reader:
        events = np.asarray(block)
        if begin_us is None:
            begin_us = float(events["t"][0])
        while events["t"][-1] >= (end_us := begin_us + (number + 1) * length_us):
            cut = int(np.searchsorted(events["t"], end_us))
            yield Window(end_us - length_us, end_us, np.concatenate([*kept, events[:cut]]))
            kept, events, number = [], events[cut:], number + 1
        kept.append(events.copy())
    if begin_us is not None:
        begin_us += number * length_us
        yield Window(begin_us, begin_us + length_us, np.concatenate([np.empty(0, EVENT_DTYPE), *kept]))


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
    """A network as `pecs train` writes it: inputs `events` [1, bins, H, W] and its states, outputs `picture`
    [1, 1, H, W] and the next states."""

    def __init__(self, path: Path, width: int, height: int, threads: int = 0):
        existing(path, "a network (.onnx)")
        runtime = optional_module("onnxruntime", "onnxruntime", "a network", "learning")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = threads
        # Spinning threads slow down other processes.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        try:
            self._session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as e:  # ONNX Runtime raises many types
            raise PecsInputError(f"{path}: {str(e).splitlines()[0]}, wanted a network in ONNX") from None
        said = self._session.get_modelmeta().custom_metadata_map
        if said.get("pecs_network") != NETWORK_FORMAT:
            raise bad_input(
                path, "pecs_network", said.get("pecs_network"), f"{NETWORK_FORMAT}: a network of `pecs train`"
            )
        self.record: dict[str, Any] = json.loads(said["record"])
        config = self.record["network"]
        self.kind = str(config["kind"])
        self._bins, self._size = int(config["bins"]), (height, width)
        step = 2 ** int(config["levels"])
        self._pad = -height % step, -width % step
        self._states: dict[str, NDArray[np.float32]] = {}
        for entry in self._session.get_inputs():
            if entry.name.startswith(STATE):
                level = int(entry.name.rsplit("_", 1)[1])
                size = (n + more >> level for n, more in zip(self._size, self._pad, strict=True))
                self._states[entry.name] = np.zeros([1, entry.shape[1], *size], np.float32)

    def __call__(self, window: Window) -> NDArray[np.float64]:
        height, width = self._size
        ends = {"begin_us": window.begin_us, "end_us": window.end_us}
        grid = voxel_grid(window.events, width, height, self._bins, **ends, normalise=True)
        grid = np.pad(grid, ((0, 0), *((0, n) for n in self._pad)))
        picture, *states = self._session.run(None, {"events": grid[None], **self._states})
        self._states = dict(zip(self._states, states, strict=True))
        return np.clip(picture[0, 0, :height, :width].astype(np.float64), 0, 1)


def reconstruct(
    source: str | PathLike[str],
    output: str | PathLike[str],
    *,
    method: str | None = None,
    weights: str | PathLike[str] | None = None,
    fps: float = 50.0,
    cutoff_hz: float = 1.0,
    playback_fps: float | None = None,
    size: tuple[int, int] | None = None,
    threads: int = 0,
    progress: Callable[[int], None] | None = None,
) -> dict[str, Any]:
    """A video of an event file, `fps` pictures per second of the recording, shown at `playback_fps` (fps if None).

    method: one of `METHODS`; None: the network of `weights`, without them the filter, with its `cutoff_hz`. weights: a
    network (.onnx); None: for "firenet" the one that ships. size: width and height, for a file that does not
    say. progress: called with the number of pictures so far. Returns what was done.
    Raises PecsNotFoundError for missing files, PecsInputError for wrong ones, PecsOutputError.
    """
    source, output = Path(source), Path(output)
    chosen = _weights(method, weights)
    check_outputs([source, chosen], [output])
    with EventReader(source) as reader:
        width, height = size or (reader.info["width"], reader.info["height"])
        if not width or not height:
            raise UsageError(f"{source}: the file does not state its size; pass --size WxH")
        make: Method = Network(chosen, width, height, threads) if chosen else Filter(width, height, cutoff_hz)
        if isinstance(make, Network) and method not in (None, make.kind):
            raise bad_input(chosen or source, "network", make.kind, f"{method}, as --method says")
        events = 0
        with VideoWriter(output, width, height, playback_fps or fps) as video:
            for window in windows(reader, 1e6 / fps):
                _inside(source, window.events, width, height)
                events += len(window.events)
                video.write(np.round(255 * make(window)).astype(np.uint8))
                if progress:
                    progress(video.count)
            if not events:
                raise PecsInputError(f"{source}: the file has no events")
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


def _weights(method: str | None, weights: str | PathLike[str] | None) -> Path | None:
    """None: the filter."""
    if method not in (None, *METHODS):
        raise UsageError(f"method: got {method!r}, wanted one of {', '.join(METHODS)}")
    if method == "filter" and weights is not None:
        raise UsageError(f"--weights {weights}: the filter has no weights")
    if method == "e2vid" and weights is None:
        raise UsageError("--method e2vid requires --weights, a network of `pecs train --network e2vid`")
    if weights is not None:
        return Path(weights)
    return WEIGHTS if method == "firenet" else None


def _inside(source: Path, events: NDArray[np.void], width: int, height: int) -> None:
    outside = (events["x"] >= width) | (events["y"] >= height)
    if outside.any():
        bad = events[outside][0]
        raise bad_input(source, "pixel", (int(bad["x"]), int(bad["y"])), f"one of {width} x {height}")
