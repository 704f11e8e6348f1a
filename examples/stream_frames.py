"""Frame by frame, as from a camera: events leave as soon as they are certain, and every one says why it came.

python examples/stream_frames.py [OUTPUT]        OUTPUT: stream.npz, or .raw, .hdf5, …
"""

import sys
from collections import Counter

import pecs
from pecs.sensor import LABELS
from simulate_frames import moving_bar


def main() -> None:
    output = sys.argv[1] if len(sys.argv) > 1 else "stream.npz"
    frames = moving_bar()
    height, width = frames.shape[1:]
    causes = Counter()
    # Any value of the chip may be changed; a wrong name or range is refused.
    with (
        pecs.EventWriter(output, width, height) as writer,
        pecs.Sensor(width, height, "davis346", overrides={"contrast_threshold_on": 0.25}, labels=True) as sensor,
    ):
        for i, frame in enumerate(frames):
            events = sensor.push(frame, 1000.0 * i, last=i + 1 == len(frames))
            writer.write(events[["t", "x", "y", "p"]])
            causes.update(LABELS[label] for label in events["label"].tolist())
    print(f"{output}: " + ", ".join(f"{count} by {cause}" for cause, count in causes.most_common()))


if __name__ == "__main__":
    main()
