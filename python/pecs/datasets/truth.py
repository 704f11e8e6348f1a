"""Ground truth of one camera at its instants: an EXR stack without light (docs/reference/exr_stack.md), and
objects.json."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._config import Fields
from .._errors import bad_input, existing
from .._text import is_plain
from ..motion import CHANNELS, displacement_weights, velocity_weights
from ..stack import StackReader
from ._bilinear import bilinear, on_surface
from .files import read_object

BOX_DTYPE = np.dtype(
    [("id", "<u4"), ("class_id", "<u4")]
    + [(name, "<f8") for name in ("x0", "y0", "x1", "y1")]  # what is seen of it; NaN when nothing
    + [(name, "<f8") for name in ("amodal_x0", "amodal_y0", "amodal_x1", "amodal_y1")]
    + [("visible_px", "<i8"), ("occluded", "<f8"), ("truncated", "<f8")]
)
# Classes of surfaces without an extent of their own: they have masks, and no boxes (Cityscapes' and COCO's "stuff").
STUFF = frozenset(
    "building ceiling fence floor grass ground lane_mark mountain pavement road sand sea sidewalk sky terrain".split()
    + ["vegetation", "wall", "water"]
)
_SAME_DEPTH = 0.01  # relative difference of depths of one surface
_LARGEST_ID = 1 << 16  # ids per event are u2
_KEPT = 4  # layers: those of one instant and its flow


class Truth:
    """Ground truth of a camera: depth, normals, objects and flow, in images [H, W] of the camera's own, distorted
    pixels.

    Index i is an instant; of flow, the interval from i to i + 1.
    """

    def __init__(self, folder: Path, width: int, height: int):
        self.folder = folder
        self.shape = height, width
        existing(folder / "stack.json", "ground truth")

    @cached_property
    def _read(self) -> dict[tuple[str, int], NDArray[np.float32]]:
        """The layers that were read last, by name and index."""
        return {}

    def __getstate__(self) -> dict[str, Any]:  # what was read is read again
        return {"folder": self.folder, "shape": self.shape}

    @cached_property
    def _stack(self) -> StackReader:
        stack = StackReader(self.folder)
        size = stack.info["height"], stack.info["width"]
        if size != self.shape or stack.shape[1:] != self.shape:
            raise bad_input(
                self.folder / "stack.json", "size in samples", stack.shape[1:], f"{self.shape}, one sample a pixel"
            )
        return stack

    @cached_property
    def times_us(self) -> NDArray[np.float64]:
        """[n], times of the instants [us]."""
        return np.array(self._stack.info["times_ns"], np.float64) / 1e3

    def __len__(self) -> int:
        return len(self.times_us)

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers: "depth", "normal", "objects", "motion", …"""
        return tuple(layer["name"] for layer in self._stack.layers if layer["name"] != "light")

    def depth(self, i: int) -> NDArray[np.float32]:
        """Depth at the pixels' centres, [2, H, W] in m: distance along the chief ray, and z along the optical axis; inf
        where there is no surface."""
        return self.layer("depth", i, ("distance", "z"))

    def normal(self, i: int) -> NDArray[np.float32]:
        """Normals at the pixels' centres, [3, H, W] in the axes of the camera; 0 where there is no surface."""
        return self.layer("normal", i)

    def instances(self, i: int) -> NDArray[np.int64]:
        """Objects at the pixels' centres, [H, W] ids of `objects`; 0: none."""
        (values,) = self.layer("objects", i, ("instance",))
        whole = np.rint(values)
        bad = ~((whole == values) & (0 <= whole) & (whole < _LARGEST_ID))
        if bad.any():
            y, x = np.argwhere(bad)[0]
            raise bad_input(
                self.folder, f"objects {i}: pixel ({x}, {y})", float(values[y, x]), f"an integer below {_LARGEST_ID}"
            )
        return whole.astype(np.int64)

    def flow(self, i: int, to: int | None = None) -> NDArray[np.float32]:
        """Optical flow of the surface points at the pixels' centres from instant i to instant `to`, also an earlier one
        (default: the next): [H, W, 2], x and y [pixels]; NaN: unknown.

        Flows of several intervals are joined: interpolated between pixels, and NaN where another object hides the point
        at an instant on the way.
        """
        to = i + 1 if to is None else to
        if to == i:
            raise IndexError(f"{self.folder}: flow from {i}: got to {to}, wanted another instant")
        *_, out = self._flows(i, to)
        return out

    def _flows(self, i: int, to: int) -> Iterator[NDArray[np.float32]]:
        """From instant i to each following one up to `to`."""
        step = 1 if to > i else -1
        out = self._one_flow(i, step)
        yield out
        ids = self.instances(i) if abs(to - i) > 1 and "objects" in self.layers else None
        for k in range(i + step, to, step):
            there = None if ids is None else self.instances(k)
            out = out + _follow(self._one_flow(k, step), out, ids, there)
            yield out

    def _one_flow(self, i: int, step: int) -> NDArray[np.float32]:
        """From instant i to its neighbour."""
        names = ("x_end", "y_end") if step > 0 else ("back_x_end", "back_y_end")
        return np.moveaxis(self.layer("motion", i if step > 0 else i - 1, names), 0, -1)

    def flow_back(self, i: int) -> NDArray[np.float32]:
        """Backward flow, `flow(i + 1, i)`: [H, W, 2], x and y [pixels]; NaN: unknown."""
        return self._one_flow(i + 1, -1)

    def visible_at(self, i: int, to: int | None = None) -> NDArray[np.bool_]:
        """Pixels [H, W] whose surface point is also visible at instant `to` (default: the next) and at those on the
        way: the mask of pixels that two images can match. False where the flow is unknown.

        The flow ends inside the image, and a pixel within 3/4 pixel of its end in x and y has its depth or more.
        """
        to = i + 1 if to is None else to
        if to == i:
            raise IndexError(f"{self.folder}: visible at {i}: got to {to}, wanted another instant")
        step = 1 if to > i else -1
        out = self._visible_next(i, step)
        between = range(i + step, to, step)
        for k, flow in zip(between, self._flows(i, to - step) if between else (), strict=True):
            y, x = np.nonzero(out)
            at = np.rint(np.stack([x, y], -1) + np.nan_to_num(flow[y, x], nan=-1e6)).astype(int)
            inside = (at >= 0).all(-1) & (at < self.shape[::-1]).all(-1)
            there = np.clip(at, 0, np.array(self.shape[::-1]) - 1)
            out[y, x] = inside & self._visible_next(k, step)[there[:, 1], there[:, 0]]
        return out

    def _visible_next(self, i: int, step: int) -> NDArray[np.bool_]:
        """As `visible_at`, at the neighbour of instant i."""
        names = ("x_end", "y_end", "z_end") if step > 0 else ("back_x_end", "back_y_end", "back_z_end")
        x, y, z = self.layer("motion", i if step > 0 else i - 1, names).astype(np.float64)
        height, width = self.shape
        at = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1) + np.stack([x, y], -1)
        return self.shows(i + step, at, z)

    def shows(self, i: int, at: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points are visible at an instant: inside the image, and a pixel within 3/4 pixel in x and y has their
        depth or more. `at` [..., 2]: x and y [pixels], the first pixel's centre is at 0; z [...]: depths along the
        optical axis [m]."""
        height, width = self.shape
        inside = np.isfinite(at).all(-1) & (at > -0.5).all(-1) & (at < [width - 0.5, height - 0.5]).all(-1)
        at = np.where(inside[..., None], at, 0)
        around = np.stack([np.floor(at + 0.25), np.ceil(at - 0.25)]).astype(int)
        columns, rows = np.clip(around[..., 0], 0, width - 1), np.clip(around[..., 1], 0, height - 1)
        there = self.depth(i)[1].astype(np.float64)
        deepest = np.max([there[row, column] for row in rows for column in columns], axis=0)
        return inside & ((z <= deepest * (1 + _SAME_DEPTH)) | np.isinf(deepest))

    def velocity(self, i: int) -> NDArray[np.float32]:
        """Velocity of the surface points at the pixels' centres on the path of `motion`, [H, W, 2] in pixels per
        second; NaN: unknown."""
        moves, seconds = self._path(i, forward=i + 1 < len(self))
        return (velocity_weights(0) @ moves / seconds).astype(np.float32)

    def _path(self, i: int, forward: bool) -> tuple[NDArray[np.float32], float]:
        """Motion from instant i [H, W, 4, 2]: displacements after each quarter of the interval after it (or before it,
        if not `forward`); and the interval's length in s, negative if not `forward`."""
        first, start = (0, i) if forward else (len(CHANNELS) // 2, i - 1)
        moves = np.moveaxis(self.layer("motion", start, CHANNELS[first : first + 8]), 0, -1).reshape(*self.shape, 4, 2)
        return moves, (self.times_us[start + 1] - self.times_us[start]) * (1e-6 if forward else -1e-6)

    def velocity_at(self, t_us: float) -> NDArray[np.float32]:
        """Velocity at any time between the first instant and the last, [H, W, 2] in pixels per second; NaN: unknown.

        The points of the nearest instant are moved along their paths. Pixels to which no point comes (at edges) have
        the velocity of the pixel at that instant.
        """
        if not self.times_us[0] - 1 <= t_us <= self.times_us[-1] + 1:
            raise IndexError(f"{self.folder}: velocity at {t_us} us: got {self.times_us[[0, -1]]} us of truth")
        i = int(np.abs(self.times_us - t_us).argmin())
        at_instant = self.velocity(i)
        if abs(self.times_us[i] - t_us) <= 1:
            return at_instant
        moves, seconds = self._path(i, forward=t_us > self.times_us[i])
        moves = moves.astype(np.float64)
        s = (t_us - self.times_us[i]) * 1e-6 / seconds
        moved, velocity = displacement_weights(s) @ moves, velocity_weights(s) @ moves / seconds
        height, width = self.shape
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float64)
        source = grid
        for _ in range(12):  # converges where neighbours move alike
            source = grid - np.nan_to_num(bilinear(moved, source))
        with np.errstate(invalid="ignore"):
            comes = np.abs(source + bilinear(moved, source) - grid).max(-1, keepdims=True) < 0.05
        return np.where(comes, bilinear(velocity, source), at_instant).astype(np.float32)

    def motion(self, i: int) -> NDArray[np.float32]:
        """The layer `motion` [20, H, W] of the interval from i to i + 1, as `pecs.carry` takes it."""
        return self.layer("motion", i)

    def layer(self, name: str, i: int, wanted: tuple[str, ...] | None = None) -> NDArray[np.float32]:
        """Read a layer of `layers` at an instant or interval: its channels, or those that are `wanted`, [channels, H,
        W]. Raises IndexError if there is no such instant or interval."""
        layer = next((layer for layer in self._stack.layers if layer["name"] == name), None)
        if layer is None:
            raise bad_input(self.folder / "stack.json", "layers", self.layers, f"a layer {name!r}")
        count = len(self) - (layer["at"] == "interval")
        if not 0 <= i < count:
            raise IndexError(f"{self.folder}: {name} {i}: got {count} of them")
        missing = set(wanted or ()) - set(layer["channels"])
        if missing:
            raise bad_input(
                self.folder / "stack.json", f"layer {name}: channels", layer["channels"], ", ".join(sorted(missing))
            )
        values = self._read.get((name, i))
        if values is None:
            values = self._read[name, i] = self._stack.read_layer(name, i)
            if len(self._read) > _KEPT:
                self._read.pop(next(iter(self._read)))
        return values[[layer["channels"].index(c) for c in wanted]] if wanted else values.copy()

    @cached_property
    def _json(self) -> dict[str, Any]:
        path = self.folder / "objects.json"
        top = Fields(read_object(path, "the objects of the ground truth"), path)
        if top.integer("format") != 1:
            raise top.wrong("format", "1")
        classes = {}
        for key, name in top.table("classes").content.items():
            if not key.isdecimal() or not 0 < int(key) < _LARGEST_ID or not isinstance(name, str) or not is_plain(name):
                raise top.wrong("classes", "names by positive ids")
            classes[int(key)] = name
        known = {}
        for entry in top.tables("objects"):
            number, class_id = entry.integer("id", low=1), entry.integer("class_id")
            if number in known or number >= _LARGEST_ID:
                raise entry.wrong("id", f"an id below {_LARGEST_ID} that no other object has")
            if class_id and class_id not in classes:
                raise entry.wrong("class_id", "0 or an id of `classes`")
            entry.text("name"), entry.array("size_m", 3)
            known[number] = entry.content
        instants = top.tables("instants")
        if [entry.integer("t_ns") for entry in instants] != list(self._stack.info["times_ns"]):
            raise bad_input(path, "instants", len(instants), f"the {len(self)} times of stack.json")
        return {"classes": classes, "objects": known, "instants": instants}

    @property
    def classes(self) -> dict[int, str]:
        """Names of the classes by id."""
        return dict(self._json["classes"])

    @property
    def objects(self) -> list[dict[str, Any]]:
        """Content of objects.json: `id`, `name`, `class`, `class_id`, `size_m`, `centre_local` of each object."""
        return list(self._json["objects"].values())

    @cached_property
    def deforming(self) -> set[int]:
        """Ids of objects whose shape changes: their instants have a size of their own."""
        instants = (entry.tables("objects") for entry in self._json["instants"])
        return {entry.integer("id") for entries in instants for entry in entries if "size_m" in entry.content}

    def _instant(self, i: int) -> list[Fields]:
        if not 0 <= i < len(self):
            raise IndexError(f"{self.folder}: instant {i}: got {len(self)} of them")
        entries: list[Fields] = self._json["instants"][i].tables("objects")
        for entry in entries:
            if entry.integer("id", low=1) not in self._json["objects"]:
                raise entry.wrong("id", "an id of `objects`")
        return entries

    def boxes(self, i: int) -> NDArray[Any]:
        """Boxes of the objects, one row of `BOX_DTYPE` per object, in pixels. Pixel i covers i to i + 1.

        `x0` to `y1`: the visible part; `amodal_x0` to `amodal_y1`: all of it, also hidden and outside the image.
        `occluded`: share of its silhouette in the image that others hide; `truncated`: share of its amodal box outside.
        """
        entries = self._instant(i)
        out = np.zeros(len(entries), BOX_DTYPE)
        for row, entry in zip(out, entries, strict=True):
            row["id"] = entry.integer("id")
            row["class_id"] = self._json["objects"][entry.integer("id")]["class_id"]
            seen = [np.nan] * 4 if entry.content.get("box_px") is None else entry.array("box_px", 4)
            amodal = [np.nan] * 4 if entry.content.get("amodal_px") is None else entry.array("amodal_px", 4)
            for name, value in zip(BOX_DTYPE.names[2:10], [*seen, *amodal], strict=True):
                row[name] = value
            row["visible_px"] = entry.integer("visible_px")
            row["occluded"], row["truncated"] = entry.number("occluded", low=0), entry.number("truncated", low=0)
        return out

    def object_poses(self, i: int) -> dict[int, NDArray[np.float64]]:
        """Poses world_from_object [4, 4] of the objects by id, without scale."""
        return {entry.integer("id"): entry.array("world_from_object", 4, 4) for entry in self._instant(i)}


def _follow(
    flow: NDArray[np.float32], moved: NDArray[np.float32], ids: NDArray[Any] | None, there: NDArray[Any] | None
) -> NDArray[np.float32]:
    """The next interval's flow at where pixels have moved to [H, W, 2]: bilinear, NaN outside, and where the nearest
    pixel there sees another object. Where the four pixels around see several things the nearest one counts."""
    height, width = flow.shape[:2]
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1)
    at = grid + moved.astype(np.float64)
    known = np.isfinite(at).all(-1) & (at >= 0).all(-1) & (at <= [width - 1, height - 1]).all(-1)
    at = np.where(known[..., None], at, 0)
    if ids is not None and there is not None:
        known &= np.rint(on_surface(there[..., None], at, there)[..., 0]) == ids
    return np.where(known[..., None], on_surface(flow, at, there), np.nan).astype(np.float32)
