"""Planes of light warped along motion, 1280x720, Mpixel per second and core (CPU time), median of the passes, and the
time of the preparation. JSON.

    python scripts/bench/motion_carry.py [--passes 5]

    turning  one surface that turns by 0.02 rad (16 px at the corners) and grows
    objects  48 ellipses that move up to 16 px before a background that moves
    still    nothing moves but one ellipse
"""

import statistics
import time

import numpy as np
import pecs
from pecs_lab.measure import command

WIDTH, HEIGHT, PLANES = 1280, 720, 16
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
SCENES = {"turning": (0, 0.02, 0.005, 0), "objects": (48, 0, 0, 3), "still": (1, 0, 0, 0)}  # ellipses; turn, growth, x


def layer(ellipses: int, turn: float, growth: float, drift: float) -> np.ndarray:
    """[20, H, W]: the motion layer of a stack."""
    k = np.arange(ellipses)[:, None]
    wave = np.array([600, 330, 20, 15, 15, 10, 3]) * np.sin(k * [1.7, 2.9, 1.1, 2.3, 3.1, 0.7, 4.3] + 0.3)
    things, channels = wave + [640, 360, 50, 40, 0, 0, 5], []
    for begins, way in ((0, 1), (1, -1)):
        dx = way * (drift - turn * (Y - 360) + growth * (X - 640))
        dy = way * (turn * (X - 640) + growth * (Y - 360))
        z = np.full_like(X, 10)
        for x, y, width, height, move_x, move_y, near in things[np.argsort(-things[:, 6])]:
            u, v = (X - x - begins * move_x) / width, (Y - y - begins * move_y) / height
            inside = u * u + v * v <= 1
            dx[inside], dy[inside], z[inside] = way * move_x, way * move_y, near
        channels += [part / 4 * d for part in (1, 2, 3, 4) for d in (dx, dy)] + [z, z]
    return np.array(channels, np.float32)


def main(*, passes: int = 5) -> dict:
    light, out, found = 1 + 0.5 * np.sin(0.4 * X) * np.cos(0.3 * Y), np.empty_like(X), {}
    for name, scene in SCENES.items():
        motion, prepares, carries = layer(*scene), [], []
        for _ in range(passes):
            times = [time.process_time()]
            with pecs.Carrier(motion) as carrier, pecs.CarriedLight(carrier, light, light) as carried:
                times.append(time.process_time())
                for i in range(PLANES):
                    carried.at((i + 0.5) / PLANES, out=out)
            times.append(time.process_time())
            prepares.append(1e3 * (times[1] - times[0]))
            carries.append(times[2] - times[1])
        speed = PLANES * X.size / statistics.median(carries) * 1e-6
        found[name] = {"mpixels_per_core_s": speed, "prepare_ms": statistics.median(prepares)}
    return found


if __name__ == "__main__":
    command(main)
