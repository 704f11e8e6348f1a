"""Writers of data sets: native sequences in, a folder in another format out.

    report = pecs.datasets.writers.write("dsec", sequences, "out/dsec")

To add a format:
1. One file here. Its docstring says the layout: files, data sets, types, units, and in which picture truth is given.
2. `write(sequences, folder, **options) -> report` fills an empty folder. It reads sequences through `Sequence` alone,
   writes through `_files.py` (the same input makes the same bytes), and holds no more than one picture and one
   block of events in memory. The report is `_shared.Report`: what was written, what was left out and why.
3. A line in `WRITERS`.
4. A row in docs/reference/dataset_formats.md; in tests/python/datasets/test_writers.py a reader from another project,
   and what a bare sequence leaves out (test_only_events).
"""

from __future__ import annotations

import importlib
from os import PathLike
from pathlib import Path
from typing import Any

from ..._errors import PecsInputError as PecsInputError
from ..._errors import UsageError
from ..._files import sha256, whole_folder, write_json
from ..files import OWN
from ..sequence import Sequence

# Name -> what it is, in a few words.
WRITERS = {
    "dsec": "DSEC: stereo events, rectification, flow, disparity, images",
    "dsec_detection": "DSEC-Detection: DSEC with boxes and pictures in the view of the event camera",
    "prophesee": "Prophesee automotive (RVT): events and boxes of each event camera",
    "evreal": "EVREAL (event_utils' memory maps): events with the pictures of the same pixels",
    "event_cnn": "event_cnn_minimal (E2VID+ training) HDF5: events, pictures, flow",
    "ecd": "Event Camera Dataset, E2VID: text, TUM poses, EuRoC IMU",
    "radiance": "radiance fields: transforms.json, sharp and blurred pictures, events, E2NeRF's counts",
    "coco": "COCO: instances with RLE masks, one file for each camera",
    "ros": "ROS 1 and 2 bags: events, pictures, camera_info, poses, depth, flow, IMU",
    "webdataset": "WebDataset: tar shards, one sample for each interval of the truth",
}
REPORT = "export.json"


def write(
    name: str, sequences: list[Sequence], folder: str | PathLike[str], replace: bool = False, **options: Any
) -> dict[str, Any]:
    """Writes sequences in a format of `WRITERS`; the folder appears when it is whole. Returns its report, also in
    FOLDER/export.json: {"format", "sequences": {name: counts}, "left_out": [{"what", "why"}], "made_of": {name:
    SHA-256 of files.json}, …}.

    `replace`: an older folder of that name goes when the new one is whole; else it is an error. `options`: of the
    format's own `write`. Raises PecsInputError for what the format cannot hold, PecsOutputError for a folder that
    cannot be written.
    """
    if name not in WRITERS:
        raise UsageError(f"format: got {name!r}, wanted one of {', '.join(WRITERS)}")
    if not sequences:
        raise UsageError(f"{name}: there are no sequences to write")
    names = [s.name for s in sequences]
    files = [*names, *(f"{s.name}_{camera}" for s in sequences for camera in s.cameras)]
    if len({file.casefold() for file in files}) != len(files):
        raise UsageError(f"{name}: sequences: got a name twice in {', '.join(names)}, or with those of cameras")
    writer = importlib.import_module(f".{name}", __name__)
    with whole_folder(Path(folder), replace) as partial:
        report: dict[str, Any] = {"format": name, **writer.write(sequences, partial, **options).as_dict()}
        sealed = ((s.name, s.folder / OWN) for s in sequences)
        report["made_of"] = {name: sha256(file) if file.exists() else None for name, file in sealed}
        write_json(partial / REPORT, report)
    return report
