"""A scene whose light and motion are known at every instant: a textured ellipse that moves and turns before a textured
background that moves too. Pixels are box-filtered by supersampling."""

from dataclasses import dataclass

import numpy as np
from pecs.stack import StackWriter

from support.small_stacks import stack_json

PLACES = ("x_q1", "y_q1", "x_mid", "y_mid", "x_q3", "y_q3", "x_end", "y_end")
CHANNELS = [f"{side}{name}" for side in ("", "back_") for name in (*PLACES, "z", "z_end")]
LAYER = {"name": "motion", "files": "motion_%06d.exr", "channels": CHANNELS, "unit": "px, z in m", "at": "interval"}


def texture(x, y, seed, finest_px):
    """Positive light with detail down to `finest_px` a period."""
    rng = np.random.default_rng(seed)
    out = np.zeros(np.broadcast(x, y).shape)
    for period in np.geomspace(finest_px, 40, 9):
        angle, phase = rng.uniform(0, 2 * np.pi, 2)
        out += np.sin(2 * np.pi * (np.cos(angle) * x + np.sin(angle) * y) / period + phase)
    return np.exp(0.22 * out)


@dataclass
class Scene:
    """Positions in pixels, pixel centres at whole numbers; time from 0 to 1, the two keyframes."""

    width: int = 160
    height: int = 120
    step: tuple[float, float] = (8.0, 3.0)  # of the ellipse
    turn: float = 0.1  # rad
    background: tuple[float, float] = (0.0, 0.0)
    bright: float = 3.0  # ellipse to background
    finest_px: float = 6.0
    radii: tuple[float, float] = (30.0, 22.0)
    z: tuple[float, float] = (1.0, 2.0)
    samples: int = 16  # of a pixel, by axis

    def _to_ellipse(self, x, y, t):
        """Film to the ellipse's own coordinates."""
        angle = self.turn * t
        dx = x - (self.width / 2 - 4 + self.step[0] * (t - 0.5))
        dy = y - (self.height / 2 + 3 + self.step[1] * (t - 0.5))
        return np.cos(angle) * dx + np.sin(angle) * dy, -np.sin(angle) * dx + np.cos(angle) * dy

    def _from_ellipse(self, u, v, t):
        angle = self.turn * t
        x = np.cos(angle) * u - np.sin(angle) * v
        y = np.sin(angle) * u + np.cos(angle) * v
        return x + self.width / 2 - 4 + self.step[0] * (t - 0.5), y + self.height / 2 + 3 + self.step[1] * (t - 0.5)

    def _inside(self, u, v):
        return (u / self.radii[0]) ** 2 + (v / self.radii[1]) ** 2 < 1

    def _light(self, x, y, t):
        u, v = self._to_ellipse(x, y, t)
        front = self.bright * texture(u, v, 1, self.finest_px)
        back = texture(x - self.background[0] * t, y - self.background[1] * t, 2, self.finest_px)
        return np.where(self._inside(u, v), front, back)

    def frame(self, t):
        """[height, width]: means over the pixels."""
        fine = (np.arange(self.samples) + 0.5) / self.samples - 0.5
        total = np.zeros((self.height, self.width))
        y, x = np.mgrid[: self.height, : self.width].astype(float)
        for dy in fine:
            for dx in fine:
                total += self._light(x + dx, y + dy, t)
        return (total / self.samples**2).astype(np.float32)

    def _paths(self, t0, t1):
        y, x = np.mgrid[: self.height, : self.width].astype(float)
        u, v = self._to_ellipse(x, y, t0)
        front = self._inside(u, v)
        out = []
        for t in np.linspace(t0, t1, 5)[1:]:
            ex, ey = self._from_ellipse(u, v, t)
            out.append(np.where(front, ex - x, self.background[0] * (t - t0)))
            out.append(np.where(front, ey - y, self.background[1] * (t - t0)))
        z = np.where(front, self.z[0], self.z[1])
        return [*out, z, z]

    def motion(self):
        """[20, height, width], of the layer `motion`."""
        return np.array(self._paths(0.0, 1.0) + self._paths(1.0, 0.0), np.float32)


def write_stack(folder, frames, times_ns, motions=(), *, period_ns=None, subpixels=1, between=(), more=(), light=True):
    """A stack of frames [T, H, W] times 1e-3 (light False: only their size counts); motions: one per interval; between:
    (interval, number, ns, [H, W]); more: (entry of stack.json, planes [channels, H, W]) of other layers."""
    height, width = frames[0].shape
    more_json = {"subpixels": subpixels, "between": bool(between), "period_ns": period_ns}
    stack = stack_json(width // subpixels, height // subpixels, times_ns, **more_json)
    layers = [(LAYER, motions), *more] if motions else [*more]
    if layers:
        stack["layers"] = [entry for entry, _ in layers]
    if not light:
        stack["light"] = False
    with StackWriter(folder, stack) as writer:
        for i, frame in enumerate(frames if light else ()):
            writer.write_frame(i, 1e-3 * frame[None])
        for entry, planes in layers:
            for i, plane in enumerate(planes):
                writer.write_layer(entry["name"], i, plane)
        for interval, number, time_ns, frame in between:
            writer.write_between(interval, number, time_ns, 1e-3 * frame[None])
    return folder
