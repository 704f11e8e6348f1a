"""A camera's geometry as its stack has it: image map, K and distortion of OpenCV, rectification.

K and everything made for OpenCV take pixel (0, 0)'s centre as (0, 0); pecs takes it as (0.5, 0.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError, optional_module
from ..lens import Lens
from .files import read_object

Array = NDArray[np.float64]
SAME_AXIS, LEAST_ACROSS = 1e-9, 0.5  # cosines: of axes that are perpendicular; of a camera and the axis of its pair


def rig_from_camera(position_m: Sequence[float], rotation_deg: Sequence[float] = (0, 0, 0)) -> Array:
    """[4, 4] of a camera or an IMU; turns about the rig's x, then y, then z."""
    from scipy.spatial.transform import Rotation

    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix()
    out[:3, 3] = position_m
    return out


@dataclass(frozen=True)
class Optics:
    """Directions [H, W, 3] of the pixels' chief rays (unit, camera axes; NaN where none comes through)."""

    directions: NDArray[np.float64]
    lens: Lens | PinholeLens  # it keeps the image map
    setting: dict[str, Any]

    def pixels(self, directions: Array) -> Array:
        """[..., 2], pecs' pixels (first centre at 0.5)."""
        return self.lens.pixels(directions, **self.setting)


class PinholeLens:
    """`pecs.Lens.directions` and `pixels` of a pinhole with this K."""

    def __init__(self, K: Array):
        self._pixel_from_camera = K + [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]

    def directions(self, pixels: Array, **_setting: Any) -> Array:
        points = np.concatenate([pixels, np.ones_like(pixels[..., :1])], -1) @ np.linalg.inv(self._pixel_from_camera).T
        directions: Array = points / np.linalg.norm(points, axis=-1, keepdims=True)
        return directions

    def pixels(self, directions: Array, **_setting: Any) -> Array:
        with np.errstate(all="ignore"):
            points = directions @ self._pixel_from_camera.T
            return np.where(points[..., 2:] > 0, points[..., :2] / points[..., 2:], np.nan)


def stack_json(stack: Path) -> dict[str, Any]:
    return read_object(stack / "stack.json", "a stack")


def optics(stack: dict[str, Any], lens_path: str, K: Array | None = None) -> Optics:
    """Optics of a stack's stack.json, with the lens as the recipe names it. K: of a pinhole, if the stack has no
    lens."""
    x, y = np.meshgrid(np.arange(stack["width"]) + 0.5, np.arange(stack["height"]) + 0.5)
    pixels = np.stack([x, y], -1)
    lens, nm = stack["lens"], [band["lambda_nm"] for band in stack["bands"]]
    if lens is None and K is not None:
        pinhole_lens = PinholeLens(K)
        return Optics(pinhole_lens.directions(pixels), pinhole_lens, {})
    setting = {
        "width": stack["width"],
        "height": stack["height"],
        "pixel_pitch_mm": stack["pixel_pitch_m"] * 1e3,
        "lambda_nm": float(np.mean(nm)),
        "focus_bands_nm": lens["focus_bands_nm"],
        "focus_m": lens["focus_m"],
        "stop_diameter_mm": lens["stop_diameter_mm"],
    }
    prescription = Lens(lens_path)
    return Optics(prescription.directions(pixels, **setting), prescription, setting)


@dataclass(frozen=True)
class Pinhole:
    """K [3, 3] and distortion (k1 k2 p1 p2 k3, OpenCV's) that come nearest to the image map. error_px: RMS of it."""

    K: Array
    distortion: Array
    error_px: float


def along(directions: Array, z_m: NDArray[Any]) -> Array:
    """[..., 3] in camera axes: what lies along directions [..., 3] at depths [...] along the optical axis."""
    with np.errstate(invalid="ignore"):  # infinitely far
        return directions / directions[..., 2:] * np.asarray(z_m, np.float64)[..., None]


