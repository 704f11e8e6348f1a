"""EVREAL (Ercan et al., CVPRW 2023) and event_utils' memory maps: one folder for each event camera.

    SEQUENCE[_CAMERA]/
      events_ts.npy f8 [n] s, events_xy.npy i2 [n, 2], events_p.npy bool [n]
      images.npy u1 [N, H, W, 1] grey, images_ts.npy f8 [N, 1] s (middle of the exposure),
      image_event_indices.npy i8 [N, 1] (first event at or after the picture)
      metadata.json {"sensor_resolution": [H, W]}

Pictures are those of an RGB camera with the same pixels (a beam splitter); a camera without one is left out, because
EVREAL's loader requires pictures.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..._files import write_json
from ..files import npy_bytes, read_picture
from ..sequence import Camera, Frame, Sequence
from ._files import grey, save_events
from ._shared import Report, with_pictures


def write(sequences: list[Sequence], folder: Path) -> Report:
    """No options."""
    report = Report({"truth, poses, IMU, causes, objects": "EVREAL compares pictures alone"})
    for sequence, name, camera, frames in with_pictures("evreal", sequences, report):
        count = _write_camera(folder / name, camera, frames)
        report.count(sequence.name, events=count, pictures=len(frames))
    return report


def _write_camera(folder: Path, camera: Camera, frames: list[Frame]) -> int:
    """The number of events."""
    folder.mkdir()
    with camera.event_file() as events:
        save_events(folder / "events_ts.npy", events, "<f8", lambda e: e["t"] * 1e-6)
        save_events(folder / "events_xy.npy", events, "<i2", lambda e: np.stack([e["x"], e["y"]], 1), 2)
        save_events(folder / "events_p.npy", events, "?", lambda e: e["p"] == 1)
        indices = np.array([[events.index(f.middle_us)] for f in frames], np.int64)
        (folder / "image_event_indices.npy").write_bytes(npy_bytes(indices))
        count = len(events)
    times = np.array([[f.middle_us * 1e-6] for f in frames])
    (folder / "images_ts.npy").write_bytes(npy_bytes(times))
    header = {"descr": "|u1", "fortran_order": False, "shape": (len(frames), camera.height, camera.width, 1)}
    with (folder / "images.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        for frame in frames:
            file.write(grey(read_picture(frame.path)).tobytes())
    write_json(folder / "metadata.json", {"sensor_resolution": [camera.height, camera.width]})
    return count
