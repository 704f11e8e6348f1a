# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive steps: keyframes, the motion between them, and pictures between keyframes where motion does not explain the
light (docs/reference/motion.md).

A keyframe is complete when its layers are written, the light last; the interval after it is complete when its motion is
written, which follows the pictures between.

The light that is written is denoised. Decisions (what changed, which samples are shared, what is rendered between) are
made on the light as rendered: a denoiser's error has no known distribution, that of samples has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pecs
from pecs._progress import Line
from pecs.motion import CHANNELS, QUARTERS

from ..camera.light import Light
from ..camera.stage import Stage
from ..camera.tiles import (
    BLOCK_PX,
    TILE_PX,
    Box,
    at,
    box_of,
    boxes,
    changed_blocks,
    grown,
    of_blocks,
    part_boxes,
    pixels_of,
    tiles_of,
    tiles_with,
)
from ..output import Layer, Output, as_written
from ..scene.timeline import Instants, Timeline
from ..truth.surfaces import HitCache, SurfaceHits, Surfaces
from . import keyframes
from .judge import Judge

PLAN_SCALE = 0.25  # size of the pictures on which motion is measured for choosing keyframes, of the sensor's
SHARED = 2  # keyframes on each side whose samples are shared

# Rendering only what changed since the anchor
ANCHOR_EVERY = 64  # keyframes; at a cut, too
MAX_CHANGED = 0.7  # of the picture; beyond it the whole picture is rendered

# Motion as written: its files are a third as large as without rounding
MOTION_STEP_PX = 2.0**-10
DEPTH_BITS = 16  # of the 23 bits of a mantissa

# Sharing samples
SAME_DEPTH = 0.02  # relative difference of depth within which two hits are on one surface
SKY_M = 1e6  # depth of the sky: finite, so that it can be warped
ALMOST_ONE = 1 - 2.0**-20  # at 1 itself, pecs.carry returns the other keyframe unchanged

# Pictures between keyframes
ROUNDS = 4  # of growing the rendered tiles until they agree with the prediction at their border
UNCHANGED = 0.2  # of the tolerance; less is no change between the same samples of two instants
MAX_BETWEEN = 0.6  # of the picture; beyond it the whole picture is rendered
LAMP_PIXELS, LAMP_SHARE = 1000, 0.01  # pixels in which changes of lamps are compared; share of them that may be wrong
LAMP_TOLERANCE = 0.5  # of other changes: those of lamps are everywhere, and cost no render


