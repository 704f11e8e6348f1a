"""Moving pictures known at any time, for benches: light between 0 and 1, antialiased over one pixel.

disk: a spinning disk, inside 8 sectors of contrast 12:1 with sharp edges, outside a smooth angular wave.
board: a checkerboard of contrast 12:1 that slides over a still background.
"""

from collections.abc import Callable

import numpy as np

DARK, WHITE = 1 / 12, 1.0
DISK_SECTORS_PX, DISK_PX = 60, 125


def disk(width: int = 346, height: int = 260, turns_per_s: float = 3.0) -> Callable[[float], np.ndarray]:
    """Returns light(t_s) -> [height, width] float64."""
    y, x = np.mgrid[0:height, 0:width].astype(float)
    x, y = x - (width - 1) / 2, (height - 1) / 2 - y
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    inner, outer = radius < DISK_SECTORS_PX, (radius >= DISK_SECTORS_PX) & (radius < DISK_PX)
    middle, swing = np.log(DARK * WHITE) / 2, np.log(WHITE / DARK) / 2

    def light(t_s: float) -> np.ndarray:
        out = np.full((height, width), 0.3)
        turned = angle - 2 * np.pi * turns_per_s * t_s
        out[outer] = np.exp(middle + swing * np.sin(3 * turned[outer]))
        # Sectors of 45 degrees; to the nearest edge in px.
        part = np.mod(turned[inner], np.pi / 4)
        distance = radius[inner] * np.sin(np.minimum(part, np.pi / 4 - part))
        white = np.mod(turned[inner], np.pi / 2) < np.pi / 4
        cover = 0.5 + np.where(white, 1, -1) * np.minimum(distance, 0.5)
        out[inner] = DARK + (WHITE - DARK) * cover
        return out

    return light


def board(width: int = 1280, height: int = 720, px_per_s: float = 1000.0) -> Callable[[float], np.ndarray]:
    side, pitch = 661.0, 82.6
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5

    def light(t_s: float) -> np.ndarray:
        u, v = x - (width * 0.35 - px_per_s * t_s / 2), y - 30.0

        def square(z: np.ndarray) -> np.ndarray:  # +1 and -1 by turns, straight over one pixel
            part = np.mod(z, pitch)
            return np.where(np.mod(z, 2 * pitch) < pitch, 1, -1) * np.minimum(2 * np.minimum(part, pitch - part), 1)

        def inside(z: np.ndarray) -> np.ndarray:
            return np.clip(np.minimum(z, side - z) + 0.5, 0, 1)

        cells = 0.5 + 0.5 * square(u)[None, :] * square(v)[:, None]
        cover = inside(u)[None, :] * inside(v)[:, None]
        return 0.3 + cover * (DARK + (WHITE - DARK) * cells - 0.3)

    return light


SCENES = {"disk": disk, "board": board}


def frames(name: str, count: int, fps: float = 1000.0) -> tuple[np.ndarray, np.ndarray]:
    """[count, height, width] float32 and times in us."""
    light = SCENES[name]()
    t_us = np.arange(count) * 1e6 / fps
    return np.stack([light(t * 1e-6).astype(np.float32) for t in t_us]), t_us


def stack_json(width: int, height: int, times_ns: list[int], **more: object) -> dict:
    """The content of a stack.json of irradiance in one band; `more` replaces entries."""
    return {
        "pecs_stack": 1, "quantity": "irradiance", "width": width, "height": height, "pixel_pitch_m": 4.86e-6,
        "bands": [{"lambda_nm": 550.0, "weight_nm": 100.0}], "times_ns": times_ns, "period_ns": None, "lens": None,
        "scene": {}, "render": {}, "versions": {}, **more,
    }  # fmt: skip
