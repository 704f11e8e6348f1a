"""Views of a board or a disk through one of our lenses: each pixel's ray meets the target's plane.

For benches and tests of pecs align. Camera axes: x right, y down, z forward, origin at the entrance pupil; lengths in
mm, light between 0 and 1. Edges are smooth over about a pixel, as behind a real lens and pixel.
"""

from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pecs
from scipy.spatial.transform import Rotation

BLACK, WHITE, WALL = 0.07, 0.84, 0.3
SOFT_PX = 1.2  # half width of an edge


def rotation(x_deg: float, y_deg: float, z_deg: float) -> np.ndarray:
    """Rz Ry Rx."""
    return Rotation.from_euler("xyz", [x_deg, y_deg, z_deg], degrees=True).as_matrix()


def turn_of(rotation_deg) -> np.ndarray:
    """Camera axes from those of a camera that looks along the scenes' +y, of Blender's XYZ Euler rotation."""
    world_from_blender = rotation(*rotation_deg)
    camera_from_world = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    return (world_from_blender @ np.diag([1, -1, -1])).T @ camera_from_world.T


class Camera:
    """A lens of lens_data before width x height pixels. `shift_px`: where the axis meets them, off their middle."""

    def __init__(
        self, lens: str, focus_m: float, width=1280, height=720, pitch_mm=0.00486, shift_px=(0.0, 0.0), **stop
    ):
        self.lens, self.width, self.height = pecs.Lens(lens), width, height
        shift_mm = (shift_px[0] * pitch_mm, -shift_px[1] * pitch_mm)
        self.setting = {"width": width, "height": height, "pixel_pitch_mm": pitch_mm, "focus_m": focus_m, **stop}
        self.setting |= {"film_shift_mm": shift_mm}
        self.axis_px = np.array([width / 2, height / 2]) + shift_px
        self.focal_px = 1e3 * (self.pixels([1e-3, 0, 1])[0] - self.axis_px[0])

    def rays(self) -> np.ndarray:
        """[height, width, 3], z = 1."""
        y, x = np.mgrid[0 : self.height, 0 : self.width] + 0.5
        rays = self.lens.directions(np.stack([x, y], axis=-1), **self.setting)
        return rays / rays[..., 2:]

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixels of points [..., 3] in camera axes."""
        return self.lens.pixels(points, **self.setting)


@dataclass
class Board:
    """Squares, white at the top left, on a white plate. Axes: u right, v down, origin in the
    middle; moves as at_mm + velocity_mm_s t."""

    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    at_mm: tuple = (0.0, 0.0, 1560.0)
    velocity_mm_s: tuple = (-1000.0, 0.0, 0.0)
    columns: int = 4
    rows: int = 4
    square_mm: float = 41.7
    plate_mm: float = 40.0  # beyond the squares

    def corners(self) -> np.ndarray:
        """Inner corners [n, 3] on the board, row by row."""
        v, u = np.mgrid[1 : self.rows, 1 : self.columns].reshape(2, -1)
        u, v = u - self.columns / 2, v - self.rows / 2
        return np.stack([u, v, 0 * u], axis=-1) * self.square_mm

    def place(self, t_s: float) -> np.ndarray:
        return np.asarray(self.at_mm, float) + np.asarray(self.velocity_mm_s, float) * t_s

    def seen(self, camera: Camera, t_s: float) -> np.ndarray:
        """Pixels [n, 2] of corners()."""
        return camera.pixels(self.corners() @ self.rotation.T + self.place(t_s))

    def light(self, camera: Camera):
        """Returns light(t_s) -> [height, width] float32."""
        rays = camera.rays()
        normal = self.rotation[:, 2]
        over = 1 / (rays @ normal)
        a_u, a_v = (((rays @ self.rotation[:, k]) * over).astype(np.float32) for k in (0, 1))
        half_u, half_v = self.columns * self.square_mm / 2, self.rows * self.square_mm / 2

        def light(t_s: float) -> np.ndarray:
            at = self.place(t_s)
            depth = np.float32(normal @ at)
            u, v = (a * depth - np.float32(self.rotation[:, k] @ at) for k, a in enumerate((a_u, a_v)))
            soft = SOFT_PX * at[2] / camera.focal_px

            edge = partial(_edge, soft=soft)
            plate = edge(np.minimum(half_u + self.plate_mm - np.abs(u), half_v + self.plate_mm - np.abs(v)))

            def wave(x, half):  # +1 in the first square, -1 in the next
                part = np.mod(x + half, 2 * self.square_mm)
                distance = self.square_mm / 2 - np.abs(part - self.square_mm / 2)
                distance = np.where(part > 1.5 * self.square_mm, part - 2 * self.square_mm, distance)
                return 2 * edge(distance) - 1

            inside = edge(np.minimum(half_u - np.abs(u), half_v - np.abs(v)))
            black = inside * (0.5 - 0.5 * wave(u, half_u) * wave(v, half_v))
            return (WALL + plate * (WHITE + (BLACK - WHITE) * black - WALL)).astype(np.float32)

        return light


def record(light, times_s, size, seeds, white_a: float = 3e-12) -> list[np.ndarray]:
    """Events of the imx636 with its noise, one recording for each seed: light(t) at `times_s`; what is before 0 warms
    up the pixels. `white_a`: photocurrent of light 1."""
    sensors = [pecs.Sensor(*size, seed=seed, photocurrent_a=white_a) for seed in seeds]
    parts = [[] for _ in seeds]
    for t in times_s:
        frame = light(t)
        for sensor, out in zip(sensors, parts, strict=True):
            out.append(sensor.push(frame, (t - times_s[0]) * 1e6))
    recordings = [np.concatenate([*out, sensor.finish()]) for sensor, out in zip(sensors, parts, strict=True)]
    for events in recordings:
        events["t"] += round(times_s[0] * 1e6)
    return [events[events["t"] >= 0] for events in recordings]


def _edge(distance, soft):
    """0 outside, 1 inside, smooth over `soft` on both sides."""
    z = np.clip(distance / soft, -1, 1)
    return 0.5 + 0.25 * z * (3 - z * z)


@dataclass
class Disk:
    """Sectors, black from angle 0 on, at_mm right, down and forward; turned counter-clockwise on
    screen by phase_deg + speed_deg_s t."""

    at_mm: tuple = (160.1, 0.7, 1560.0)
    radius_mm: float = 153.0
    sectors: int = 4
    speed_deg_s: float = 2160.0
    phase_deg: float = 0.0
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))  # of the camera; at_mm lies before the unturned one
    black: float = BLACK

    def light(self, camera: Camera):
        """Returns light(t_s) -> [height, width] float32."""
        rays = camera.rays() @ self.turn
        rays /= rays[..., 2:]
        x = (rays[..., 0] * self.at_mm[2] - self.at_mm[0]).astype(np.float32)
        y = (self.at_mm[1] - rays[..., 1] * self.at_mm[2]).astype(np.float32)
        radius, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x)).astype(np.float32)
        soft = SOFT_PX * self.at_mm[2] / camera.focal_px
        near = radius < self.radius_mm + soft
        radius, angle, sector = radius[near], angle[near], 360.0 / self.sectors

        edge = partial(_edge, soft=soft)
        rim = edge(self.radius_mm - radius)

        def light(t_s: float) -> np.ndarray:
            out = np.full(x.shape, WALL, np.float32)
            part = np.mod(angle - np.float32((self.phase_deg + self.speed_deg_s * t_s) % 360), 2 * sector)
            # To the nearest edge: positive in white, which lies between 1 and 2 sectors.
            to_edge = np.abs(part - 1.5 * sector)
            side = np.where(to_edge < sector / 2, 1, -1)
            to_edge = np.minimum(np.abs(part - sector), np.minimum(part, 2 * sector - part))
            distance = side * radius * np.sin(np.radians(np.minimum(to_edge, 90)))
            out[near] = WALL + rim * (self.black + (WHITE - self.black) * edge(distance) - WALL)
            return out

        return light
