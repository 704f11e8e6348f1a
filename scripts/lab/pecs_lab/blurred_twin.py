"""The scene and the path of a camera whose frames are all blurred by motion, from its frames and events: used by
scripts/studies/davis_frames.py. A pose is x, y [px] and turn of a frame against one of them."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.sparse.linalg import LinearOperator, cg

EDGE_PX, SLICE_US, ROUNDS = 60, 4000, 3
FINE_PX, FLOOR = 3, 6  # of a fixed pattern, and of a frame as a logarithm [grey value]
REACH_PX, SMOOTH, FOLLOW = 2, 1.5, 0.7  # of a slice's shift
# Of a deconvolution: weight of the frames around and of the prior; grey value below which noise is even; slopes of the
# first and the last weights; steps of each of the solves.
NEAR, POSES, PRIOR, DARK, STEEP, FLAT, SOLVES, STEPS, TINY = 0.3, 12, 0.01, 8, 0.1, 0.02, 4, 15, 1e-6


def without_pattern(frames):
    """Frames less what all of them have in the same pixels, while the picture moves."""
    fine = [f / np.maximum(cv2.GaussianBlur(f, (0, 0), FINE_PX), 2) for f in frames]
    pattern = np.clip(np.median(fine, 0), 0.7, 1.4).astype(np.float32)
    pattern[np.mean(frames, 0) < 2 * FLOOR] = 1
    return [f / pattern for f in frames]


def turn_of(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class BlurredTwin:
    frames: list  # grey values
    exposures_us: np.ndarray  # [frames, 2]
    events: dict  # t [us], x, y, p
    log_light: object  # of grey values

    def __post_init__(self):
        self.size = self.frames[0].shape
        self.middles_us = self.exposures_us.mean(1)
        self.t_us = np.arange(self.exposures_us[0, 0], self.exposures_us[-1, 1], SLICE_US) + SLICE_US / 2
        self.path = CubicSpline(self.middles_us, self._poses())(self.t_us)
        for _ in range(ROUNDS):
            self._refine()

    def _poses(self):
        height, width = self.size
        pictures = [np.log(np.maximum(f, FLOOR)) for f in self.frames]
        window = cv2.createHanningWindow((width, height), cv2.CV_32F)
        stop = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 300, 1e-7
        first = len(pictures) // 2
        found = {first: np.zeros(3)}
        for numbers in (range(first + 1, len(pictures)), range(first - 1, -1, -1)):
            m, last = np.eye(2, 3, dtype=np.float32), first
            for k in numbers:
                m[:, 2] += cv2.phaseCorrelate(pictures[last].copy(), pictures[k].copy(), window)[0]
                m = cv2.findTransformECC(pictures[first], pictures[k], m, cv2.MOTION_EUCLIDEAN, stop, None, 5)[1]
                found[k], last = np.array([m[0, 2], m[1, 2], np.arctan2(m[1, 0], m[0, 0])]), k
        return np.array([found[k] for k in range(len(pictures))])

    def pose(self, k, t_us):
        """At t_us, against frame k in the middle of its exposure."""
        now, then = (np.array([np.interp(t, self.t_us, c) for c in self.path.T]) for t in (t_us, self.middles_us[k]))
        return np.array([*(now[:2] - turn_of(now[2] - then[2]) @ then[:2]), now[2] - then[2]])

    def _from_texture(self, pose):
        turn = turn_of(pose[2])
        return np.c_[turn, pose[:2] - turn @ [EDGE_PX, EDGE_PX]]

    def view(self, texture, pose):
        m, how = cv2.invertAffineTransform(self._from_texture(pose)), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(texture, m, self.size[::-1], flags=how, borderMode=cv2.BORDER_REPLICATE)

    def blurred(self, texture, k, of):
        """Frame `of` from the texture of frame k."""
        return np.mean([self.view(texture, pose) for pose in self._exposed(k, of)], 0)

    def _exposed(self, k, of):
        return [self.pose(k, t) for t in np.linspace(*self.exposures_us[of], POSES + 2)[1:-1]]

    def texture(self, k):
        """Frame k, sharp: least squares along the path, with the frames around and the total variation of the
        logarithm (Rudin, Osher & Fatemi 1992) as prior, by weights that follow the slopes."""
        height, width = self.size
        inside = cv2.GaussianBlur(np.pad(np.ones((height - 16, width - 16), np.float32), 8), (0, 0), 4)
        larger, how = (width + 2 * EDGE_PX, height + 2 * EDGE_PX), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        weights = {i: 1 if i == k else NEAR for i in (k - 1, k, k + 1) if 0 <= i < len(self.frames)}
        weights = {i: (w * inside / (self.frames[i] + DARK)).astype(np.float32) for i, w in weights.items()}
        poses = [(i, self._from_texture(pose)) for i in weights for pose in self._exposed(k, i)]

        def spread(pictures):
            return np.sum([cv2.warpAffine(pictures[i] / POSES, pose, larger, flags=how) for i, pose in poses], 0)

        def applied(values):
            picture = values.reshape(larger[::-1]).astype(np.float32)
            out = spread({i: weights[i] * self.blurred(picture, k, i) for i in weights})
            for axis in (0, 1):
                slopes = np.pad(np.diff(picture, axis=axis) * stiff[axis], [(int(a == axis),) * 2 for a in (0, 1)])
                out -= np.diff(slopes, axis=axis)
            return (out + TINY * picture).ravel()

        wanted = spread({i: weights[i] * self.frames[i] for i in weights})
        out = cv2.copyMakeBorder(self.frames[k], *(EDGE_PX,) * 4, cv2.BORDER_REPLICATE)
        system = LinearOperator((out.size, out.size), applied, dtype=np.float32)
        for slope in (STEEP, *(FLAT,) * (SOLVES - 1)):
            stiff, level = [], out + DARK
            for axis in (0, 1):
                at = np.delete(level, 0, axis)
                stiff.append(PRIOR / (at * np.hypot(np.diff(out, axis=axis) / at, slope)))
            found, _ = cg(system, (wanted + TINY * out).ravel(), out.ravel(), rtol=1e-4, maxiter=STEPS)
            out = np.maximum(found.reshape(out.shape), 0.5).astype(np.float32)
        return out

    def _refine(self):
        """Moves the path to where a slice's events agree most with the slope of the light, in any direction."""
        shifts = np.full((len(self.t_us), 2), np.nan)
        first = np.searchsorted(self.events["t"], [*(self.t_us - SLICE_US / 2), np.inf])
        for k, (begin_us, end_us) in enumerate(self.exposures_us):
            texture = self.texture(k)
            for i in np.flatnonzero((self.t_us > begin_us) & (self.t_us < end_us)):
                y, x, p = (self.events[c][first[i] : first[i + 1]].astype(int) for c in "yxp")
                change = np.zeros(self.size, np.float32)
                np.add.at(change, (y, x), 2 * p - 1)
                shifts[i] = self._shift(change, self.view(texture, self.pose(k, self.t_us[i])))
        known = ~np.isnan(shifts[:, 0])
        for j in range(2):
            smooth = gaussian_filter1d(shifts[known, j], SMOOTH)
            self.path[:, j] += FOLLOW * np.interp(self.t_us, self.t_us[known], smooth)

    def _shift(self, change, seen):
        n = 8
        change = cv2.GaussianBlur(change, (0, 0), 1.2)[n:-n, n:-n].ravel()
        light = cv2.GaussianBlur(self.log_light(seen).astype(np.float32), (0, 0), 1)
        slopes = cv2.Sobel(light, cv2.CV_32F, 1, 0), cv2.Sobel(light, cv2.CV_32F, 0, 1)
        height, width = self.size
        reach = range(-REACH_PX, REACH_PX + 1)
        agrees = np.zeros((len(reach), len(reach)))
        for i, down in enumerate(reach):
            for j, right in enumerate(reach):
                both = [s[n - down : height - n - down, n - right : width - n - right].ravel() for s in slopes]
                squares = np.array([[float(a @ b) for b in both] for a in both]) + 1e-6 * np.eye(2)
                found = np.array([float(change @ s) for s in both])
                agrees[i, j] = found @ np.linalg.solve(squares, found)
        i, j = np.unravel_index(agrees.argmax(), agrees.shape)
        return _peak(agrees[i], j) - REACH_PX, _peak(agrees[:, j], i) - REACH_PX


def _peak(values, i):
    """The largest of values, between them."""
    if not 0 < i < len(values) - 1:
        return i
    bend = values[i - 1] - 2 * values[i] + values[i + 1]
    return i + (np.clip((values[i - 1] - values[i + 1]) / (2 * bend), -0.5, 0.5) if bend < 0 else 0)
