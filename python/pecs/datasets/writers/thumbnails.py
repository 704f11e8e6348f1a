"""Small PNG pictures for an index page.

SEQUENCE_CAMERA.png         of an RGB camera the picture in the middle; of an event camera its events
                            of 10 ms in the middle (ON blue, OFF orange)
SEQUENCE_CAMERA_depth.png   1 / z at the truth's instant in the middle, near is white
SEQUENCE_CAMERA_strip.png   events of ten windows over the sequence, side by side
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..._errors import UsageError
from ..files import read_picture
from ..sequence import Camera, Sequence
from ._files import write_png
from ._pictures import depth_picture, event_picture, smaller
from ._shared import Report

_WINDOW_US = 10_000
_STRIP = 10


def write(sequences: list[Sequence], folder: Path, width: int = 240) -> Report:
    """width: of a picture in pixels; smaller ones stay as they are."""
    if width < 8:
        raise UsageError(f"thumbnails: width: got {width}, wanted 8 or more")
    report = Report()
    for sequence in sequences:
        for camera in sequence.cameras.values():
            name = f"{sequence.name}_{camera.name}"
            middle_us = sequence.duration_us / 2
            if camera.kind == "events":
                write_png(folder / f"{name}.png", smaller(_events(camera, middle_us), width))
                steps = (np.arange(_STRIP) + 0.5) / _STRIP * sequence.duration_us
                strip = [smaller(_events(camera, t), width // 2) for t in steps]
                write_png(folder / f"{name}_strip.png", np.concatenate(strip, 1))
                report.count(sequence.name, pictures=2)
            elif frames := camera.frames():
                frame = min(frames, key=lambda f: abs(f.middle_us - middle_us))
                write_png(folder / f"{name}.png", smaller(read_picture(frame.path), width))
                report.count(sequence.name, pictures=1)
            if camera.has_truth and "depth" in camera.truth.layers:
                i = int(np.abs(camera.truth.times_us - middle_us).argmin())
                write_png(folder / f"{name}_depth.png", smaller(depth_picture(camera.truth.depth(i)[1]), width))
                report.count(sequence.name, pictures=1)
    return report


def _events(camera: Camera, t_us: float) -> np.ndarray:
    with camera.event_file() as events:
        window = events.between(t_us - _WINDOW_US / 2, t_us + _WINDOW_US / 2)
    return event_picture(window, camera.height, camera.width)