def transformed(pose: Array, points: Array) -> Array:
    """Points [..., 3] by a pose [4, 4]."""
    with np.errstate(invalid="ignore"):
        return points @ pose[:3, :3].T + pose[:3, 3]


def pinhole(directions: Array) -> Pinhole:
    """directions: [H, W, 3] of the pixels' centres. Least squares over a grid of them (OpenCV's model: Brown 1966)."""
    from scipy.optimize import least_squares

    height, width = directions.shape[:2]
    cv2 = optional_module("cv2", "opencv-python-headless", "a camera's calibration")
    step = max(1, min(height, width) // 40)
    d = directions[step // 2 :: step, step // 2 :: step].reshape(-1, 3)
    v, u = np.mgrid[step // 2 : height : step, step // 2 : width : step].reshape(2, -1).astype(float)
    seen = np.isfinite(d).all(1)
    points, wanted = d[seen] / d[seen, 2:], np.stack([u[seen], v[seen]], -1)
    middle = directions[height // 2, width // 2 - 1 : width // 2 + 1]
    focal = 1 / abs(np.subtract(*(middle[:, 0] / middle[:, 2])))
    start = [focal, focal, (width - 1) / 2, (height - 1) / 2, 0, 0, 0, 0, 0]

    def missed(p: Array) -> Array:
        fx, fy, cx, cy, *distortion = p
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(distortion))
        return (pixels[:, 0] - wanted).ravel()

    found = least_squares(missed, start, x_scale=[focal, focal, width, height, 0.1, 0.1, 0.01, 0.01, 0.1], xtol=1e-14)
    fx, fy, cx, cy, *distortion = found.x
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return Pinhole(K, np.array(distortion), float(np.sqrt(2 * np.mean(missed(found.x) ** 2))))


def rectified_axes(rig_from_camera: Array, rig_from_partner: Array) -> Array:
    """rig_from_rect [3, 3] of a pair, the same in either order: the baseline along x, and the optical axis as near to
    both cameras' as may be (Fusiello et al. 2000). Raises PecsInputError if a camera looks along the baseline."""
    x = rig_from_partner[:3, 3] - rig_from_camera[:3, 3]
    x /= np.linalg.norm(x)
    axes = rig_from_camera[:3, :3] + rig_from_partner[:3, :3]
    # To the right in the pictures; down, if one camera is above the other.
    x *= np.sign(next(v for v in (*(x @ axes)[:2], *x) if abs(v) > SAME_AXIS))
    z = axes[:, 2] - x * (x @ axes[:, 2])
    z /= max(float(np.linalg.norm(z)), SAME_AXIS)
    if (least := min(float(z @ rig_from_camera[:3, 2]), float(z @ rig_from_partner[:3, 2]))) < LEAST_ACROSS:
        turned = f"{math.degrees(math.acos(max(least, -1.0))):.0f} degrees from the perpendicular to the baseline"
        raise PecsInputError(f"got a view {turned}, wanted at most {math.degrees(math.acos(LEAST_ACROSS)):.0f}")
    return np.stack([x, np.cross(z, x), z], axis=1)


def rectified_K(kept: list[Array], sizes: list[tuple[int, int]]) -> Array:
    """One K for pictures of the first size (width, height): the mean focal length, the centre in the middle. Rows of
    a pair of other sizes match."""
    focal = float(np.mean([[K[0, 0], K[1, 1]] for K in kept]))
    middle = (sizes[0][0] - 1) / 2, (float(np.mean([height for _, height in sizes])) - 1) / 2
    return np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])


def rectify_map(directions: Array, R_rect: Array, K_rect: Array) -> NDArray[np.float32]:
    """[H, W, 2]: where a pixel's centre lies in the rectified picture (OpenCV's pixels), exactly, by its chief ray."""
    turned = directions @ (K_rect @ R_rect).T
    with np.errstate(all="ignore"):
        out = np.where(turned[..., 2:] > 0, turned[..., :2] / turned[..., 2:], np.nan)
    return out.astype(np.float32)
