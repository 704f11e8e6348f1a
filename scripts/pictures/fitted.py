#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/studies/fitted.webp: 20 ms of a recording's second half beside models with the values of
scripts/studies/fitted_peers.json, on every second pixel; 0.5 ms of events in each frame.

    scripts/pictures/fitted.py RECORDING [--models pecs v2e icns]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from pecs_lab import computed_disk, fitted
from PIL import Image, ImageDraw, ImageFont

ROOT = Path(__file__).resolve().parents[2]
COARSER, BEGIN_US, LENGTH_US, WINDOW_US = 2, 30_000, 20_000, 500
PAPER, INK, ON, OFF = (255, 255, 255), (27, 31, 36), (0, 114, 178), (213, 94, 0)  # of pecs view
HEAD_PX, FRAME_MS = 44, 80


def drawn(events: np.ndarray, disk, t_us: int) -> np.ndarray:
    half = int(disk.radius_px) + 4
    x0, y0 = (int(c) - half for c in disk.centre_px)
    panel = np.full((2 * half, 2 * half, 3), PAPER, np.uint8)
    now = events[(events["t"] >= t_us) & (events["t"] < t_us + WINDOW_US)]
    for p, colour in ((1, ON), (0, OFF)):
        of = now[now["p"] == p]
        y, x = of["y"].astype(int) - y0, of["x"].astype(int) - x0
        inside = (x >= 1) & (y >= 1) & (x < 2 * half) & (y < 2 * half)
        for dy, dx in ((0, 0), (0, -1), (-1, 0), (-1, -1)):  # 2x2, to be seen
            panel[y[inside] + dy, x[inside] + dx] = colour
    return panel


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("--models", nargs="+", default=["pecs", "v2e", "icns"])
    args = parser.parse_args()
    disk, events, duration_us = computed_disk.examine(args.recording)
    kept = events[(events["x"] % COARSER == COARSER // 2) & (events["y"] % COARSER == COARSER // 2)].copy()
    for axis in "xy":
        kept[axis] //= COARSER
    stage = fitted.Stage(disk.coarser(COARSER), COARSER, BEGIN_US + LENGTH_US)
    values = json.loads((ROOT / "scripts/studies/fitted_peers.json").read_text())["models"]
    panels = {"recording": kept} | {m: stage.events(m, values[m]["values"], seed=2) for m in args.models}

    font, frames = ImageFont.truetype("DejaVuSans.ttf", 15), []
    for t_us in range(BEGIN_US, BEGIN_US + LENGTH_US, WINDOW_US):
        row = [drawn(of, stage.disk, t_us) for of in panels.values()]
        side = row[0].shape[1]
        picture = Image.new("RGB", (side * len(row), side + HEAD_PX), PAPER)
        draw = ImageDraw.Draw(picture)
        for k, (name, panel) in enumerate(zip(panels, row, strict=True)):
            picture.paste(Image.fromarray(panel), (k * side, HEAD_PX))
            title = name if name == "recording" else f"{name}, fitted"
            draw.text((k * side + side / 2, 32), title, INK, font, anchor="mm")
        for x, colour, word in ((8, ON, "ON"), (58, OFF, "OFF")):
            draw.rectangle((x, 5, x + 10, 15), colour)
            draw.text((x + 15, 10), word, INK, font, anchor="lm")
        draw.text((picture.width - 8, 10), f"{(t_us - BEGIN_US) / 1000:.1f} ms", INK, font, anchor="rm")
        frames.append(picture)
    path = ROOT / "docs/studies/fitted.webp"
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, quality=60, method=6)
    print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
