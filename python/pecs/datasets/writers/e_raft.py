"""The test set of E-RAFT (Gehrig et al., 3DV 2021; github.com/uzh-rpg/E-RAFT), which arranges DSEC in another way; at
any size, E-RAFT's own code assumes 640x480.

    SPLIT/SEQUENCE/     its loader reads the split `test`
      events_left/events.h5, events_left/rectify_map.h5   as of `dsec`
      image_timestamps.txt                 us, two for each step of 100 ms; the loader takes every second one, without
                                           the first and the last
      test_forward_flow_timestamps.csv     from_us, to_us, line of image_timestamps.txt: the samples

A sample is the events of the step before and of the step after an instant. The true flow of these steps is that of
`dsec` with flow_us=100_000.
"""

from __future__ import annotations

from pathlib import Path

from ..._errors import PecsInputError
from ..sequence import Sequence
from ._files import write_lines
from ._shared import Report
from .dsec import roles, write_events

_LEAST_STEPS = 3  # two samples: its loader does not read a list of one


def write(sequences: list[Sequence], folder: Path, flow_us: int = 100_000) -> Report:
    """flow_us: a step; E-RAFT's loader reads 100_000 alone."""
    report = Report({"all but the left events": "E-RAFT estimates flow from them; `dsec` has the rest"})
    for sequence in sequences:
        steps = int(sequence.duration_us) // flow_us
        if steps < _LEAST_STEPS:
            wanted = f"at least {_LEAST_STEPS} steps of {flow_us} us"
            raise PecsInputError(f"{sequence.folder}: duration: got {int(sequence.duration_us)} us, wanted {wanted}")
        at = folder / sequence.split / sequence.name
        count = write_events(at / "events_left", roles(sequence)["cam0"], sequence.duration_us)
        times = [i * flow_us // 2 for i in range(2 * steps + 1)]
        write_lines(at / "image_timestamps.txt", [str(t) for t in times])
        lines = [f"{times[2 * i]}, {times[2 * i + 2]}, {2 * i}" for i in range(1, steps)]
        header = "# from_timestamp_us, to_timestamp_us, file_index"
        write_lines(at / "test_forward_flow_timestamps.csv", [header, *lines])
        report.count(sequence.name, events_left=count, samples=len(lines))
    return report
