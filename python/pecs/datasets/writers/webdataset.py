"""WebDataset (github.com/webdataset): tar shards, read in order; files of one sample have one base name.

    SPLIT-NNNNNN.tar
      SEQUENCE-CAMERA-NNNNNN.json             sequence, camera, start_us, end_us, K, distortion, world_from_camera, size
                            .events.npy       structured t i8 us, x y u2, p u1: start <= t < end
                            .causes.npy       u1: index into pecs.sensor.LABELS;  .objects.npy u2: id seen, 0 none
                            .flow.npy         f4 [H, W, 2] px, from start to end;  .depth.npy f4 [2, H, W] m at the end
                            .instances.npy    u2 [H, W] at the end;  .boxes.npy structured (`pecs.datasets.BOX_DTYPE`)
                            .frame.png        the picture of the same pixels nearest to the end, where there is one

One sample is one interval of the truth of one event camera. Everything is on the camera's own, distorted pixels. Dots
in names become `_`: WebDataset splits there. The bytes are the same for the same sequences.
"""

from __future__ import annotations

import json
import tarfile
from collections.abc import Iterator
from itertools import chain, count, islice
from pathlib import Path
from typing import Any

import numpy as np

from ..._errors import UsageError
from ..files import npy_bytes
from ..sequence import Camera, Sequence, frames_of
from ._files import add_to_tar
from ._shared import Report

Sample = dict[str, bytes]  # extension -> content, in the order of the tar


def write(sequences: list[Sequence], folder: Path, samples_per_shard: int = 256) -> Report:
    """samples_per_shard: the last shard of a split may have fewer."""
    if samples_per_shard < 1:
        raise UsageError(f"webdataset: samples_per_shard: got {samples_per_shard}, wanted 1 or more")
    keys = [_key(s, camera) for s in sequences for camera in s.of_kind("events")]
    if len({*keys}) < len(keys):
        raise UsageError(f"webdataset: sequences and cameras: got a key twice in {', '.join(keys)}")
    report = Report({"IMU, poses between the samples, normals": "a sample is one interval"})
    for split in sorted({s.split for s in sequences}):
        samples = _samples([s for s in sequences if s.split == split], report)
        for shard in count():
            some = list(islice(samples, 1))
            if not some:
                break
            with (folder / f"{split}-{shard:06d}.tar").open("wb") as file:
                with tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as tar:
                    for key, sample in chain(some, islice(samples, samples_per_shard - 1)):
                        for extension, data in sample.items():
                            add_to_tar(tar, f"{key}.{extension}", data)
    return report


def _key(sequence: Sequence, camera: Camera) -> str:
    return f"{sequence.name}-{camera.name}".replace(".", "_")  # what follows a period is an extension


def _samples(sequences: list[Sequence], report: Report) -> Iterator[tuple[str, Sample]]:
    for sequence in sequences:
        for camera in sequence.of_kind("events"):
            if not camera.has_truth:
                report.leave_out(f"camera {camera.name}", "it has no truth", sequence.name)
                continue
            for i, sample in enumerate(_samples_of(sequence, camera)):
                yield f"{_key(sequence, camera)}-{i:06d}", sample
                report.count(sequence.name, samples=1)


def _samples_of(sequence: Sequence, camera: Camera) -> Iterator[Sample]:
    truth, frames = camera.truth, frames_of(sequence, camera)
    times, poses = truth.times_us, camera.poses_at(truth.times_us)
    per_event = {name: getattr(camera, name)() for name in ("causes", "objects") if camera.has(name)}
    about: dict[str, Any] = {"sequence": sequence.name, "split": sequence.split, "camera": camera.name}
    about |= {"width": camera.width, "height": camera.height, "K": camera.K.tolist()}
    about |= {"distortion": camera.distortion.tolist()}
    if camera.has_boxes:
        about["classes"] = {str(number): name for number, name in truth.classes.items()}
    with camera.event_file() as events:
        for i, (start, end) in enumerate(zip(times, times[1:], strict=False)):
            first, last = events.index(start), events.index(end)
            now = {"start_us": float(start), "end_us": float(end), "world_from_camera": poses[i + 1].tolist()}
            out = {"events.npy": npy_bytes(np.asarray(events.read(first, last)))}
            out |= {f"{name}.npy": npy_bytes(np.array(values[first:last])) for name, values in per_event.items()}
            out |= _truth(camera, i)
            if frames:
                frame = min(frames, key=lambda f: abs(f.middle_us - end))
                out["frame.png"] = frame.path.read_bytes()
                now["frame_us"] = [frame.start_us, frame.end_us]
            yield {"json": json.dumps(about | now).encode()} | out


def _truth(camera: Camera, i: int) -> Sample:
    """Truth of the interval from instant i to the next."""
    truth, out = camera.truth, {}
    if "motion" in truth.layers:
        out["flow.npy"] = npy_bytes(truth.flow(i))
    if "depth" in truth.layers:
        out["depth.npy"] = npy_bytes(truth.depth(i + 1))
    if "objects" in truth.layers:
        out["instances.npy"] = npy_bytes(truth.instances(i + 1).astype(np.uint16))
    if camera.has_boxes:
        out["boxes.npy"] = npy_bytes(truth.boxes(i + 1))
    return out
