# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders pictures between two keyframes where motion does not explain the light (docs/reference/motion.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pecs

from ..camera.light import Light
from ..camera.stage import Stage
from ..camera.tiles import (
    BLOCK_PX,
    TILE_PX,
    Box,
    at,
    box_of,
    changed_blocks,
    grown,
    of_blocks,
    part_boxes,
    pixels_of,
    tiles_of,
    tiles_with,
)
from ..output import Output
from .changed import Picture
from .judge import Judge

ROUNDS = 4  # of growing the rendered tiles until they agree with the prediction at their border
UNCHANGED = 0.2  # of the tolerance; less is no change between the same samples of two instants
MAX_BETWEEN = 0.6  # of the picture; beyond it the whole picture is rendered
LAMP_PIXELS, LAMP_SHARE = 1000, 0.01  # pixels in which changes of lamps are compared; share of them that may be wrong
DARKEST_A = 1e-19  # photocurrent; less is as dark to the sensor, and has no ratio
LAMP_TOLERANCE = 0.5  # of other changes: those of lamps are everywhere, and cost no render

Carried = tuple[pecs.CarriedLight, pecs.CarriedLight]  # photocurrent, and light as it is written


@dataclass(frozen=True, kw_only=True)
class KeyframeInterval:
    """Between keyframes `first` and `second` at grid indices `start` and `end`. path_px: the longest of a surface
    point. still: pixels [height, width] in which both show what does not move."""

    index: int
    start: int
    end: int
    first: Picture
    second: Picture
    carrier: pecs.Carrier
    path_px: float
    still: np.ndarray


@dataclass(frozen=True)
class Correction:
    """Of warped photocurrent at a step, in these pixels (indices that increase), by pictures rendered before and after
    it. before, after: ln(rendered / warped) and warped photocurrent. part: of the time between the two."""

    pixels: np.ndarray
    before: tuple[np.ndarray, np.ndarray]
    after: tuple[np.ndarray, np.ndarray]
    part: np.ndarray

    def apply(self, warped: np.ndarray, box: Box, out: np.ndarray) -> np.ndarray:
        """Writes photocurrent as the sensor predicts it (Residuals::apply of sensor/src/light/moving_light.cpp) into a
        box of `out`, and returns `out`."""
        (left, top, right, bottom), width = box, warped.shape[1]
        out[at(box)] = np.maximum(warped[at(box)], DARKEST_A)
        some = np.arange(*np.searchsorted(self.pixels, (top * width, bottom * width)))
        column = self.pixels[some] % width
        some = some[(left <= column) & (column < right)]
        pixels, part = self.pixels[some], self.part[some]
        (r, w), (next_r, next_w) = ([one[some] for one in side] for side in (self.before, self.after))
        light = out.ravel()[pixels]
        w, next_w = np.maximum(w, DARKEST_A), np.maximum(next_w, DARKEST_A)
        rendered, next_rendered = w * np.exp(r), next_w * np.exp(next_r)
        least = np.minimum(rendered, next_rendered) * np.minimum(1, light / np.minimum(w, next_w))
        most = np.maximum(rendered, next_rendered) * np.maximum(1, light / np.maximum(w, next_w))
        out.ravel()[pixels] = np.clip(light * np.exp(r + part * (next_r - r)), least, most)
        return out


