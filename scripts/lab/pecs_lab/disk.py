"""The lab's turning disk in a picture, and where the picture has its edges."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

HALF_DEG, STEP_DEG = 44.0, 0.25  # of a profile: almost to the neighbouring edges
WIDTHS_DEG = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # of the logistic curves that are tried
TEN_TO_NINETY = 2 * np.log(9)  # of a logistic curve, in its widths
RADII = np.linspace(0.35, 0.9, 20)  # of the rim


@dataclass(frozen=True)
class Disk:
    """Equal black and white sectors. In pixels, the first one's centre at (0.5, 0.5); angles at time 0, on screen from
    the right, counter-clockwise."""

    centre_px: tuple[float, float]
    radius_px: float  # rim
    speed_deg_s: float  # positive: counter-clockwise
    on_edge_deg: float  # a white sector's leading edge; the next one follows after period_deg
    sectors: int = 4  # black and white ones together
    off_edge_deg: float | None = None  # of a black sector, where it was measured

    @property
    def off_deg(self) -> float:
        return self.on_edge_deg + 360 / self.sectors if self.off_edge_deg is None else self.off_edge_deg

    @property
    def period_deg(self) -> float:
        return 720 / self.sectors

    def detected(self, t_us: float = 0) -> dict:
        """As `pecs align detect --json` prints it, at this time."""
        turned = self.speed_deg_s * 1e-6 * t_us
        values = {"centre_x": self.centre_px[0], "centre_y": self.centre_px[1], "speed_deg_s": self.speed_deg_s}
        values |= {"on_edge_deg": self.on_edge_deg + turned, "off_edge_deg": self.off_deg + turned}
        rim = {"axis_a_px": 2 * self.radius_px, "axis_b_px": 2 * self.radius_px}
        rest = {"sectors": self.sectors, "phase_time_us": t_us, "rim": rim}
        return {key: {"value": value} for key, value in values.items()} | rest

    def coarser(self, factor: int) -> "Disk":
        """On the pixels x, y with x mod factor = y mod factor = factor // 2."""
        x, y = ((c - 0.5 - factor // 2) / factor + 0.5 for c in self.centre_px)
        return replace(self, centre_px=(x, y), radius_px=self.radius_px / factor)

    def moved(self, right_px: float, down_px: float) -> "Disk":
        return replace(self, centre_px=(self.centre_px[0] + right_px, self.centre_px[1] + down_px))

    def polar(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle in degrees and radius of the centres of pixels."""
        right, up = x + 0.5 - self.centre_px[0], self.centre_px[1] - (y + 0.5)
        return np.degrees(np.arctan2(up, right)), np.hypot(right, up)

    def past_deg(self, angle: np.ndarray, t_us: np.ndarray | float, edge_deg: float) -> np.ndarray:
        """How far an edge is past a pixel, in [0, period_deg)."""
        ahead = edge_deg + self.speed_deg_s * 1e-6 * t_us - angle
        return np.mod(ahead * np.sign(self.speed_deg_s), self.period_deg)


def edges(picture: np.ndarray, disk: Disk, t_us: float) -> tuple[np.ndarray, np.ndarray]:
    """Place of the logistic curve of least squares through each edge's profile [edges, RADII]: how far it lies ahead of
    the edge, along the motion, and its width from 10 to 90 %, both in px. NaN where the picture has no such edge:
    another polarity, or a curve that explains nothing."""
    from_edge = np.arange(-HALF_DEG, HALF_DEG + STEP_DEG / 2, STEP_DEG)
    between, sign = 360 / disk.sectors, np.sign(disk.speed_deg_s)
    at = disk.on_edge_deg + disk.speed_deg_s * t_us * 1e-6 + between * np.arange(disk.sectors)
    angle = np.radians(at[:, None, None] + sign * from_edge)  # ahead is positive
    radius = (RADII * disk.radius_px)[None, :, None]
    x, y = disk.centre_px[0] + radius * np.cos(angle), disk.centre_px[1] - radius * np.sin(angle)
    maps = ((v - 0.5).reshape(len(at), -1).astype(np.float32) for v in (x, y))
    profiles = cv2.remap(np.asarray(picture, np.float32), *maps, cv2.INTER_LINEAR).reshape(x.shape)
    brighter_ahead = np.where(np.arange(disk.sectors) % 2 == 0, -1.0, 1.0)  # ahead of an ON edge it is dark
    ahead_deg, width_deg = _logistic(profiles * brighter_ahead[:, None, None], from_edge)
    to_px = np.radians(1) * radius[..., 0]
    return ahead_deg * to_px, width_deg * TEN_TO_NINETY * to_px


def _logistic(profiles: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and width of the rising logistic curve of least squares, by trying all."""
    places = at[np.abs(at) <= HALF_DEG - 4]
    curves = 1 / (1 + np.exp(-(at[None, None] - places[:, None, None]) / np.array(WIDTHS_DEG)[None, :, None]))
    curves = curves.reshape(-1, len(at))
    curves -= curves.mean(1, keepdims=True)
    centred = profiles - profiles.mean(-1, keepdims=True)
    product = np.maximum(centred @ curves.T, 0)  # falling ones are no such edge
    explained = product**2 / (curves**2).sum(1)
    best = explained.argmax(-1)
    share = explained.max(-1) / np.maximum((centred**2).sum(-1), 1e-12)
    found = share > 0.5
    place, width = places[best // len(WIDTHS_DEG)], np.array(WIDTHS_DEG)[best % len(WIDTHS_DEG)]
    return np.where(found, place, np.nan), np.where(found, width, np.nan)
