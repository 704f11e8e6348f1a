#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Draws the middle of each sequence of a data set: a picture of the same pixels, events, depth, optical flow, objects.

pecs dataset examples/recipes/demo.toml -o out/dataset_demo
scripts/pictures/data_set.py out/dataset_demo docs/start/demo_set.webp
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pecs
from matplotlib.image import imread
from pecs.datasets import sequences
from pecs.datasets.files import read_object
from pecs.datasets.preview import WINDOW_US
from pecs.datasets.sequence import Sequence, frames_of
from pecs.datasets.writers._pictures import depth_picture, flow_picture
from pecs_lab.measure import command

COLUMNS = "picture", f"events of {WINDOW_US / 1000:g} ms: ON blue, OFF orange", "1 / depth", "optical flow", "objects"

SHARES = {"renderer": "render_noise_share", "camera's noise": "camera_noise_share", "dropped": "dropped_share"}


def row(sequence: Sequence) -> tuple[str, list[np.ndarray]]:
    """Caption and pictures of the first event camera, in the order of COLUMNS."""
    camera = sequence.of_kind("events")[0]
    frame = min(frames_of(sequence, camera), key=lambda one: abs(one.middle_us - sequence.duration_us / 2))
    with camera.event_file() as file:
        events = file.between(frame.middle_us - WINDOW_US / 2, frame.middle_us + WINDOW_US / 2)
    truth, at = camera.truth, int(np.abs(camera.truth.times_us - frame.middle_us).argmin())
    colours = np.random.default_rng(4).integers(60, 255, (1 + int(truth.instances(at).max()), 3), np.uint8)
    colours[0] = 255
    found = read_object(sequence.folder / "checks.json", "checks")["cameras"][camera.name]["events"]
    shares = (f"{what} {100 * found[key]:.1f} %" for what, key in SHARES.items())
    caption = "\n".join(
        [f"{sequence.name} {sequence.info['scene']}", f"{found['rate_hz'] * 1e-6:.2f} million/s", *shares]
    )
    return caption, [
        imread(frame.path),
        pecs.event_picture(events, camera.width, camera.height),
        depth_picture(truth.depth(at)[1]),
        flow_picture(truth.flow(min(at, len(truth) - 2))),
        colours[truth.instances(at)],
    ]


def main(folder: Path, output: Path) -> None:
    rows = [row(sequence) for sequence in sequences(folder)]
    size = 15, 2.35 * len(rows)
    figure, axes = plt.subplots(len(rows), len(COLUMNS), figsize=size, squeeze=False, layout="constrained")
    for axis, title in zip(axes[0], COLUMNS, strict=True):
        axis.set_title(title, fontsize=10)
    for line, (caption, pictures) in zip(axes, rows, strict=True):
        line[0].set_ylabel(caption, rotation=0, ha="right", va="center", fontsize=9)
        for axis, picture in zip(line, pictures, strict=True):
            axis.imshow(picture, cmap="gray")
            axis.set(xticks=[], yticks=[])
    figure.savefig(output, dpi=90)


if __name__ == "__main__":
    command(main)
