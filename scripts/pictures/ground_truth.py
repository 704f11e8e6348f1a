#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Draws the ground truth of a frame of scenes/street: light, events, depth, optical flow and objects.

.venv/bin/python -m pecs_blender render scenes/street -o street.stack --time adaptive --lens none --fps 1000 \\
    --frames 0:16 --width 384 --height 216 --bands 3 --samples 16 --layers depth,objects
pecs sense street.stack -o street.raw --fnumber 4 --warmup 20ms
scripts/pictures/ground_truth.py street.stack street.raw -o docs/reference/ground_truth.png
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pecs
from matplotlib.colors import LinearSegmentedColormap, hsv_to_rgb

PALETTE = LinearSegmentedColormap.from_list("events", ["#d55e00", "white", "#0072b2"])  # OFF, none, ON


def flow_colours(flow: np.ndarray) -> np.ndarray:
    """[H, W, 3]: hue is the direction, saturation the length; NaN is grey."""
    length = np.hypot(*flow)
    hue = np.nan_to_num(np.arctan2(flow[1], flow[0]) / (2 * np.pi) % 1)
    full = np.nanpercentile(length, 99) or 1
    colours = hsv_to_rgb(np.stack([hue, np.clip(np.nan_to_num(length / full), 0, 1), np.ones_like(hue)], -1))
    colours[np.isnan(length)] = 0.8
    return colours


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("stack", type=Path)
    parser.add_argument("events", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    with pecs.StackReader(args.stack) as stack:
        light = stack.read_frame(0).sum(0)
        depth, ids, motion = (stack.read_layer(name, 0) for name in ("depth", "objects", "motion"))
        layers = {layer["name"]: layer["channels"] for layer in stack.layers}
    events = pecs.read(args.events)
    counts = pecs.event_histogram(events, events.width, events.height)
    flow = motion[[layers["motion"].index(name) for name in ("x_end", "y_end")]]
    ids = ids[0].astype(int)
    shown = np.random.default_rng(4).uniform(0.25, 1, (ids.max() + 1, 3))
    shown[0] = 1
    grey = np.clip(light / np.percentile(light, 99), 0, 1) ** (1 / 2.2)
    panels = [
        ("light", grey, "gray"),
        ("events: ON blue, OFF orange", np.clip(counts[1] - counts[0], -3, 3), PALETTE),
        ("depth", np.log(depth[0]), "viridis"),
        ("optical flow", flow_colours(flow), None),
        ("objects", shown[ids], None),
    ]
    figure, axes = plt.subplots(1, len(panels), figsize=(16, 2.2), layout="constrained")
    for axis, (title, image, colours) in zip(axes, panels, strict=True):
        axis.imshow(image, cmap=colours)
        axis.set(title=title, xticks=[], yticks=[])
    figure.savefig(args.output, dpi=100)


if __name__ == "__main__":
    main()
