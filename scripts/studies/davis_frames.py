#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Events by frames of a DAVIS240C, recorded and simulated: the table and picture of docs/reference/sensor.md.

The recording (still windows of EDI's camerashake, Pan et al., CVPR 2019) is not in the repository: FOLDER has still.npz
(t in us, x, y, p of three windows, each from a frame's readout to the next) and frames/0032.png to 0034.png. The light
is the mean frame times a lamp's flicker, whose depth and phase are part of the fit.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import pecs
from pecs.stack import StackWriter
from PIL import Image

CHIP, WIDTH, HEIGHT, PERIOD_US, BEGIN_US = "davis240c", 240, 180, 138121.3, -621.0
IRRADIANCE, BLACK_DN, WHITE_DN, DARKEST = 3.2e-4, 5, 240, 0.02  # of white; 4.8e-13 A
LAMP_HZ, LAMP_DEPTH, LAMP_PHASE = 100.4, 0.06, 1.7
LEAD_US = PERIOD_US - BEGIN_US  # the first exposure begins at 0, one period before the recording


def light(folder):
    """Irradiance [H, W] in relative units, of the mean frame."""
    paths = sorted((folder / "frames").glob("003[234].png"))
    grey = np.mean([np.asarray(Image.open(path), float) for path in paths], 0)
    return np.clip((grey - BLACK_DN) / (WHITE_DN - BLACK_DN), DARKEST, None)


def simulate(folder, out, seed):
    """The events of three periods, as recorded()."""
    frames, step_us = int(np.ceil((LEAD_US + 3 * PERIOD_US) / 1000)) + 2, 1000
    stack = {"pecs_stack": 1, "quantity": "irradiance", "width": WIDTH, "height": HEIGHT, "pixel_pitch_m": 1.85e-5}
    stack |= {"bands": [{"lambda_nm": 550.0, "weight_nm": 100.0}], "period_ns": None, "lens": None}
    stack |= {"times_ns": [1_000_000 * i for i in range(frames)], "scene": {}, "render": {}, "versions": {}}
    still = IRRADIANCE * light(folder)
    with StackWriter(out / "stack", stack) as writer:
        for i in range(frames):
            turn = 2e-6 * np.pi * LAMP_HZ * (step_us * i - LEAD_US) - LAMP_PHASE
            writer.write_frame(i, np.float32(still * (1 + LAMP_DEPTH * np.cos(turn)))[None])
    pecs.sense(out / "stack", out / "events.npz", chip=CHIP, frames=out / "frames", seed=seed)
    return of_windows(pecs.read(out / "events.npz"), LEAD_US)


def of_windows(events, begin_us):
    t_us = events["t"] - begin_us
    inside = (t_us >= 0) & (t_us < 3 * PERIOD_US)
    pixels = events["y"].astype(int) * WIDTH + events["x"]
    return t_us[inside], pixels[inside], events["p"][inside].astype(int)


def scores(t_us, pixel, p):
    """Numbers of each window, and of the pixels' counts."""
    window, phase_us = (t_us // PERIOD_US).astype(int), t_us % PERIOD_US
    bursts = {"OFF burst": (phase_us > 99000) & (phase_us < 101000), "ON burst": phase_us > 137000}
    bursts["after"] = phase_us < 6000
    bursts["between"] = ~np.any(list(bursts.values()), 0)
    rows = {}
    for name, which in bursts.items():
        rows[name] = [int((which & (window == k)).sum()) for k in range(3)]
        rows[name + ", ON share"] = [round(float(p[which & (window == k)].mean()), 3) for k in range(3)]
    counts = np.bincount(pixel, minlength=WIDTH * HEIGHT)
    rows["silent pixels"] = round(float((counts == 0).mean()), 3)
    rows["counts at 50, 75, 90, 99, 99.9 %"] = np.quantile(counts, [0.5, 0.75, 0.9, 0.99, 0.999]).round(1).tolist()
    return rows


def draw(recorded, simulated, path):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(4, 1, figsize=(12, 7), sharex=True, sharey=True, layout="constrained")
    edges = np.arange(0, PERIOD_US, 500)
    for axis, (name, (t_us, _, p), k) in zip(
        axes, [(n, e, k) for k in (0, 2) for n, e in (("recorded", recorded), ("simulated", simulated))], strict=True
    ):
        for polarity, colour, label in ((0, "tab:orange", "OFF"), (1, "tab:blue", "ON")):
            t = t_us[(p == polarity) & (t_us // PERIOD_US == k)] % PERIOD_US
            axis.step(edges[:-1] / 1000, np.histogram(t, edges)[0] * 2, color=colour, label=label, lw=0.9)
        axis.set(title=f"{name}, window {32 + k}", yscale="symlog", ylabel="events/ms")
    axes[0].legend(loc="upper left")
    axes[-1].set_xlabel("ms after the window's begin; exposures end at 99.5 ms, the next begins at 137.5 ms")
    figure.savefig(path, dpi=70)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--output", type=Path, help="PNG of the event rate over the frame clock")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    still = np.load(args.recording / "still.npz")
    recorded = of_windows(still, still["t"].min())
    with tempfile.TemporaryDirectory() as folder:
        simulated = simulate(args.recording, Path(folder), args.seed)
    for name, of_recording in scores(*recorded).items():
        print(f"{name:35} {of_recording!s:32} {scores(*simulated)[name]}")
    if args.output:
        draw(recorded, simulated, args.output)


if __name__ == "__main__":
    main()
