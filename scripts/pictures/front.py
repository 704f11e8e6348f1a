#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""The pictures of the README: a scene on its way to events, and the result of the demo.

pecs dataset examples/recipes/small.toml -o out/small && scripts/pictures/front.py strip out/small
scripts/demo.sh --real R_360_L.hdf5 && scripts/pictures/front.py demo out/demo
"""

import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pecs
from figures import ROOT, plt
from matplotlib.image import imread
from pecs.datasets import sequences
from pecs.datasets.writers._pictures import depth_picture, flow_picture
from pecs_lab.measure import command
from PIL import Image


def picture(columns: dict[str, np.ndarray], rows: int, output: str, width: float) -> None:
    """Captioned pictures, row by row."""
    figure, axes = plt.subplots(
        rows, len(columns) // rows, figsize=(width, (0.27, 0.52)[rows - 1] * width), layout="constrained"
    )
    for axis, (title, image) in zip(axes.flat, columns.items(), strict=True):
        axis.imshow(image, cmap="gray", interpolation="antialiased", aspect="equal")
        axis.set_title(title, fontsize=10)
        axis.set(xticks=[], yticks=[])
    with tempfile.NamedTemporaryFile(suffix=".png") as drawn:
        figure.savefig(drawn.name, dpi=110, bbox_inches="tight", pad_inches=0.05)
        Image.open(drawn.name).convert("RGB").save(ROOT / output, quality=88)
    plt.close(figure)


def light(stack: Path, chip: str, time_us: float) -> np.ndarray:
    with pecs.Light(stack, [chip]) as found:
        plane = found.at([time_us])[0, 0]
    return np.clip(plane / np.percentile(plane, 99), 0, 1) ** (1 / 2.2)


def strip(folder: Path) -> None:
    """Scene, lens, light, events, depth and flow in the middle of the first sequence."""
    sequence = sequences(folder)[0]
    camera, at_us = sequence.of_kind("events")[0], sequence.duration_us / 2
    with camera.event_file() as file:
        events = file.between(at_us - 2500, at_us + 2500)
    truth = camera.truth
    at = int(np.abs(truth.times_us - at_us).argmin())
    with tempfile.NamedTemporaryFile(suffix=".png") as drawn:
        lens = [pecs.program(), "lens", "draw", "cmount_8mm_f2p8", "--fnumber", "4", "--width", "900"]
        subprocess.run([*lens, "-o", drawn.name], check=True, stdout=subprocess.DEVNULL)
        section = imread(drawn.name)[3:-30, :, :3]  # without its border and caption
        section = np.pad(section, ((180, 180), (0, 0), (0, 0)), constant_values=1)
    columns = {
        "scene (Blender)": imread(ROOT / "scenes/desk/picture.png")[:, 100:460],
        "lens, traced ray by ray": section,
        "light on the chip": light(camera.stack_folder, "davis346", at_us),
        "events of 5 ms: ON blue, OFF orange": pecs.event_picture(events, camera.width, camera.height),
        "depth: near is bright": depth_picture(truth.depth(at)[1]),
        "optical flow: hue is direction": flow_picture(truth.flow(min(at, len(truth) - 2))),
    }
    picture(columns, 2, "docs/start/overview.webp", 10)


def demo(folder: Path) -> None:
    """Light, recording and simulation of the rotating disk, 5 ms of each."""
    columns = {"rendered light": light(folder / "stack", "imx636", 27_000)}
    for name, title in (("real", "recorded events (EVK4)"), ("sim", "simulated events")):
        events = pecs.read(folder / f"{name}.raw")
        now = events["t"] - events["t"][0]
        some = events[(now >= 25_000) & (now < 30_000)]
        columns[title] = pecs.event_picture(some, events.width, events.height)
    picture(columns, 1, "docs/start/demo.webp", 10)


def main(what: str, folder: Path) -> None:
    {"strip": strip, "demo": demo}[what](folder)


if __name__ == "__main__":
    command(main)
