"""Frame by frame, as from a camera: events leave as soon as they are certain, each with its cause.

python examples/stream_frames/stream_frames.py [OUTPUT]        OUTPUT: stream.npz, or .raw, .hdf5, …
"""

import sys
from collections import Counter

import numpy as np
import pecs
from pecs.sensor import LABELS

WIDTH, HEIGHT, FRAMES = 160, 120, 200


def camera():
    """A lamp on a circle: (time in us, [HEIGHT, WIDTH] of linear light), a frame per millisecond."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for i in range(FRAMES):
        lamp = np.hypot(x - 80 - 40 * np.cos(0.02 * i), y - 60 - 40 * np.sin(0.02 * i))
        yield 1000.0 * i, (0.1 + 0.9 * np.exp(-((lamp / 12) ** 2))).astype(np.float32)


def simulate(sensor: pecs.Sensor):
    """The events of each frame, and those that the last interval still yields."""
    for t_us, frame in camera():
        yield sensor.push(frame, t_us)
    yield sensor.finish()


def main() -> None:
    output = sys.argv[1] if len(sys.argv) > 1 else "stream.npz"
    causes = Counter()
    # Any value of the chip may be overridden; a wrong name or range is an error.
    with (
        pecs.EventWriter(output, WIDTH, HEIGHT) as writer,
        pecs.Sensor(WIDTH, HEIGHT, "davis346", overrides={"contrast_threshold_on": 0.25}, labels=True) as sensor,
    ):
        for events in simulate(sensor):
            writer.write(events[["t", "x", "y", "p"]])
            causes.update(LABELS[label] for label in events["label"].tolist())
    print(f"{output}: " + ", ".join(f"{count} by {cause}" for cause, count in causes.most_common()))


if __name__ == "__main__":
    main()
