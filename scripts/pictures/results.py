#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Pictures of results, each from what its study or bench wrote.

scripts/pictures/results.py floor out/sequences/table1.json    docs/concepts/floor.svg
scripts/pictures/results.py keyframes REPORT    docs/studies/keyframes.svg, of scripts/bench/motion.py
scripts/pictures/results.py over_light    docs/studies/{latency,noise}_over_light.png
scripts/pictures/results.py fitted R_360_L.hdf5    docs/studies/fitted.webp
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pecs
from figures import GREY, INK, OFF, ON, ROOT, figure, plt, save
from pecs_lab import computed_disk, fitted, over_light
from pecs_lab.disk_scores import on_grid
from pecs_lab.measure import command
from PIL import Image, ImageDraw, ImageFont

COLOURS = {"on": ON, "off": OFF}


def floor(table1: Path) -> None:
    """Chamfer distance of each model to the recording of R_360_L, and between halves of the recording."""
    rows = [row for row in json.loads(table1.read_text()) if "chamfer_shared" in row and row["sequence"] == "R_360_L"]
    rows.sort(key=lambda row: row["chamfer_shared"])
    halves = rows[0]["floor"]["chamfer"]
    fig, axes = figure(7, 2.2)
    colours = [ON if row["model"] == "pecs" else GREY for row in rows]
    axes.barh([row["model"] for row in rows], [row["chamfer_shared"] for row in rows], color=colours, height=0.6)
    axes.axvline(halves, color=INK, ls="--", lw=1)
    text = "floor: one half of the recording\nagainst the other half"
    axes.annotate(text, (halves + 0.3, 0.05), fontsize=8, va="center")
    axes.invert_yaxis()
    axes.set(xlabel="Chamfer distance to the recording")
    save(fig, ROOT / "docs/concepts/floor.svg")


def keyframes(report: Path) -> None:
    """Recall, precision and CPU time of uniform steps and keyframes."""
    scenes = json.loads(report.read_text())["scenes"]
    fig, panels = plt.subplots(1, 3, figsize=(8, 2.7), layout="constrained", sharey=True, width_ratios=(1, 1, 0.8))
    variants = {"uniform": (OFF, "uniform steps, 8 samples"), "adaptive": (ON, "keyframes, 32 samples")}
    for axes, key in zip(panels, ("recall", "precision", "cpu_s"), strict=True):
        axes.spines[["top", "right"]].set_visible(False)
        for row, found in enumerate(scenes.values()):
            axes.plot([found[variant][key] for variant in variants], [row, row], color=GREY, lw=1.5, zorder=1)
            for variant, (colour, label) in variants.items():
                axes.plot(found[variant][key], row, "o", ms=5, color=colour, label=None if row else label)
            if key in found["ceiling"]:
                axes.plot(found["ceiling"][key], row, "|", ms=10, mew=1.5, color=INK, label=None if row else "ceiling")
        axes.grid(axis="x", alpha=0.3)
    panels[0].set(yticks=range(len(scenes)), yticklabels=scenes, xlim=(0.4, 1), xlabel="recall")
    panels[0].invert_yaxis()
    panels[1].set(xlim=(0.4, 1), xlabel="precision")
    panels[2].set(xlim=(0, None), xlabel="CPU time, s")
    fig.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    save(fig, ROOT / "docs/studies/keyframes.svg")


def beside(name: str, x: np.ndarray, ours: dict, theirs: dict, who: str, labels: dict, ends: dict) -> None:
    fig, axes = plt.subplots(figsize=(5.4, 3.4), layout="constrained")
    for p, colour in COLOURS.items():
        if p in ends:
            axes.fill_between(x, *ends[p], color=colour, alpha=0.12, lw=0)
        axes.plot(x, ours[p], color=colour, label=f"{p.upper()}, imx636")
        axes.plot(x, theirs[p], "o", color=colour, label=f"{p.upper()}, {who}")
    axes.set(xscale="log", yscale="log", **labels)
    axes.legend()
    save(fig, ROOT / "docs/studies" / name)


