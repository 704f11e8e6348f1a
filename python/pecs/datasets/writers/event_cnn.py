"""HDF5 of event_cnn_minimal (Stoffregen et al., ECCV 2020) and event_utils: training of E2VID+ and FireNet+.

    SPLIT/SEQUENCE[_CAMERA].h5
      events/{xs u2, ys u2, ts f8 s, ps bool}
      images/imageNNNNNNNNN u1 [H, W] grey; attributes timestamp [s], event_idx, size, type
      flow/flowNNNNNNNNN f4 [2, H, W] px/s: velocity on the picture's own, distorted pixels at its time (as ESIM's);
                         the loader multiplies it by the time of a window. 0 where it is not known
      attributes num_events, num_pos, num_neg, num_imgs, num_flow, duration, t0, tk, sensor_resolution [H, W], source

Pictures are those of an RGB camera with the same pixels (a beam splitter); a camera without one is left out, because
the loader takes windows between pictures. Flow is `Truth.velocity_at` the middle of
the exposure; it is written when the truth covers all pictures.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..files import read_picture
from ..sequence import Camera, Frame, Sequence
from ._files import grey, hdf5, put, put_events
from ._shared import Report, with_pictures


def write(sequences: list[Sequence], folder: Path) -> Report:
    """No options."""
    report = Report({"depth, masks, boxes, poses, IMU, causes, objects": "the format has no place for them"})
    for sequence, name, camera, frames in with_pictures("event_cnn", sequences, report):
        with hdf5(folder / sequence.split / f"{name}.h5") as file:
            _put_camera(file, sequence, camera, frames, report)
    return report


def _put_camera(file: Any, sequence: Sequence, camera: Camera, frames: list[Frame], report: Report) -> None:
    with camera.event_file() as events:
        columns = {f"events/{c}s": ("<u2", lambda e, c=c: e[c]) for c in "xy"}
        columns |= {"events/ts": ("<f8", lambda e: e["t"] * 1e-6), "events/ps": ("?", lambda e: e["p"] == 1)}
        put_events(file, events, columns)
        on = sum(int(np.count_nonzero(block["p"])) for block in events.blocks())
        t = file["events/ts"]
        first, last = (float(t[0]), float(t[-1])) if len(t) else (0.0, 0.0)
        for i, frame in enumerate(frames):
            data = put(file, f"images/image{i:09d}", grey(read_picture(frame.path)))
            data.attrs["size"] = np.array([camera.height, camera.width])
            data.attrs["timestamp"] = frame.middle_us * 1e-6
            data.attrs["event_idx"] = np.int64(events.index(frame.middle_us))
            data.attrs["type"] = "greyscale"
        count = len(events)
    flows = _put_flow(file, sequence, camera, frames, report)
    file.attrs.update({"num_events": count, "num_pos": on, "num_neg": count - on, "num_imgs": len(frames)})
    file.attrs.update({"num_flow": flows, "duration": last - first, "t0": first, "tk": last, "source": "pecs"})
    file.attrs["sensor_resolution"] = np.array([camera.height, camera.width])
    report.count(sequence.name, events=count, pictures=len(frames), flow=flows)


def _put_flow(file: Any, sequence: Sequence, camera: Camera, frames: list[Frame], report: Report) -> int:
    times = camera.truth.times_us if camera.has_truth and "motion" in camera.truth.layers else np.zeros(1)
    if frames[0].middle_us < times[0] - 1 or frames[-1].middle_us > times[-1] + 1:
        why = "the truth has no motion from the first picture to the last"
        report.leave_out(f"flow of camera {camera.name}", why, sequence.name)
        return 0
    for k, frame in enumerate(frames):
        flow = np.moveaxis(camera.truth.velocity_at(frame.middle_us), -1, 0)
        data = put(file, f"flow/flow{k:09d}", np.nan_to_num(flow, nan=0.0))
        data.attrs["size"] = np.array(flow.shape)
        data.attrs["timestamp"] = frame.middle_us * 1e-6
    return len(frames)
