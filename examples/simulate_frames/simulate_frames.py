"""Frames in memory to events: a bright bar moves over a dark wall.

python examples/simulate_frames/simulate_frames.py [OUTPUT]  OUTPUT: bar.raw (EVT3), or .npz, .hdf5, .aedat4, .csv, …
"""

import sys

import numpy as np
import pecs


def moving_bar(width: int = 320, height: int = 240, frames: int = 60, speed_px: float = 0.8) -> np.ndarray:
    """[frames, height, width], linear light, 1 is white. Below one pixel a frame, so that no pixel is skipped."""
    x = np.arange(width) + 0.5
    left = 40 + speed_px * np.arange(frames)[:, None]
    cover = np.clip(x - left + 0.5, 0, 1) * np.clip(left + 60 - x + 0.5, 0, 1)  # edges smooth over a pixel
    return np.repeat((0.1 + 0.7 * cover)[:, None, :], height, axis=1).astype(np.float32)


def main() -> None:
    output = sys.argv[1] if len(sys.argv) > 1 else "bar.raw"
    frames = moving_bar()
    t_us = 1000.0 * np.arange(len(frames))
    # imx636: the chip of Prophesee's EVK4. photocurrent_a: how bright white is; 1 pA lies in a well lit room.
    events = pecs.simulate(frames, t_us, chip="imx636", photocurrent_a=1e-12, seed=1)
    pecs.write(output, events)
    on = events["p"].mean()
    print(
        f"{len(events)} events in {t_us[-1] / 1000:.0f} ms, {100 * on:.0f} % ON, in {output}; look: pecs view {output}"
    )


if __name__ == "__main__":
    main()