class Prediction:
    """Light at a step as the sensor predicts it: that of both keyframes, warped to the step and corrected. bands: of
    the light as it is written; shape: of all its channels. Arrays [height, width] of photocurrent are computed in the
    boxes of fill(): warped, without the correction, and photocurrent."""

    def __init__(self, fraction: float, correction: Correction, carried: Carried, bands: int, shape: tuple[int, ...]):
        self._fraction, self._correction, self._bands = fraction, correction, bands
        self._carried_current, self._carried_light = carried
        self._light = np.zeros(shape, np.float32)
        self.warped, self.photocurrent = np.zeros((2, *shape[1:]), np.float32)

    def fill(self, boxes_px: list[Box]) -> None:
        self._carried_current.at(self._fraction, boxes_px, self.warped)
        for box in boxes_px:
            self._correction.apply(self.warped, box, self.photocurrent)

    def light(self, box: Box) -> np.ndarray:
        """[channels, height, width] of a box, as it is written."""
        self._carried_light.at(self._fraction, [box], self._light)
        if self._correction.pixels.size:
            self.fill([box])
            warped = np.maximum(self.warped[at(box)], DARKEST_A)
            self._light[: self._bands][at(box)] *= self.photocurrent[at(box)] / warped
        return self._light[at(box)]


@dataclass(frozen=True)
class Rendered:
    """The rendered parts of a step, in the tiles `done`. current: photocurrent [height, width], NaN elsewhere.
    differing: blocks in which it differs from the prediction; wrong: tiles with such blocks."""

    current: np.ndarray
    done: np.ndarray
    differing: np.ndarray

    @property
    def wrong(self) -> np.ndarray:
        return of_blocks(self.differing)


@dataclass(frozen=True)
class PartialKeyframe:
    """differing: blocks whose light the whole keyframes do not explain. found: whether a sample of each pixel detected
    such blocks where no difference was expected."""

    picture: Picture
    differing: np.ndarray
    found: bool


