"""Windows of events with what is true of them: a map-style data set for PyTorch's DataLoader and tonic's transforms.

    data = pecs.datasets.Windows(pecs.datasets.sequences("SET", "train"), window_us=50_000, fields=("flow", "boxes"))
    item = data[0]   # {"events", "start_us", "end_us", "sequence", "camera", "flow", "flow_us", "boxes", "truth_us"}

    data = pecs.datasets.Windows(data.sequences, voxel_grid={"bins": 5, "normalise": True}, keep_events=False)
    loader = torch.utils.data.DataLoader(data, 8, shuffle=True, num_workers=4, collate_fn=pecs.datasets.collate)
    frames = pecs.datasets.Windows(data.sequences, transform=tonic.transforms.ToFrame((346, 260, 2), n_time_bins=5))

It needs neither. An item reads its own events, found by the index of the file. It can be pickled and forked.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError, UsageError, optional_module
from ..representations import event_histogram, time_surface, voxel_grid
from .event_file import EventFile
from .files import read_picture
from .sequence import Camera, Sequence, frames_of

WINDOW_DTYPE = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "i1")])  # what PyTorch and tonic can take
FIELDS = ("flow", "visible", "depth", "instances", "boxes", "frame", "causes", "objects")
_PLANES = {"voxel_grid": voxel_grid, "time_surface": time_surface, "event_histogram": event_histogram}
_USUAL = 50_000  # us or events
_OPEN_FILES = 16  # of events, a process


class Windows:
    """Windows of events with ground truth, as a data set of PyTorch or an indexable list. Items are dicts of NumPy
    arrays.

    `events` is structured: t [us since the sequence's begin], x, y, p (1: ON). `fields` adds

    - flow: float32 [2, H, W] in pixels, from the truth's instant nearest to the window's begin to that nearest to its
    end
      (the next one, if they are the same); `flow_us` [2] are both times; NaN: unknown.
    - visible: bool [H, W], whether the point of `flow` is visible at both ends and at the truth's times between.
    - depth: float32 [2, H, W] in m, along the chief ray, and z; of the instant nearest to the end, `truth_us`.
    - instances: int32 [H, W]; boxes: `BOX_DTYPE`; of the same instant.
    - frame: uint8 [3, H, W], RGB, the image nearest to the end: a DAVIS's own, or of the RGB camera with its pixels;
      `frame_us` [2] is its exposure.
    - causes: uint8 [n]; objects: uint16 [n]; of the events, before `transform`.

    Parameters
    ----------
    sequences : Sequence or iterable of Sequence
        As in `pecs.datasets.sequences`.
    camera : str, optional
        Name of an event camera. Default: all.
    by : str
        "time" (default): whole windows of `window_us`, start <= t < end. "count": windows of `count` events.
    window_us : int
        Length [us]. Default 50000.
    step_us : int, optional
        Distance of windows [us]. Default: `window_us`.
    count : int
        Number of events. Default 50000.
    step : int, optional
        Distance of windows in events. Default: `count`.
    fields : iterable of str
        Names of the list above. Default: none.
    transform : callable, optional
        Called with the events; its result replaces them.
    voxel_grid, time_surface, event_histogram : dict, optional
        Arguments of the function of `pecs` of that name; the item contains its result under that name.
    keep_events : bool
        Whether items contain `events`. Default True.

    Raises
    ------
    PecsInputError
        An option is wrong, or a camera does not have a field.
    """

    def __init__(
        self,
        sequences: Sequence | Iterable[Sequence],
        camera: str | None = None,
        *,
        by: str = "time",
        window_us: int | None = None,
        step_us: int | None = None,
        count: int | None = None,
        step: int | None = None,
        fields: Iterable[str] = (),
        transform: Callable[[NDArray[Any]], Any] | None = None,
        voxel_grid: Mapping[str, Any] | None = None,
        time_surface: Mapping[str, Any] | None = None,
        event_histogram: Mapping[str, Any] | None = None,
        keep_events: bool = True,
    ):
        self.sequences = [sequences] if isinstance(sequences, Sequence) else list(sequences)
        self.by, self.fields, self.transform, self.keep_events = by, tuple(fields), transform, keep_events
        planes = {"voxel_grid": voxel_grid, "time_surface": time_surface, "event_histogram": event_histogram}
        self.planes = {name: dict(options) for name, options in planes.items() if options is not None}
        sizes = {"time": {"window_us": window_us, "step_us": step_us}, "count": {"count": count, "step": step}}
        if by not in sizes:
            raise UsageError(f"windows: got by {by!r}, wanted 'time' or 'count'")
        size, step = sizes.pop(by).values()
        for other, options in sizes.items():
            if given := [name for name, value in options.items() if value is not None]:
                raise UsageError(f"windows: got by {by!r} and {', '.join(given)}, wanted by {other!r}")
        if transform and not keep_events:
            raise UsageError("windows: got a transform and keep_events False, wanted the events that it takes")
        self.size = _USUAL if size is None else size
        self.step = self.size if step is None else step
        if self.size < 1 or self.step < 1:
            raise UsageError(f"windows: got windows of {self.size} every {self.step}, wanted 1 or more")
        unknown = set(self.fields) - set(FIELDS)
        if unknown:
            raise UsageError(f"windows: fields: got {', '.join(sorted(unknown))}, wanted {', '.join(FIELDS)}")
        self.cameras: list[tuple[Sequence, Camera]] = [
            (sequence, c) for sequence in self.sequences for c in sequence.of_kind("events") if camera in (None, c.name)
        ]
        if not self.cameras:
            raise UsageError(f"windows: camera: got {camera!r}, which is no event camera of the sequences")
        for sequence, c in self.cameras:
            self._check(sequence, c)
        self._ends = [*accumulate(self._count(sequence, c) for sequence, c in self.cameras)]
        self._open: OrderedDict[int, EventFile] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_open": OrderedDict()}

    def _check(self, sequence: Sequence, camera: Camera) -> None:
        layers = camera.truth.layers if camera.has_truth else ()
        has = {
            "flow": "motion" in layers,
            "visible": {"motion", "depth"} <= set(layers),
            "depth": "depth" in layers,
            "instances": "objects" in layers,
            "boxes": camera.has_boxes,
            "frame": bool(frames_of(sequence, camera)),
            "causes": camera.has("causes"),
            "objects": camera.has("objects"),
        }
        missing = [field for field in self.fields if not has[field]]
        if missing:
            raise PecsInputError(
                f"{camera.folder}: got no {', '.join(missing)}, wanted fields that every camera of the windows has"
            )

    def _count(self, sequence: Sequence, camera: Camera) -> int:
        if self.by == "time":
            length = sequence.duration_us
        else:
            with camera.event_file() as events:
                length = len(events)
        return max(0, (length - self.size) // self.step + 1)

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: int) -> dict[str, Any]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"windows: got {index}, wanted less than {len(self)}")
        index %= len(self)
        which = bisect_right(self._ends, index)
        sequence, camera = self.cameras[which]
        begin = (index - (self._ends[which - 1] if which else 0)) * self.step
        events, start, end = self._events(which), begin, begin + self.size
        first, last = (events.index(start), events.index(end)) if self.by == "time" else (start, end)
        found = events.read(first, last)
        if self.by == "count":
            start, end = int(found["t"][0]), int(found["t"][-1])
        item: dict[str, Any] = {"start_us": start, "end_us": end, "sequence": sequence.name, "camera": camera.name}
        for name, options in self.planes.items():
            item[name] = _PLANES[name](found, camera.width, camera.height, begin_us=start, end_us=end, **options)
        if self.keep_events:
            window = np.asarray(found).astype(WINDOW_DTYPE)  # the same order of fields
            item["events"] = self.transform(window) if self.transform else window
        for name in ("causes", "objects"):
            if name in self.fields:
                item[name] = np.array(getattr(camera, name)()[first:last])
        self._add_truth(item, camera)
        if "frame" in self.fields:
            self._add_frame(item, sequence, camera)
        return item

    def _events(self, which: int) -> EventFile:
        file = self._open.pop(which, None) or self.cameras[which][1].event_file()
        self._open[which] = file
        if len(self._open) > _OPEN_FILES:
            self._open.popitem(last=False)[1].close()
        return file

    def _add_truth(self, item: dict[str, Any], camera: Camera) -> None:
        wanted = {"flow", "visible", "depth", "instances", "boxes"} & set(self.fields)
        if not wanted:
            return
        times = camera.truth.times_us
        i, j = (int(np.abs(times - t).argmin()) for t in (item["start_us"], item["end_us"]))
        item["truth_us"] = float(times[j])
        if "depth" in wanted:
            item["depth"] = camera.truth.depth(j)
        if "instances" in wanted:
            item["instances"] = camera.truth.instances(j).astype(np.int32)
        if "boxes" in wanted:
            item["boxes"] = camera.truth.boxes(j)
        i = min(i, len(times) - 2)
        j = max(j, i + 1)
        if "visible" in wanted:
            item["visible"] = camera.truth.visible_at(i, j)
        if "flow" in wanted:
            item["flow"] = np.ascontiguousarray(np.moveaxis(camera.truth.flow(i, j), -1, 0))
            item["flow_us"] = times[[i, j]]

    @staticmethod
    def _add_frame(item: dict[str, Any], sequence: Sequence, camera: Camera) -> None:
        frame = min(frames_of(sequence, camera), key=lambda f: abs(f.middle_us - item["end_us"]))
        item["frame"] = np.ascontiguousarray(np.moveaxis(read_picture(frame.path), -1, 0))
        item["frame_us"] = np.array([frame.start_us, frame.end_us], np.float64)


def collate(items: list[dict[str, Any]]) -> dict[str, Any]:
    """Join items of `Windows` to a batch of PyTorch tensors, for `collate_fn`.

    Images of one size are stacked. `events`: int64 [n, 5], columns item, t, x, y, p, of all items one after the other;
    `boxes`: float64 [m, 7], item, id, class_id, x0, y0, x1, y1; causes and objects follow the events. Results of a
    transform are stacked. Names are lists, times are tensors of one value per item.
    """
    torch = optional_module("torch", "PyTorch", "collate")
    out: dict[str, Any] = {}
    for name in items[0]:
        values = [item[name] for item in items]
        if name in ("causes", "objects"):
            out[name] = torch.from_numpy(np.concatenate(values).astype(np.int32))
        elif isinstance(values[0], np.ndarray) and values[0].dtype.names:
            columns = ("t", "x", "y", "p") if name == "events" else ("id", "class_id", "x0", "y0", "x1", "y1")
            dtype = np.int64 if name == "events" else np.float64
            rows = [
                np.stack([np.full(len(v), i, dtype), *(v[c].astype(dtype) for c in columns)], 1)
                for i, v in enumerate(values)
            ]
            out[name] = torch.from_numpy(np.concatenate(rows))
        elif isinstance(values[0], np.ndarray):
            out[name] = torch.from_numpy(np.stack(values))
        elif isinstance(values[0], str):
            out[name] = values
        elif torch.is_tensor(values[0]):
            out[name] = torch.stack(values)
        else:
            out[name] = torch.from_numpy(np.array(values))  # torch.tensor has 24 bits of a time
    return out
