"""A scene whose object ids are known at any time, and its stack."""

import numpy as np

from support.moving_scene import write_stack

W, H, STEP_US = 80, 60, 4000
OBJECTS = {"name": "objects", "files": "objects_%06d.exr", "channels": ["instance"], "unit": "1", "at": "instant"}


class Rectangle:
    """A rectangle (id 7) that moves by `step` an interval before a background of two ids, 2 left and 3 right of a line,
    that moves by `drift`. Pixel centres at whole numbers, time in intervals."""

    def __init__(self, step=(12.0, 4.0), drift=(-3.0, 0.0), size=(16.0, 12.0), at=(20.3, 20.6)):
        self.step, self.drift, self.size, self.at = step, drift, size, at
        self.y, self.x = np.mgrid[:H, :W].astype(float)

    def edges(self, x, y, t):
        """Signed distances to the rectangle's outline (negative: inside) and to the line (negative: left)."""
        across = np.abs(x - self.at[0] - self.step[0] * t - self.size[0] / 2) - self.size[0] / 2
        down = np.abs(y - self.at[1] - self.step[1] * t - self.size[1] / 2) - self.size[1] / 2
        return np.maximum(across, down), x - 41.4 - self.drift[0] * t

    def _edges(self, t):
        return self.edges(self.x, self.y, t)

    def ids(self, t):
        outline, line = self._edges(t)
        return np.where(outline < 0, 7, np.where(line < 0, 2, 3)).astype(np.int32)

    def is_rim(self, t, px=1.0):
        outline, line = self._edges(t)
        return (np.abs(outline) < px) | (np.abs(line) < px)

    def motion(self, t=0):
        """[20, H, W] of the interval from t on."""
        out = np.zeros((20, H, W), np.float32)
        for side, way in ((0, 1), (1, -1)):
            front = self._edges(t + side)[0] < 0
            for axis in range(2):
                d = way * np.where(front, self.step[axis], self.drift[axis])
                for quarter in range(4):
                    out[10 * side + 2 * quarter + axis] = d * (quarter + 1) / 4
            out[10 * side + 8 : 10 * side + 10] = np.where(front, 1.0, 4.0)
        return out


def write_truth(folder, scene, intervals, light=True, subpixels=1, ids=None):
    """A stack of the scene; ids: other planes of them."""
    times = [k * STEP_US * 1000 for k in range(intervals + 1)]
    ids = ids or [scene.ids(k) for k in range(intervals + 1)]
    objects = (OBJECTS, [plane[None].astype(np.float32) for plane in ids])
    motions = [scene.motion(k) for k in range(intervals)]
    frames = [np.ones((H, W), np.float32)] * (intervals + 1)
    return write_stack(folder, frames, times, motions, subpixels=subpixels, more=[objects], light=light)
