#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""The pictures of docs/concepts/ from renders of the lab's disk (bands.svg and floor.svg: results.py).

size="--bands 6 --width 320 --height 180"
.venv/bin/python -m pecs_blender render scenes/rotating_disk -o out/still $size --frames 1 --samples 32
.venv/bin/python -m pecs_blender render scenes/rotating_disk -o out/turning $size --fps 2800 --frames period \\
    --time adaptive
.venv/bin/python scripts/pictures/concepts.py out/still out/turning
"""

import tempfile
from pathlib import Path

import numpy as np
import pecs
from figures import GREY, INK, OFF, ON, ROOT, figure, plt, save
from pecs_blender.spectral.spectra import load
from pecs_lab.measure import answer, command
from scipy.interpolate import PchipInterpolator

FOLDER, CHIP = ROOT / "docs/concepts", "imx636"
PIXEL = (180, 90)  # x, y: on the disk, where edges pass
WINDOW_US = (20_000.0, 95_000.0)
STEP_US = 50.0
RENDERED_LUX = 100  # of the scene, as it comes
LUX = (500, 50_000)  # an office, the sun
SLOW_ROW_S = 5e-6  # so that the order of the rows can be seen; the chip's own is 10 ns


def spectrum(info, chip):
    """Lamp, response of the chip, and where the bands lie."""
    fig, axes = figure()
    lamp = load("led_b3")
    axes.plot(lamp.lambda_nm, lamp.value / lamp.value.max(), color="#b7950b", label="lamp (LED-B3)")
    response = chip.info["relative_qe"]
    axes.plot(response["lambda_nm"], response["value"], color=INK, label="quantum efficiency of the chip (relative)")
    bands = info["bands"]
    weights = np.array([band["weight_nm"] for band in bands])
    axes.bar([b["lambda_nm"] for b in bands], weights / weights.max(), 5, color=GREY, alpha=0.6, label="6 bands")
    axes.set(xlim=(380, 1000), ylim=(0, 1.35), xlabel="wavelength (nm)", ylabel="relative to its greatest")
    axes.legend(loc="upper right", ncols=3)
    save(fig, FOLDER / "spectrum.svg")


def picture(values, label, name, colours="magma", mark=None):
    fig, axes = plt.subplots(figsize=(6.2, 3.2), layout="constrained")
    drawn = axes.imshow(values, cmap=colours, vmin=0)
    axes.set_axis_off()
    if mark:
        axes.plot(*mark, "o", mfc="none", mec="#2ecc71", mew=2, ms=9)
    fig.colorbar(drawn, ax=axes, label=label, shrink=0.9)
    save(fig, FOLDER / name)


def photoreceptor(current_a, corner_hz_per_a):
    """V = ln u of du/dt = 2 pi kappa u (I - u), exact over steps in which I is constant (docs/reference/sensor.md)."""
    u, v = current_a[0], []
    for i in current_a:
        grown = np.exp(np.clip(2 * np.pi * corner_hz_per_a * i * STEP_US * 1e-6, 0, 700))
        u = i * u * grown / (i + u * (grown - 1))
        v.append(np.log(u))
    return np.array(v)


def reference_steps(v, on, off):
    """Where V crosses a threshold: (index, polarity), and the reference after each step."""
    reference, events, line = v[0], [], []
    for i, value in enumerate(v):
        while value - reference >= on or reference - value >= off:
            polarity = value > reference
            reference += on if polarity else -off
            events.append((i, polarity))
        line.append(reference)
    return events, np.array(line)


def mark(axes, x, y, events, down_to=None):
    """Events on a curve; with lines down to a value."""
    for polarity, colour, name in ((True, ON, "ON event"), (False, OFF, "OFF event")):
        at = [i for i, p in events if p == polarity]
        axes.plot(x[at], y[at], "^" if polarity else "v", color=colour, ms=6, label=name)
        if down_to is not None:
            axes.vlines(x[at], down_to, y[at], color=colour, lw=0.7)


def light_to_events(stack, chip):
    t_us = np.arange(*WINDOW_US, STEP_US)
    x, y = PIXEL
    with pecs.Light(stack, [chip]) as light:
        current = np.array([light.at(t % 83_333.0)[0, y, x] for t in t_us])
    ms = t_us / 1000
    levels = [lux / RENDERED_LUX for lux in LUX]
    voltages = [photoreceptor(current * level, chip.corner_hz_per_a) - np.log(level) for level in levels]
    base = np.log(current).min()
    fig, axes = figure()
    axes.plot(ms, np.log(current) - base, color=GREY, ls="--", label="ln(photocurrent)")
    for voltage, lux, colour in zip(voltages, LUX, ("#009e73", "#e69f00"), strict=True):
        axes.plot(ms, voltage - base, color=colour, label=f"photoreceptor, {lux:,} lx")
    axes.set(xlabel="time (ms)", ylabel="ln, from the darkest", ylim=(-0.1, 3.2))
    axes.legend(loc="upper center", ncols=3)
    save(fig, FOLDER / "photoreceptor.svg")

    v = voltages[0] - base
    events, reference = reference_steps(v, chip.contrast_threshold_on, chip.contrast_threshold_off)
    fig, axes = figure()
    axes.plot(ms, v, color=INK, label="photoreceptor V")
    axes.step(ms, reference, color=GREY, lw=1, where="post", label="reference")
    mark(axes, ms, v, events)
    axes.set(xlabel="time (ms)", ylabel="ln, from the darkest", ylim=(-0.1, 3.2))
    axes.legend(loc="upper center", ncols=4)
    save(fig, FOLDER / "threshold.svg")


def curve_between_frames():
    """Times of crossings on a curve through frames, and on the frames alone."""
    frames_ms = np.arange(0, 9)
    values = 0.9 * np.sin(2 * np.pi * frames_ms / 11.0) ** 2
    fine = np.linspace(0, 8, 4001)
    curve = PchipInterpolator(frames_ms, values)(fine)
    events, _ = reference_steps(curve, 0.2, 0.2)
    fig, axes = figure()
    axes.plot(fine, curve, color=INK, label="light between the frames")
    axes.plot(frames_ms, values, "s", color=GREY, label="frames")
    mark(axes, fine, curve, events, down_to=-0.1)
    axes.set(xlabel="time (ms)", ylabel="ln(photocurrent)", ylim=(-0.1, 1.35))
    axes.legend(ncols=4, loc="upper center")
    save(fig, FOLDER / "between_frames.svg")


def readout(stack):
    """The same events as they come and as the chip delivers them, row by row."""
    streams, slow = {}, {"readout_row_s": SLOW_ROW_S}
    for kind in ("ideal", "chip"):
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch, "events.npz")
            pecs.sense(stack, path, chip=CHIP, overrides=slow, readout=kind, warmup_loops=2, duration_us=83_000)
            streams[kind] = pecs.read(path)
    fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.8), sharex=True, sharey=True, layout="constrained")
    middle = int(np.median(streams["ideal"]["t"]))
    for axes, kind, title in (
        (left, "ideal", "as the pixels fire"),
        (right, "chip", "as the chip delivers (slowed down)"),
    ):
        events = streams[kind]
        events = events[(events["t"] >= middle) & (events["t"] < middle + 400)]
        for p, colour in ((1, ON), (0, OFF)):
            of = events[events["p"] == p]
            axes.plot(of["t"] - middle, of["y"], ".", ms=3, color=colour)
        axes.set(title=title, xlabel="time (µs)")
        axes.title.set_size(9)
        axes.spines[["top", "right"]].set_visible(False)
    left.set(ylabel="row (pixels)", ylim=(180, 0))
    save(fig, FOLDER / "readout.svg")


def main(still: Path, turning: Path) -> None:
    answer(pecs.program(), "render-preview", still, "-o", FOLDER / "scene.png")
    answer(pecs.program(), "lens", "draw", "pecs_lab_15mm", "-o", FOLDER / "lens.svg", "--focus", 1.56)
    for record in FOLDER.glob("*.run.json"):
        record.unlink()
    chip = pecs.Chip(CHIP)
    with pecs.StackReader(still) as reader:
        info, film = reader.info, reader.read_frame(0)[2]
    spectrum(info, chip)
    at_nm = f"{info['bands'][2]['lambda_nm']:.0f} nm"
    picture(film * 1e6, f"µW per m² and nm, at {at_nm}", "film.png", "viridis")
    picture(chip.photocurrent(still, frames=0) * 1e15, "fA", "photocurrent.png", mark=PIXEL)
    light_to_events(turning, chip)
    readout(turning)
    curve_between_frames()


if __name__ == "__main__":
    command(main)
