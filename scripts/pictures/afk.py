#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Picture of docs/reference/sensor.md: events of a lamp that flickers at 100 Hz and of a moving bar, without and with
the anti-flicker stage."""

import argparse
from pathlib import Path

import numpy as np
import pecs
from figures import OFF, ON, ROOT, plt, save

SIZE, END_S, LAMP_HZ = 96, 0.3, 100


def frames() -> tuple[np.ndarray, np.ndarray]:
    """A lamp on the left, whose light swings by 80 %; a dark bar that crosses the right half in 0.3 s."""
    t_s = np.arange(0, END_S, 5e-4)
    y, x = np.mgrid[:SIZE, :SIZE]
    disk = np.hypot(x - 24, y - 48) < 18
    lamp = 1 + 0.8 * np.sin(2 * np.pi * LAMP_HZ * t_s)
    bar = 1 - 0.7 / (1 + ((x - 50 - 46 * t_s[:, None, None] / END_S) / 2) ** 4) * (x >= 48)
    return np.where(disk, lamp[:, None, None], bar).astype(np.float32), t_s * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs/reference/afk.png")
    args = parser.parse_args()
    light, t_us = frames()
    figure, axes = plt.subplots(2, 2, figsize=(9, 5.4), width_ratios=[1, 1.7], layout="constrained")
    for row, (name, options) in zip(
        axes, {"without AFK": {}, "afk_hz=(50, 520)": {"afk_hz": (50, 520)}}.items(), strict=True
    ):
        events = pecs.simulate(light, t_us, photocurrent_a=1e-11, **options)
        late = events[events["t"] > 0.15e6]
        net = np.zeros((SIZE, SIZE))
        np.add.at(net, (late["y"], late["x"]), 1)
        row[0].imshow(np.minimum(net, 20), cmap="magma", vmin=0, vmax=20)
        row[0].set(title="events per pixel, 150 to 300 ms", xlabel="x / px", ylabel="y / px")
        line = events[events["y"] == 48]
        colours = np.where(line["p"] == 1, ON, OFF)
        row[1].scatter(line["t"] * 1e-3, line["x"], s=1, c=colours)
        row[1].set(title=f"{name}: {len(line)} events of row 48", xlabel="time / ms", ylabel="x / px", ylim=(SIZE, 0))
        print(f"{name}: {len(events)} events, {len(late)} of them after 150 ms")
    save(figure, args.output)


if __name__ == "__main__":
    main()