class Between:
    """The pictures between two keyframes.

    Both keyframes, warped along the motion to the interval's middle, must agree there (in photocurrent, by blocks of
    pixels, beyond noise). They must also agree with one sample of each pixel in the middle: when a lamp flickers, or
    something comes out of hiding and hides again, both keyframes may agree and be wrong. Where they disagree, the
    middle is rendered; where that picture differs from the sensor's prediction, each half is treated in the same way,
    down to the grid's instants (docs/reference/motion.md).
    """

    def __init__(
        self, stage: Stage, light: Light, judge: Judge, output: Output, grid_s: list[float], interval: KeyframeInterval
    ):
        self._stage, self._light, self._judge, self._output, self._grid_s = stage, light, judge, output, grid_s
        self._interval = interval
        self._frame = interval.first.frame.copy()  # with what was rendered since in its place
        self._residuals: dict[int, tuple[np.ndarray, ...]] = {}  # by step: pixels, ln(rendered / warped), warped
        self._lamp_changes = self._changes_of_lamps() if stage.lamps.names else None
        self._last_carried: tuple[np.ndarray, Carried] | None = None  # strengths of lamps

    def refine(self) -> None:
        it = self._interval
        middle = (it.start + it.end) // 2
        self._halve(it.start, it.end, self._disagreeing(middle, self._sides(middle)), True)

    def keyframe(self, step: int, fast: np.ndarray, tiles: np.ndarray | None = None) -> PartialKeyframe:
        """The picture at a step, in which the fast tiles, what is hidden at both keyframes, and where motion does not
        explain the light are rendered. Lamps have constant strength. tiles: those that are known to be wrong, instead
        of the fast ones and where the keyframes disagree; a sample of each pixel finds more."""
        it, expected = self._interval, self._prediction(step)
        if tiles is None:
            known = self._unexplained(step, fast)
        else:
            known = tiles | tiles_with(np.isnan(self._sides(step)).all(0))
        glance, seen = self._look(step)
        light = expected.light((0, 0, *self._stage.size)).copy()
        raw = light
        if self._is_denoised:
            raw = pecs.CarriedLight(it.carrier, it.first.raw, it.second.raw).at(self._fraction(step))
        self._light.bands_of(self._frame)[:] = raw  # around what is rendered
        rendered = self._render_wrong(expected, known | seen, light)
        if self._is_denoised:
            self._merge_denoised(expected, rendered, light)
            for box, part in self._light.raw_parts(self._frame, part_boxes(rendered.done, *self._stage.size)):
                raw[at(box)] = part
        found = bool((seen & ~grown(grown(known | fast)) & rendered.wrong).any())
        picture = Picture(self._frame, raw, light if self._is_denoised else None, glance)
        return PartialKeyframe(picture, rendered.differing, found)

    def _halve(self, low: int, high: int, wrong: np.ndarray, looks: bool) -> None:
        """Renders the middle of two steps with known light where tiles are wrong, then halves both parts in turn.
        looks: whether a sample of each pixel finds more such tiles; also in the halves, if the rendered middle confirms
        some of them."""
        middle = (low + high) // 2
        if middle == low:
            return
        if looks:
            _, seen = self._look(middle)
            new, wrong = seen & ~grown(wrong), wrong | seen
        bends = self._lamps_bend(low, high)
        if not (wrong.any() or bends):
            return
        if not looks:  # a glance has moved the scene there
            self._stage.set_time(self._grid_s[middle])
        expected, size = self._prediction(middle), self._stage.size
        if bends:  # motion and lamps give the light elsewhere; without lamps, the sensor computes the same
            light = expected.light((0, 0, *size)).copy()
        else:
            light = np.full((self._channels, *size[::-1]), np.nan, np.float32)
        rendered = self._render_wrong(expected, wrong, light)
        if self._is_denoised:
            self._merge_denoised(expected, rendered, light)
        step = middle - self._interval.start
        self._output.write_between(self._interval.index, step, round(self._grid_s[middle] * 1e9), light)
        self._residuals[middle] = _residual(rendered.current, expected.warped)
        looks = looks and bool((new & rendered.wrong).any())
        self._halve(low, middle, rendered.wrong, looks)
        self._halve(middle, high, rendered.wrong, looks)

    def _render_wrong(self, expected: Prediction, wrong: np.ndarray, light: np.ndarray) -> Rendered:
        """Renders the wrong tiles, growing until the new picture agrees with the prediction at its border; into `light`
        if nothing is denoised."""
        judge, factors, size = self._judge, self._stage.factors, self._stage.size
        current, halves = np.full((2, *size[::-1]), np.nan, np.float32)
        more, done = wrong, np.zeros_like(wrong)
        differing = np.zeros(tiles_of(*size, BLOCK_PX), bool)
        for _ in range(ROUNDS):
            if not more.any():
                break
            if (done | more).mean() > MAX_BETWEEN:
                more = ~done
            boxes_px = self._light.refresh_tiles(self._frame, more, around=True)
            for box, part in self._light.raw_parts(self._frame, boxes_px):
                part = judge.lit(part, factors)
                current[at(box)] = judge.photocurrent(part)
                if self._is_denoised:
                    half = self._light.halves_of(self._frame)[at(box)]
                    halves[at(box)] = judge.photocurrent(half, factors=factors)
                else:
                    light[at(box)] = part
                done[at(box_of(box, TILE_PX))] = True
            near = part_boxes(grown(done), *size)
            expected.fill(near)
            compared = halves if self._is_denoised else None
            differing = judge.differing_in(near, self._interval.still, expected.photocurrent, current, compared)
            more = of_blocks(grown(differing)) & ~done
        return Rendered(current, done, differing)

    def _merge_denoised(self, expected: Prediction, rendered: Rendered, light: np.ndarray) -> None:
        """Writes the denoised light of the rendered pixels into `light`. Where nothing changed, it is the keyframe's: a
        denoiser gives other values for a part of the picture."""
        judge, factors, first = self._judge, self._stage.factors, self._interval.first
        known, parts = np.isfinite(rendered.current), part_boxes(rendered.done, *self._stage.size)
        changed = known & self._changed(parts)
        for box in parts:
            still = known[at(box)] & ~changed[at(box)]
            light[at(box)] = np.where(still, judge.lit(first.written[at(box)], factors), light[at(box)])
        around = self._frame[: 2 * len(first.raw)]
        for box, part in self._light.clean_parts(self._frame, tiles_with(changed), around):
            clean = judge.mixed(expected.light(box), judge.lit(judge.with_noise(part, factors), factors))
            light[at(box)] = np.where(changed[at(box)], clean, light[at(box)])

    def _changed(self, boxes_px: list[Box]) -> np.ndarray:
        """Pixels [height, width] of these boxes whose samples show another light than those of the first keyframe, and
        pixels around them."""
        blocks, judge = np.zeros(tiles_of(*self._stage.size, BLOCK_PX), bool), self._judge
        for box in boxes_px:
            one, other = (
                judge.photocurrent(self._light.bands_of(frame)[at(box)], factors=self._stage.factors)
                for frame in (self._interval.first.frame, self._frame)
            )
            blocks[at(box_of(box, BLOCK_PX))] = changed_blocks(one, other, UNCHANGED * judge.tolerance)
        return pixels_of(grown(blocks), self._stage.size, BLOCK_PX)

    @property
    def _is_denoised(self) -> bool:
        return self._interval.first.clean is not None

    @property
    def _channels(self) -> int:
        """Channels of the light as it is written."""
        return len(self._judge.weights) + self._is_denoised

    def _fraction(self, step: int) -> float:
        start_s, end_s = self._grid_s[self._interval.start], self._grid_s[self._interval.end]
        return (self._grid_s[step] - start_s) / (end_s - start_s)

    def _photocurrents(self, step: int, of: str = "raw") -> list[np.ndarray]:
        """Those of both keyframes, at a step's strengths of lamps. of: which light of Picture."""
        factors = self._factors(step)
        keyframes = self._interval.first, self._interval.second
        return [self._judge.photocurrent(getattr(one, of), factors) for one in keyframes]

    def _sides(self, step: int) -> np.ndarray:
        """[2, height, width]: photocurrent as each keyframe alone gives it, NaN where it does not show the surface."""
        current, _ = self._carried(step)
        return np.stack([current.at(self._fraction(step), side=side) for side in ("first", "second")])

    def _unexplained(self, step: int, fast: np.ndarray) -> np.ndarray:
        """The fast tiles, and those in which the keyframes differ at a step or both hide 3x3 pixels."""
        sides = self._sides(step)
        return fast | self._disagreeing(step, sides) | tiles_with(~grown(~np.isnan(sides).all(0)))

    def _disagreeing(self, step: int, sides: np.ndarray) -> np.ndarray:
        """Tiles in which a keyframe, warped to a step, differs from the mean of both. sides: as _sides returns them."""
        a, b = np.where(np.isnan(sides).all(0), self._photocurrents(step), sides)
        return self._judge.differing((self._judge.interpolable(a, b, self._interval.path_px) + b) / 2, b)

    def _look(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Moves the scene to a step. Its glance, and the tiles in which it differs from the keyframes' glances, as far
        as the step's light is known."""
        self._stage.set_time(self._grid_s[step])
        glance = self._light.glance()
        now, fraction = self._judge.photocurrent(glance, self._stage.factors), self._fraction(step)
        glances = pecs.CarriedLight(self._interval.carrier, *self._photocurrents(step, "glance"))
        warped = self._carried(step)[0].at(fraction)
        expected = self._correction(step).apply(warped, (0, 0, *self._stage.size), np.empty_like(warped))
        of_glances = glances.at(fraction) * (expected / np.maximum(warped, DARKEST_A))
        differing = [self._judge.glances_differ(one, now) for one in (of_glances, expected)]
        both = np.logical_and(*differing)  # noise of one sample seldom differs from both
        return glance, both | of_blocks(self._judge.same_samples_differ(self._interval.still, of_glances, now))

    def _changes_of_lamps(self) -> np.ndarray:
        """[steps + 1, some pixels]: ln of the first keyframe's light over that interpolated in time."""
        first, steps = self._interval.first, range(self._interval.start, self._interval.end + 1)
        some = first.raw.reshape(len(first.raw), 1, -1)[..., :: -(-first.raw[0].size // LAMP_PIXELS)]
        factors = [self._factors(step) for step in steps]
        light = np.concatenate([self._judge.photocurrent(some, factors=one) for one in factors])
        light = light[:, light.any(0)]
        part = np.array([self._fraction(step) for step in steps])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(light / (light[0] + part * (light[-1] - light[0])))

    def _lamps_bend(self, low: int, high: int) -> bool:
        """Whether lamps change the light between two rendered steps otherwise than linearly in ln(light)."""
        if self._lamp_changes is None:
            return False
        own = self._lamp_changes[low - self._interval.start : high - self._interval.start + 1]
        part = np.linspace(0, 1, len(own))[:, None]
        with np.errstate(invalid="ignore"):
            bend = np.abs(own - own[0] - part * (own[-1] - own[0])).max(0)
        followed = bend <= LAMP_TOLERANCE * self._judge.tolerance  # not where a lamp is off: NaN
        return np.count_nonzero(~followed) > LAMP_SHARE * followed.size

    def _prediction(self, step: int) -> Prediction:
        shape = self._channels, *self._stage.size[::-1]
        bands = len(self._judge.weights)
        return Prediction(self._fraction(step), self._correction(step), self._carried(step), bands, shape)

    def _carried(self, step: int) -> Carried:
        """At the step's strengths of lamps."""
        factors = self._factors(step)
        if self._last_carried is None or not np.array_equal(self._last_carried[0], factors):
            keyframes, carrier = (self._interval.first, self._interval.second), self._interval.carrier
            written = (self._judge.lit(one.written, factors) for one in keyframes)
            current = pecs.CarriedLight(carrier, *self._photocurrents(step))
            self._last_carried = factors, (current, pecs.CarriedLight(carrier, *written))
        return self._last_carried[1]

    def _correction(self, step: int) -> Correction:
        """Interpolated between rendered pictures, as in the sensor if the lamps have constant strength."""
        known, it, size = self._residuals, self._interval, self._stage.size
        pixels = np.unique(np.concatenate([where for where, *_ in known.values()])) if known else np.zeros(0, int)
        sides = []
        for end, keyframe, nodes in (
            (it.start, it.first, sorted(node for node in known if node < step)),
            (it.end, it.second, sorted((node for node in known if node > step), reverse=True)),
        ):
            light = keyframe.raw.reshape(len(keyframe.raw), 1, -1)[..., pixels]
            near = np.zeros((3, size[0] * size[1]), np.float32)  # part of the interval, ln(rendered / warped), warped
            near[0], near[2, pixels] = end == it.end, self._judge.photocurrent(light, self._factors(end))
            for node in nodes:
                where, *of_node = known[node]
                near[0, where], near[1:, where] = self._fraction(node), of_node
            sides.append(near[:, pixels])
        (since, *before), (until, *after) = sides
        return Correction(pixels, before, after, (self._fraction(step) - since) / (until - since))

    def _factors(self, step: int) -> np.ndarray:
        return self._stage.lamps.factors(self._grid_s[step])


def _residual(current: np.ndarray, warped: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels with a residual, ln(current / warped), 0 of a dark pixel among lit ones, which has too few samples, and
    warped there."""
    where = np.isfinite(current) & np.isfinite(warped)
    noisy = [(one <= DARKEST_A) & grown(grown(one > DARKEST_A)) for one in (current, warped)]
    current, warped = np.maximum(current, DARKEST_A), np.maximum(warped, DARKEST_A)
    with np.errstate(invalid="ignore"):
        ratio = np.log(current / warped)
    return np.flatnonzero(where), np.where(noisy[0] | noisy[1], 0, ratio)[where], warped[where]
