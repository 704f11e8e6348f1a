"""docs/reference/denoising.png: light and events of one sequence of a data set, rendered with `no_denoise = true`
(top) and without it (bottom).

    .venv/bin/python scripts/pictures/denoising.py NOISY_SET DENOISED_SET [SEQUENCE/CAMERA]
"""

import sys
from pathlib import Path

import cv2
import numpy as np
import pecs

BEGIN_US, LENGTH_US = 60_000, 3_000
ON, OFF = (178, 114, 0), (0, 94, 213)  # BGR, of pecs view


def row(camera: Path) -> np.ndarray:
    with pecs.StackReader(camera / "stack") as stack:
        light, n = stack.read_frame(1).mean(0), stack.info.get("subpixels") or 1
    height, width = (side // n for side in light.shape)
    light = light.reshape(height, n, width, n).mean((1, 3))
    log = np.log(np.maximum(light, light[light > 0].min()))
    low, high = np.percentile(log, (1, 99))
    grey = (255 * np.clip((log - low) / (high - low), 0, 1)).astype(np.uint8)
    events = pecs.read(camera / "events.h5")
    since_us = events["t"] - events["t"][0] - BEGIN_US
    events = events[(since_us >= 0) & (since_us < LENGTH_US)]
    drawn = np.full((height, width, 3), 255, np.uint8)
    for polarity, colour in ((1, ON), (0, OFF)):
        of = events[events["p"] == polarity]
        drawn[of["y"], of["x"]] = colour
    return np.hstack([cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), drawn])


def main(noisy: str, denoised: str, camera: str = "0000/left") -> None:
    rows = [row(Path(folder) / "sequences" / camera) for folder in (noisy, denoised)]
    cv2.imwrite(str(Path(__file__).parents[2] / "docs/reference/denoising.png"), np.vstack(rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
