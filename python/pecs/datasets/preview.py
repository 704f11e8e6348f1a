"""A sequence as moving pictures: preview.png, whose rows are instants of one event camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..chip import Chip
from ..light import Light
from ..representations import event_picture
from .sequence import Camera, Sequence
from .writers._pictures import depth_picture, flow_picture, smaller

ROWS, WIDTH = 12, 240  # pixels of one picture
WINDOW_US = 10_000  # of the events of a picture


def strip(sequence: Sequence) -> dict[str, NDArray[np.uint8]]:
    """Columns [ROWS * h, WIDTH, 3] by caption, at even times, of the first event camera: light, events, depth and flow,
    as far as the sequence has them. Empty without an event camera."""
    cameras = sequence.of_kind("events")
    if not cameras:
        return {}
    camera, times = cameras[0], (np.arange(ROWS) + 0.5) / ROWS * sequence.duration_us
    with camera.event_file() as file:
        windows = [file.between(t - WINDOW_US / 2, t + WINDOW_US / 2) for t in times]
    columns = {
        "light": _light(camera, times),
        "events": [event_picture(found, camera.width, camera.height) for found in windows],
        "1 / depth": _depth(camera, times),
        "flow": _flow(camera, times),
    }
    return {caption: np.concatenate([_fit(p) for p in pictures]) for caption, pictures in columns.items() if pictures}


def _fit(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """WIDTH pixels wide, RGB."""
    if picture.ndim == 2:
        picture = np.repeat(picture[..., None], 3, -1)
    if picture.shape[1] < WIDTH:
        picture = picture.repeat(-(-WIDTH // picture.shape[1]), 0).repeat(-(-WIDTH // picture.shape[1]), 1)
    return smaller(picture, WIDTH)


def _light(camera: Camera, times_us: NDArray[np.float64]) -> list[NDArray[np.uint8]]:
    """Photocurrents of the chip, as grey values of one exposure."""
    stack, chip = camera.stack_folder, camera.folder / "chip.json"
    if not (stack / "stack.json").is_file():
        return []
    with Chip(chip if chip.is_file() else camera.info["chip"]) as profile, Light(stack, profile) as light:
        planes = light.at(np.minimum(times_us, light.end_us or np.inf))[:, 0]
    white = max(float(np.percentile(planes, 99)), 1e-30)
    return [np.rint(255 * np.clip(plane / white, 0, 1) ** (1 / 2.2)).astype(np.uint8) for plane in planes]


def _depth(camera: Camera, times_us: NDArray[np.float64]) -> list[NDArray[np.uint8]]:
    if not camera.has_truth or "depth" not in camera.truth.layers:
        return []
    truth = camera.truth
    return [depth_picture(truth.depth(int(np.abs(truth.times_us - t).argmin()))[1]) for t in times_us]


def _flow(camera: Camera, times_us: NDArray[np.float64]) -> list[NDArray[np.uint8]]:
    if not camera.has_truth or "motion" not in camera.truth.layers or len(camera.truth) < 2:
        return []
    truth, last = camera.truth, len(camera.truth) - 2
    at = np.searchsorted(truth.times_us, times_us, "right") - 1
    return [flow_picture(truth.flow(int(i))) for i in np.clip(at, 0, last)]
