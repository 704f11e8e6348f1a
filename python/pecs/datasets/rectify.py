"""From a camera's own picture to the undistorted one (stereo-rectified where it has a partner).

Truth lies on the camera's own pixels; DSEC's flow and disparity lie on those of the rectified picture. A value there is
interpolated between the four pixels around, if they see one surface, else it is that of the nearest one.

The lens is that of rectify_map.npy, its chief rays; K and the distortion of sequence.json are OpenCV's model nearest to
it and lead from pixel to pixel. Pixels here are OpenCV's: the first one's centre is at (0, 0).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._errors import PecsInputError, optional_module
from ._bilinear import bilinear, on_surface
from .sequence import Camera, rect_from_rect

_SURFACE_PX = 1.0  # neighbours that differ by more see two surfaces
_FAR = -1e6  # px: where nothing is
_SAME_PX = 0.01  # rectified pixels that do not come back to this have no place in the picture


def _cv2() -> Any:
    return optional_module("cv2", "opencv-python-headless", "rectification")


class Lens:
    """A camera's own picture and its rectified one, point by point."""

    def __init__(self, camera: Camera):
        self.camera = camera
        self.pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(np.float64)
        self.rect = camera.rectify_map().astype(np.float64)  # NaN: the pixel looks aside of the rectified picture
        self._missed = np.nan_to_num(self.rect - self._model(self.pixels))  # what the model lacks [H, W, 2]

    def _model(self, points_px: NDArray[Any]) -> NDArray[np.float64]:
        cv2, camera = _cv2(), self.camera
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        flat = np.ascontiguousarray(points_px, np.float64).reshape(-1, 1, 2)
        out = cv2.undistortPointsIter(flat, camera.K, camera.distortion, camera.R_rect, camera.K_rect, stop)
        return out.reshape(np.shape(points_px))

    def _model_back(self, rect_px: NDArray[np.float64]) -> NDArray[np.float64]:
        rays = self.rays_of(rect_px).reshape(-1, 3)
        out = _cv2().projectPoints(rays, np.zeros(3), np.zeros(3), self.camera.K, self.camera.distortion)[0][:, 0]
        out[rays[:, 2] <= 0] = np.nan
        return out.reshape(rect_px.shape)

    def to_rect(self, points_px: NDArray[Any]) -> NDArray[np.float64]:
        """Points of the camera's own picture [..., 2] in the rectified one; NaN stays NaN."""
        known = np.isfinite(points_px).all(-1, keepdims=True)
        points = np.where(known, points_px, 0)
        return np.where(known, self._model(points) + bilinear(self._missed, points), np.nan)

    def from_rect(self, rect_px: NDArray[Any]) -> NDArray[np.float64]:
        """Points of the rectified picture [..., 2] in the camera's own one; NaN for those that are not in it."""
        rect_px = np.asarray(rect_px, np.float64)
        with np.errstate(invalid="ignore"):
            points = self._model_back(rect_px)
            for _ in range(8):  # what the model lacks is small and smooth
                points = self._model_back(rect_px - bilinear(self._missed, np.nan_to_num(points)))
            back = np.abs(self.to_rect(points) - rect_px).max(-1, keepdims=True)
        return np.where(back < _SAME_PX, points, np.nan)

    def rays_of(self, rect_px: NDArray[Any]) -> NDArray[np.float64]:
        """Directions [..., 3] in the camera's axes of points of the rectified picture."""
        camera = self.camera
        ones = np.ones((*np.shape(rect_px)[:-1], 1))
        return np.concatenate([rect_px, ones], -1) @ np.linalg.inv(camera.K_rect).T @ camera.R_rect

    def rays(self) -> NDArray[np.float64]:
        """Directions of the pixels' centres with z = 1 [H, W, 3], in the camera's axes."""
        out = self.rays_of(self.rect)
        return out / out[..., 2:]


class Rectifier:
    """The map from one camera's pictures to rectified ones."""

    def __init__(self, camera: Camera):
        self.camera, self.lens = camera, Lens(camera)
        self.at = np.nan_to_num(self.lens.from_rect(self.lens.pixels), nan=_FAR)  # [H, W, 2]
        self._rect_z_of_z = self.lens.rays() @ camera.R_rect[2]  # depth along the rectified axis, of z = 1

    def sample(self, values: NDArray[Any], surface: NDArray[Any] | None = None) -> NDArray[np.float64]:
        """Values on the camera's pixels [H, W, C] at the pixels of the rectified picture; NaN outside and where the
        nearest pixel has none. `surface` [H, W]: pixels of different numbers see different things."""
        height, width = values.shape[:2]
        x, y = self.at[..., 0], self.at[..., 1]
        inside = (x >= -0.5) & (x < width - 0.5) & (y >= -0.5) & (y < height - 0.5)
        out = on_surface(values, np.clip(self.at, 0, [width - 1, height - 1]), surface, _SURFACE_PX)
        out[~inside] = np.nan
        return out

    def picture(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A picture, rectified; black outside."""
        cv2 = _cv2()
        out: NDArray[np.uint8] = cv2.remap(picture, self.at.astype(np.float32), None, cv2.INTER_LINEAR)
        return out

    def flow(self, flow_px: NDArray[Any], surface: NDArray[Any] | None = None) -> NDArray[np.float64]:
        """Flow on the camera's pixels [H, W, 2] as flow in the rectified picture."""
        return self.sample(self.lens.to_rect(self.lens.pixels + flow_px) - self.lens.rect, surface)

    def disparity(self, z_m: NDArray[Any], stereo: Stereo, surface: NDArray[Any] | None = None) -> NDArray[np.float64]:
        """x(left) - x(right) in px, of depths z along this camera's axis [H, W], in the rectified picture; NaN
        where there is no surface."""
        with np.errstate(divide="ignore"):
            px = stereo.focal_baseline / (z_m * self._rect_z_of_z) + stereo.shift_px
        px = np.where(np.isfinite(z_m) & (z_m > 0), px, np.nan)
        return self.sample(px[..., None], surface)[..., 0]


class Stereo:
    """A rectified pair: disparity = focal_baseline / z + shift_px."""

    def __init__(self, left: Camera, right: Camera):
        move = rect_from_rect(left, right)
        wanted = np.eye(4)
        wanted[0, 3] = move[0, 3]
        K, L = left.K_rect, right.K_rect
        same = [(0, 0), (1, 1), (0, 1), (1, 2)]
        if np.abs(move - wanted).max() > 1e-5 * abs(move[0, 3]) or any(abs(K[p] - L[p]) > 1e-6 * K[0, 0] for p in same):
            raise PecsInputError(
                f"cameras {left.name} and {right.name}: got R_rect and K_rect whose rows do not match, "
                "wanted a rectified pair"
            )
        self.baseline_m = float(move[0, 3])
        self.focal_baseline = float(K[0, 0]) * self.baseline_m  # px m
        self.shift_px = float(K[0, 2] - L[0, 2])

    def depth_of_disparity(self, left: Camera) -> NDArray[np.float64]:
        """Q [4, 4]: (x, y, disparity, 1) of the left rectified picture to homogeneous metres."""
        K = left.K_rect
        Q = np.eye(4)
        Q[0, 3], Q[1, 1], Q[1, 3] = -K[0, 2], K[0, 0] / K[1, 1], -K[1, 2] * K[0, 0] / K[1, 1]
        Q[2, 2:] = 0, K[0, 0]
        Q[3, 2:] = 1 / self.baseline_m, -self.shift_px / self.baseline_m
        return Q
