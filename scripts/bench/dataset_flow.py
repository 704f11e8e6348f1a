"""Does OpenCV's KLT tracker, which knows pictures alone, see the flow that a data set writes?

    .venv/bin/python scripts/bench/dataset_flow.py [-o out/dataset_flow]

Renders the street from a moving RGB camera (346x260, a lens with distortion), exposes pictures whose middles are
instants of the ground truth, tracks corners from one to the next, and prints JSON: median and spread of tracked less
written.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
from pecs.datasets import Sequence
from scipy.ndimage import map_coordinates

ROOT = Path(__file__).resolve().parents[2]
RECIPE = """
duration_s = 0.08
[[scene]]
path = "{root}/scenes/street"
[scene.trajectory]
kind = "hand_held"
volume = [[6.6, -5, -0.1], [6.9, 40, 0.25]]
step_m = [0.5, 1]
yaw_deg = 100
speed_m_per_s = 1.4
clearance_m = 0.2
[[rig.camera]]
name = "rgb"
kind = "rgb"
width = 346
height = 260
pixel_pitch_um = 18.5
lens = "cmount_5mm_f2p8"
fnumber = 4
focus_m = 8
fps = 50
exposure_ms = 2
phase_ms = 19
[render]
bands = 3
samples = 16
fps = 200
step_px = 32
[truth]
fps = 50
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/dataset_flow"))
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "recipe.toml").write_text(RECIPE.format(root=ROOT))
    subprocess.run([sys.executable, "-m", "pecs.datasets", folder / "recipe.toml", "-o", folder / "set"], check=True)
    camera = Sequence(folder / "set/sequences/0000").cameras["rgb"]
    truth, found = camera.truth, []
    grey = {f.middle_us: cv2.cvtColor(cv2.imread(str(f.sharp_path)), cv2.COLOR_BGR2GRAY) for f in camera.frames()}
    for i in range(len(truth) - 1):
        pair = [grey.get(t) for t in truth.times_us[i : i + 2]]
        if any(picture is None for picture in pair):
            continue
        corners = cv2.goodFeaturesToTrack(pair[0], 400, 0.05, 5)
        there, seen, _ = cv2.calcOpticalFlowPyrLK(*pair, corners, None, winSize=(15, 15), maxLevel=3)
        back, again, _ = cv2.calcOpticalFlowPyrLK(pair[1], pair[0], there, None, winSize=(15, 15), maxLevel=3)
        kept = (seen & again).ravel() == 1
        kept &= np.abs(back - corners).max((1, 2)) < 0.2  # forth and back
        at, moved = corners[kept, 0], (there - corners)[kept, 0]
        written = [map_coordinates(truth.flow(i)[..., k], at.T[::-1], order=1, mode="nearest") for k in (0, 1)]
        error = np.hypot(*(moved.T - written))
        found.append(np.stack([error, np.hypot(*written)]))
    error, length = np.concatenate(found, 1)
    known = np.isfinite(error)
    spread = np.percentile(error[known], (50, 90))
    result = {"corners": int(known.sum()), "median_px": spread[0], "p90_px": spread[1]}
    print(json.dumps(result | {"median_flow_px": float(np.median(length[known]))}))


if __name__ == "__main__":
    main()