def lights() -> None:
    """imx636 and what others measured of its kind; prints the ratios of noise."""
    delays = {p: over_light.over_regions(of) for p, of in over_light.delays_us("imx636").items()}
    delays = {p: of | {"ends": (of["min"], of["max"])} for p, of in delays.items()}
    labels = {"xlabel": "irradiance at the chip, W/m²", "ylabel": "delay of the first event, µs"}
    medians, ends = ({p: of[k] for p, of in delays.items()} for k in ("median", "ends"))
    x, nist = over_light.IRRADIANCE_W_M2, over_light.MEDIANS_US
    beside("latency_over_light.png", x, medians, nist, "NIST", labels, ends)

    def sensor(width: int, height: int) -> pecs.Sensor:
        return pecs.Sensor(width, height, photocurrent_a=1e-15, seed=3, readout="ideal")

    noise, published = over_light.noise_hz(sensor, 1.0), over_light.PUBLISHED_HZ
    labels = {"xlabel": "lux at the focal plane", "ylabel": "noise events per pixel, Hz"}
    beside("noise_over_light.png", over_light.LUX, noise, published, "Noise2Params", labels, {})
    both = np.add(*noise.values())
    ratios = {name: np.divide(rates, published[name]) for name, rates in noise.items()}
    ratios |= {"both": both / np.add(*published.values()), "share of ON": noise["on"] / both}
    for name, row in ratios.items():
        print(name, np.round(row, 2).tolist())


def fits(recording: Path) -> None:
    """20 ms of a recording's second half and of models with the values of fits.json, on every second pixel; 0.5 ms of
    events in each frame."""
    coarser, begin_us, length_us, window_us, head_px = 2, 30_000, 20_000, 500, 44
    disk, events, _ = computed_disk.examine(str(recording))
    stage = fitted.Stage(disk.coarser(coarser), coarser, begin_us + length_us)
    rows = json.loads((ROOT / "scripts/studies/fits.json").read_text())["peers"]
    streams = {"recording": on_grid(events, coarser, coarser // 2)}
    streams |= {f"{m}, fitted": stage.events(m, rows[m]["values"], seed=2) for m in ("pecs", "v2e", "icns")}
    half = int(stage.disk.radius_px) + 4
    x0, y0 = (int(c) - half for c in stage.disk.centre_px)
    font, frames, side = ImageFont.truetype("DejaVuSans.ttf", 15), [], 2 * half
    for t_us in range(begin_us, begin_us + length_us, window_us):
        picture = Image.new("RGB", (side * len(streams), side + head_px), "white")
        draw = ImageDraw.Draw(picture)
        for k, (name, of) in enumerate(streams.items()):
            now = of[(of["t"] >= t_us) & (of["t"] < t_us + window_us)]
            shown = pecs.event_picture(now, stage.width, stage.height)[y0 : y0 + side, x0 : x0 + side]
            picture.paste(Image.fromarray(cv2.erode(shown, np.ones((2, 2)))), (k * side, head_px))  # larger, to be seen
            draw.text((k * side + side / 2, 32), name, INK, font, anchor="mm")
        for x, colour, word in ((8, ON, "ON"), (58, OFF, "OFF")):
            draw.rectangle((x, 5, x + 10, 15), colour)
            draw.text((x + 15, 10), word, INK, font, anchor="lm")
        draw.text((picture.width - 8, 10), f"{(t_us - begin_us) / 1000:.1f} ms", INK, font, anchor="rm")
        frames.append(picture)
    path = ROOT / "docs/studies/fitted.webp"
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=80, loop=0, quality=60, method=6)


def main(name: str, source: Path | None = None) -> None:
    draw = {
        "floor": floor,
        "keyframes": keyframes,
        "over_light": lights,
        "fitted": fits,
    }[name]
    draw(*([source] if source else []))


if __name__ == "__main__":
    command(main)