@dataclass(frozen=True)
class Keyframes:
    """grid: the finest instants; keys: indices of the keyframes. With a period, the last interval ends at its end."""

    grid: Timeline
    keys: list[int]

    @classmethod
    def at(cls, grid: Timeline, times_ns: list[int]) -> Keyframes:
        """Raises KeyError for times that are not on the grid."""
        index = {t: i for i, t in enumerate(grid.times_ns)}
        return cls(grid, [index[t] for t in times_ns])

    @property
    def timeline(self) -> Timeline:
        return Timeline([self.grid.times_ns[k] for k in self.keys], self.grid.period_ns)

    @property
    def ends(self) -> list[int]:
        """Grid indices at which the intervals end."""
        return self.keys[1:] + ([len(self.grid.times_ns)] if self.grid.period_ns else [])

    def time_s(self, index: int) -> float:
        return self.grid.times_ns[self.keys[index]] * 1e-9

    def middle(self, count: int) -> Keyframes:
        """At most this many keyframes in the middle."""
        first = max(0, (len(self.keys) - count) // 2)
        keys = self.keys[first : first + count]
        times_ns = self.grid.times_ns[keys[0] : keys[-1] + 1]
        return Keyframes(Timeline(times_ns, None), [key - keys[0] for key in keys])


def choose_keyframes(stage: Stage, instants: Instants, progress: Line) -> Keyframes:
    scale = PLAN_SCALE / stage.subpixels
    paths = keyframes.Paths(Surfaces(stage, scale, name="plan_rays"), stage.set_time, scale * stage.subpixels)
    cameras = [stage.source.camera_at(t * 1e-9) for t in instants.grid.bounds_ns]
    cuts = [i for i in range(1, len(cameras)) if cameras[i] != cameras[i - 1]]
    return Keyframes(instants.grid, keyframes.choose(instants.grid, cuts, paths, instants.step_px, progress))


def _rounded(motion: np.ndarray) -> np.ndarray:
    """Rounds CHANNELS in place, and returns them."""
    unit = 1 << (23 - DEPTH_BITS)
    for name, plane in zip(CHANNELS, motion, strict=True):
        if name.removeprefix("back_") in ("z", "z_end"):
            bits = plane.view(np.int32)
            bits += unit // 2
            bits &= -unit
        else:
            np.rint(plane / MOTION_STEP_PX, out=plane)
            plane *= MOTION_STEP_PX
    return motion


class Adaptive:
    """Writes keyframes and intervals of a stack."""

    warm_up = 2 * SHARED  # frames until the caches are full

    def __init__(
        self,
        stage: Stage,
        keyframes: Keyframes,
        light: Light,
        layers: list[Layer],
        *,
        hits: HitCache,
        tolerance: float,
        output: Output,
    ):
        self._stage, self._keyframes, self._hits, self._output = stage, keyframes, hits, output
        self._motion = next(layer for layer in layers if layer.name == "motion")
        self._instant_layers = [layer for layer in layers if layer.at == "instant"]
        self._judge = Judge(stage.weights, tolerance, stage.subpixels)
        self._changes = ChangedParts(stage, light, hits, self._judge)
        self._grid_s = [t * 1e-9 for t in keyframes.grid.bounds_ns]
        self._between = Between(stage, light, self._judge, self._grid_s, output)
        self._cameras = [stage.source.camera_at(keyframes.time_s(i)) for i in range(len(keyframes.keys))]
        self._anchors: list[int] = []
        for i, camera in enumerate(self._cameras):
            begins = i % ANCHOR_EVERY == 0 or camera != self._cameras[i - 1]
            self._anchors.append(i if begins else self._anchors[-1])
        self._own: dict[int, Picture] = {}  # before samples are shared
        self._shared: dict[int, Picture] = {}
        hits.keep = 2 * SHARED + 2

    def is_written(self, index: int) -> bool:
        due = [*self._instant_layers, *([self._motion] if index < len(self._keyframes.ends) else [])]
        return self._output.has_layer("light", index) and all(one.is_written(self._output, index) for one in due)

    def write(self, index: int) -> None:
        keys, ends, output = self._keyframes.keys, self._keyframes.ends, self._output
        t_s = self._keyframes.time_s(index)
        for layer in self._instant_layers:
            if not layer.is_written(output, index):
                self._stage.set_time(t_s)
                layer.write(output, index, t_s)
        first = self.keyframe(index)
        if not output.has_layer("light", index):
            output.write_layer("light", index, self._judge.lit(first.written, self._stage.lamps.factors(t_s)))
        if index < len(ends):
            second = self.keyframe((index + 1) % len(keys))
            motion = _rounded(self._motion.render(t_s, self._grid_s[ends[index]]))
            ends_px = motion[[CHANNELS.index(name) for name in ("x_end", "y_end", "back_x_end", "back_y_end")]]
            path_px = float(np.nanmax(np.hypot(ends_px[::2], ends_px[1::2]), initial=0))
            carrier = pecs.Carrier(motion)
            self._between.refine(KeyframeInterval(index, keys[index], ends[index], first, second, carrier, path_px))
            output.write_layer("motion", index, motion)

    def keyframe(self, index: int) -> Picture:
        """A keyframe after sample sharing."""
        if index not in self._shared:
            self._shared[index] = self._share_samples(index)
            while len(self._shared) > 3:
                self._shared.pop(next(iter(self._shared)))
        return self._shared[index]

    def _share_samples(self, index: int) -> Picture:
        """Averages a keyframe with its neighbours, each warped to the keyframe's instant, where they show the same
        surface in the same light.

        All frames have the same seed, so noise stays where it is on the film while surfaces move: it averages out where
        something moves, and still parts stay bit-identical.
        """
        count, periodic = len(self._keyframes.keys), self._keyframes.grid.period_ns
        near = range(index - SHARED, index + SHARED + 1)
        near = [i % count if periodic else i for i in near]
        near = list(dict.fromkeys(i for i in near if 0 <= i < count and self._cameras[i] == self._cameras[index]))
        at_ends = {*range(SHARED), *range(count - SHARED, count)} if periodic else set()
        self._own = {i: own for i, own in self._own.items() if i in near or i in at_ends}
        time_s = self._keyframes.time_s
        for i in near:
            if i not in self._own:
                self._own[i] = self._changes.render(i, time_s(i), time_s(self._anchors[i]))
        if len(near) == 1:
            return self._own[index]
        hits = {i: self._hits.at(time_s(i)) for i in near}
        own, factors = self._own[index], self._stage.lamps.factors(time_s(index))
        neighbours = [(self._own[i].light, hits[i]) for i in near if i != index]
        shared = average_samples(own.light, hits[index], neighbours, self._hits.surfaces, self._judge, factors)
        bands = len(own.raw)
        return Picture(own.frame, shared[:bands], None if own.clean is None else shared[bands:])


@dataclass(frozen=True)
class Picture:
    """frame: as Light.fresh renders it, before diffraction. raw: its bands with diffraction. clean: the same after
    denoising, and the noise that is left (Judge.with_noise); None if nothing is denoised. Judge.lit gives each at the
    lamps' strengths of a time."""

    frame: np.ndarray
    raw: np.ndarray
    clean: np.ndarray | None

    @property
    def light(self) -> np.ndarray:
        """Raw and clean, one after the other."""
        return self.raw if self.clean is None else np.concatenate([self.raw, self.clean])

    @property
    def written(self) -> np.ndarray:
        return self.raw if self.clean is None else self.clean


class ChangedParts:
    """Renders a keyframe's light only where something moved since an earlier keyframe, the anchor, or where the light
    changed with it (a shadow, a reflection). Such changes are found at the border of what moved and by strips across
    the picture. The result does not depend on which keyframes were rendered before."""

    def __init__(self, stage: Stage, light: Light, hits: HitCache, judge: Judge):
        self._stage, self._light, self._hits, self._judge = stage, light, hits, judge
        self._anchor: tuple[float, np.ndarray, np.ndarray | None, Picture, SurfaceHits] | None = None

    def render(self, index: int, t_s: float, anchor_s: float) -> Picture:
        """Keyframe `index`. anchor_s: time of its anchor."""
        if self._anchor is None or self._anchor[0] != anchor_s:
            hits = self._hits.at(anchor_s)
            self._stage.set_time(anchor_s)
            still, still_clean = self._whole()
            self._anchor = anchor_s, still, still_clean, self._picture(still, still_clean), hits
        _, still, still_clean, anchor, before = self._anchor
        if t_s == anchor_s:
            return anchor
        now = self._hits.at(t_s)
        self._stage.set_time(t_s)
        factors = self._stage.factors
        same = self._judge.lit(self._light.first_half(still), factors)
        changed = self._judge.strips_differing(
            self._stage, self._light, index, lambda bands: self._judge.photocurrent(same, bands)
        )
        frame = still.copy()
        current = self._judge.photocurrent(self._judge.lit(self._light.bands_of(still), factors))
        surfaces = self._hits.surfaces
        moved = surfaces.moved(before, now.poses) | surfaces.moved(now, before.poses)
        more = grown(tiles_with(moved) | changed)
        done = np.zeros_like(more)
        while more.any():
            done |= more
            if done.mean() > MAX_CHANGED:
                return self._picture(*self._whole())
            self._light.refresh_tiles(frame, more)
            rendered = self._judge.lit(self._light.bands_of(frame), factors)
            differing = self._judge.differing_blocks(current, self._judge.photocurrent(rendered))
            more = of_blocks(grown(differing)) & ~done
        # Where no sample of a block changed, the anchor's values: still parts stay bit-identical.
        different = pixels_of(tiles_with((frame != still).any(0), BLOCK_PX), self._stage.size, BLOCK_PX)
        reached = grown(tiles_with(different))  # by diffraction
        raw, clean = anchor.raw.copy(), None if anchor.clean is None else anchor.clean.copy()
        for box, part in self._light.raw_parts(frame, self._light.filter_boxes(reached)):
            raw[at(box)] = part
        for box, part in self._light.clean_parts(frame, reached, still_clean, different):
            clean[at(box)] = self._judge.with_noise(part, factors)
        return Picture(frame, raw, clean)

    def _whole(self) -> tuple[np.ndarray, np.ndarray | None]:
        """The current instant: its frame, and this denoised, both before diffraction."""
        frame = self._light.fresh()
        return frame, self._light.clean(frame)

    def _picture(self, frame: np.ndarray, clean: np.ndarray | None) -> Picture:
        raw, factors = self._light.blur(self._light.bands_of(frame).copy()), self._stage.factors
        noisy = None if clean is None else self._judge.with_noise(self._light.blur(clean.copy()), factors)
        return Picture(frame, raw, noisy)


def average_samples(
    own: np.ndarray,
    hits: SurfaceHits,
    neighbours: list[tuple[np.ndarray, SurfaceHits]],
    surfaces: Surfaces,
    judge: Judge,
    factors: np.ndarray,
) -> np.ndarray:
    """Mean light [channels, height, width] of a keyframe and those parts of its neighbours that show the same light, at
    these strengths of lamps, in the first channels, those of Picture.raw; rounded as in the file."""
    more, count = np.zeros(own.shape), np.zeros(own.shape[1:], np.uint8)  # from neighbours
    centres = surfaces.centres()
    for light, there in neighbours:
        place = surfaces.place(there, hits.poses)
        moving = (place[:2] != centres).any(0)
        if not moving.any():
            continue
        box = _differing_part(moving | (own != light).any(0), place[:2, moving])
        here, move = own[at(box)], place[:2][at(box)] - centres[at(box)]
        warped, z = np.split(_warped(light[at(box)], there.depth[at(box)], move, place[2][at(box)]), [len(own)])
        depth = np.minimum(hits.depth[at(box)], SKY_M)
        same = np.isfinite(warped).all(0) & (np.abs(z[0] - depth) <= SAME_DEPTH * depth)
        current, other = (judge.photocurrent(judge.lit(one, factors)) for one in (here, warped))
        agree = judge.same_light(np.where(same, current, np.nan), np.where(same, other, np.nan))
        same &= pixels_of(agree, same.shape[::-1])
        more[at(box)][:, same] += warped[:, same]
        count[at(box)][same] += 1
    mean = own.copy()
    shared = count > 0
    mean[:, shared] = (own[:, shared] + more[:, shared]) / (1 + count[shared])
    return as_written(mean)


def _differing_part(different: np.ndarray, landed: np.ndarray) -> Box:
    """The box of tiles, and some more around them, that contains all different pixels [height, width] and the places
    [2, n] at which moving surface points land."""
    height, width = different.shape
    x, y = landed[:, np.isfinite(landed).all(0)]
    reached = different.copy()
    reached[np.clip(y, 0, height - 1).astype(int), np.clip(x, 0, width - 1).astype(int)] = True
    return boxes(grown(tiles_with(reached)), width, height, math.inf)[0]


def _warped(light: np.ndarray, depth: np.ndarray, move: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Light [channels, height, width] whose points at these depths move by `move` [2, height, width] to the depth z,
    warped; in a further channel z."""
    z = np.minimum(z, SKY_M)
    motion = np.full((len(CHANNELS), *z.shape), np.nan, np.float32)
    motion[: len(CHANNELS) // 2] = [*(part for q in QUARTERS for part in q * move), depth, z]
    bands = np.concatenate([light, z[None].astype(np.float32)])
    return pecs.carry(bands, bands, motion, ALMOST_ONE, side="first")


@dataclass
class KeyframeInterval:
    """Between keyframes `first` and `second` at grid indices `start` and `end`."""

    index: int
    start: int
    end: int
    first: Picture
    second: Picture
    carrier: pecs.Carrier
    path_px: float  # the longest of a surface point
    frame: np.ndarray | None = None  # of `first`, with what was rendered since in its place
    residual: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)  # pixels and ln(rendered / warped)
    lamps: np.ndarray | None = None  # [steps + 1, some pixels]: ln of light over that interpolated in time
    carried: tuple[pecs.CarriedLight, pecs.CarriedLight] | None = None  # Between._carried


class Between:
    """Renders pictures between two keyframes where motion does not explain the light.

    Both keyframes, warped along the motion to the interval's middle, must agree there (in photocurrent, by blocks of
    pixels, beyond noise). They must also agree with strips rendered in the middle: when a lamp flickers, both keyframes
    may agree and be wrong. Where they disagree, the middle is rendered; where that picture differs from the sensor's
    prediction, each half is treated in the same way, down to the grid's instants (docs/reference/motion.md).
    """

    def __init__(self, stage: Stage, light: Light, judge: Judge, grid_s: list[float], output: Output):
        self._stage, self._light, self._judge, self._grid_s, self._output = stage, light, judge, grid_s, output

    def refine(self, it: KeyframeInterval) -> None:
        if it.end - it.start > 1:
            it.frame = it.first.frame.copy()
            it.lamps = self._of_lamps(it) if self._stage.lamps.names else None
            self._halve(it, it.start, it.end, self._disagreeing(it) | self._probed(it))
            it.frame = it.carried = None

    def _fraction(self, it: KeyframeInterval, step: int) -> float:
        start_s, end_s = self._grid_s[it.start], self._grid_s[it.end]
        return (self._grid_s[step] - start_s) / (end_s - start_s)

    def _photocurrents(self, it: KeyframeInterval, step: int, bands: slice = slice(None)) -> list[np.ndarray]:
        """Of both keyframes, at a step's strengths of lamps."""
        factors = self._stage.lamps.factors(self._grid_s[step])
        return [self._judge.photocurrent(self._judge.lit(one.raw, factors), bands) for one in (it.first, it.second)]

    def _disagreeing(self, it: KeyframeInterval) -> np.ndarray:
        middle = (it.start + it.end) // 2
        (first, second), fraction = self._photocurrents(it, middle), self._fraction(it, middle)
        a, b = (pecs.CarriedLight(it.carrier, first, second, side).at(fraction) for side in ("first", "second"))
        nowhere = np.isnan(a) & np.isnan(b)
        a, b = np.where(nowhere, first, a), np.where(nowhere, second, b)
        return self._judge.differing(self._judge.interpolable(a, b, it.path_px), b)

    def _probed(self, it: KeyframeInterval) -> np.ndarray:
        middle = (it.start + it.end) // 2

        def warped(bands: slice) -> np.ndarray:
            return pecs.CarriedLight(it.carrier, *self._photocurrents(it, middle, bands)).at(self._fraction(it, middle))

        self._stage.set_time(self._grid_s[middle])
        return self._judge.strips_differing(self._stage, self._light, it.index, warped)

    def _of_lamps(self, it: KeyframeInterval) -> np.ndarray:
        """KeyframeInterval.lamps of the first keyframe's light."""
        steps = range(it.start, it.end + 1)
        some = it.first.raw.reshape(len(it.first.raw), 1, -1)[..., :: -(-it.first.raw[0].size // LAMP_PIXELS)]
        factors = [self._stage.lamps.factors(self._grid_s[step]) for step in steps]
        light = np.concatenate([self._judge.photocurrent(self._judge.lit(some, one)) for one in factors])
        light = light[:, light.any(0)]
        part = np.array([self._fraction(it, step) for step in steps])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(light / (light[0] + part * (light[-1] - light[0])))

    def _lamps_bend(self, it: KeyframeInterval, low: int, high: int) -> bool:
        """Whether lamps change the light between two rendered steps otherwise than linearly in ln(light)."""
        if it.lamps is None:
            return False
        own = it.lamps[low - it.start : high - it.start + 1]
        part = np.linspace(0, 1, len(own))[:, None]
        with np.errstate(invalid="ignore"):
            bend = np.abs(own - own[0] - part * (own[-1] - own[0])).max(0)
        followed = bend <= LAMP_TOLERANCE * self._judge.tolerance  # not where a lamp is off: NaN
        return np.count_nonzero(~followed) > LAMP_SHARE * followed.size

    def _carried(self, it: KeyframeInterval, step: int) -> tuple[pecs.CarriedLight, pecs.CarriedLight]:
        """Photocurrent and the light that is written, at a step's strengths of lamps."""
        if it.carried is None or self._stage.lamps.names:
            factors = self._stage.lamps.factors(self._grid_s[step])
            written = (self._judge.lit(one.written, factors) for one in (it.first, it.second))
            it.carried = (
                pecs.CarriedLight(it.carrier, *self._photocurrents(it, step)),
                pecs.CarriedLight(it.carrier, *written),
            )
        return it.carried

    def _change(self, it: KeyframeInterval, step: int) -> np.ndarray:
        """Rendered over warped photocurrent [height, width]: the residual interpolated between rendered pictures, as in
        the sensor's prediction if the lamps have constant strength."""
        out = np.ones(self._stage.size[::-1], np.float32)
        if not it.residual:
            return out
        before, after = np.zeros(out.size, np.float32), np.zeros(out.size, np.float32)
        since, until = np.zeros(out.size), np.zeros(out.size)  # s after the interval's start, before its end
        for node in sorted(it.residual):
            if node < step:
                where, before[where] = it.residual[node][0], it.residual[node][1]
                since[where] = self._grid_s[node] - self._grid_s[it.start]
        for node in sorted(it.residual, reverse=True):
            if node > step:
                where, after[where] = it.residual[node][0], it.residual[node][1]
                until[where] = self._grid_s[it.end] - self._grid_s[node]
        where = np.unique(np.concatenate([pixels for pixels, _ in it.residual.values()]))
        now_s, length_s = (self._grid_s[k] - self._grid_s[it.start] for k in (step, it.end))
        part = (now_s - since[where]) / (length_s - until[where] - since[where])
        out.ravel()[where] = np.exp(before[where] + part * (after[where] - before[where]))
        return out

    def _changed(self, it: KeyframeInterval, factors: np.ndarray, boxes_px: list[Box]) -> np.ndarray:
        """Pixels [height, width] of these boxes whose samples show another light than those of the first keyframe, and
        pixels around them."""
        blocks = np.zeros(tiles_of(*self._stage.size, BLOCK_PX), bool)
        for box in boxes_px:
            one, other = (
                self._judge.photocurrent(self._judge.lit(self._light.bands_of(frame)[at(box)], factors))
                for frame in (it.first.frame, it.frame)
            )
            blocks[at(box_of(box, BLOCK_PX))] = changed_blocks(one, other, UNCHANGED * self._judge.tolerance)
        return pixels_of(grown(blocks), self._stage.size, BLOCK_PX)

    def _halve(self, it: KeyframeInterval, low: int, high: int, wrong: np.ndarray) -> None:
        middle = (low + high) // 2
        bends = self._lamps_bend(it, low, high)
        if middle == low or not (wrong.any() or bends):
            return
        judge, size, denoised = self._judge, self._stage.size, it.first.clean is not None
        fraction, change, (carried, carried_written) = (
            of(it, middle) for of in (self._fraction, self._change, self._carried)
        )
        self._stage.set_time(self._grid_s[middle])
        factors = self._stage.factors
        warped, predicted = np.zeros((2, *size[::-1]), np.float32)  # where needed
        current, halves = np.full((2, *size[::-1]), np.nan, np.float32)
        light = np.full((len(judge.weights) + denoised, *size[::-1]), np.nan, np.float32)
        expected = np.zeros_like(light)  # where needed

        def expect(box: Box) -> np.ndarray:
            carried_written.at(fraction, [box], expected)
            expected[: len(judge.weights)][at(box)] *= change[at(box)]
            return expected[at(box)]

        if bends:  # motion and lamps give the light elsewhere; without lamps, the sensor computes the same
            light[:] = expect((0, 0, *size))

        # Render the wrong tiles, growing until the new picture agrees with the prediction at its border.
        more, done = wrong, np.zeros_like(wrong)
        for _ in range(ROUNDS):
            if not more.any():
                break
            if (done | more).mean() > MAX_BETWEEN:
                more = ~done
            found = self._light.refresh_tiles(it.frame, more, around=True)
            for box, part in self._light.raw_parts(it.frame, found):
                part = judge.lit(part, factors)
                current[at(box)] = judge.photocurrent(part)
                if denoised:
                    of = judge.lit(self._light.halves_of(it.frame)[at(box)], factors)
                    halves[at(box)] = judge.photocurrent(of)
                else:
                    light[at(box)] = part
                done[at(box_of(box, TILE_PX))] = True
            near = part_boxes(grown(done), *size)
            carried.at(fraction, near, warped)
            for box in near:
                predicted[at(box)] = warped[at(box)] * change[at(box)]
            differing = judge.differing_in(near, predicted, current, halves if denoised else None)
            wrong, more = of_blocks(differing), of_blocks(grown(differing)) & ~done
        known = np.isfinite(current)
        if denoised:
            # Where nothing changed, the keyframe's: a denoiser gives other values for a part of the picture.
            parts = part_boxes(done, *size)
            changed = known & self._changed(it, factors, parts)
            for box in parts:
                still = known[at(box)] & ~changed[at(box)]
                light[at(box)] = np.where(still, judge.lit(it.first.written[at(box)], factors), light[at(box)])
            around = it.frame[: 2 * len(it.first.raw)]
            for box, part in self._light.clean_parts(it.frame, tiles_with(changed), around):
                rendered = judge.lit(judge.with_noise(part, factors), factors)
                light[at(box)] = np.where(changed[at(box)], judge.mixed(expect(box), rendered), light[at(box)])
        self._output.write_between(it.index, middle - it.start, round(self._grid_s[middle] * 1e9), light)

        where = np.flatnonzero(known)
        with np.errstate(divide="ignore", invalid="ignore"):
            residual = np.log(current.ravel()[where] / warped.ravel()[where])
        defined = ~np.isnan(residual)
        it.residual[middle] = where[defined], np.where(np.isinf(residual), 0, residual)[defined]
        self._halve(it, low, middle, wrong)
        self._halve(it, middle, high, wrong)
