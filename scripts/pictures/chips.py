#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/reference/chips.md and the figures in docs/reference/chips/, of every profile in sensor/chips and the readout.

scripts/pictures/chips.py
"""

from pathlib import Path

import numpy as np
import pecs
from figures import GREY, INK, OFF, ON, ROOT, plt, save
from pecs_lab.measure import ask
from pecs_lab.report import cell, table

LUX = (1, 10, 100, 1000, 10_000)
PREFACE = """# Chips

These are the profiles of `pecs chips` without [colour filters](sensor.md#colour-pixels).
`scripts/pictures/chips.py` writes this page from `sensor/chips/*.json`. [Sensor](sensor.md#chips) explains the keys.
`pecs chip info CHIP` prints the source of each value.

## From illuminance to photocurrent
A white surface (reflectance 1) in 3000 K light is seen through a lens at f/2. The table lists the photocurrent of a
pixel and the corner of its photoreceptor, as `pecs chip info CHIP --lux E --fnumber 2` prints them. The photocurrent is
proportional to E / N²: at f/4, it is a quarter.

"""
VALUES = """
## Values
After each value: **m** measured in a recording, **f** fitted to recordings or measurements, **p** published, o of
another chip or simulator, a assumed without a published figure. `ideal` has thresholds of 0.2, no noise, no limits and
any size.

"""


def confidence(chip: str, source: str) -> str:
    of_davis240c = "of a DAVIS240C (" in source or source.startswith("DAVIS240C (")
    if source.startswith(("assumed", "no published")):
        return "a"
    if source.startswith(("computed", "v2e", "fitted: to another")) or (of_davis240c and chip != "davis240c"):
        return "o"
    if source.startswith("fitted"):
        return "**f**"
    return "**m**" if of_davis240c or source.startswith(("R_360_L", "the recording")) else "**p**"


def light_table(names: list[str]) -> str:
    rows = []
    for name in names:
        lights = [ask("chip", "info", name, "--lux", lux, "--fnumber", 2)["light"] for lux in LUX]
        rows.append([name, *(f"{cell(1e15 * a['photocurrent_a'])} fA, {cell(a['corner_hz'])} Hz" for a in lights)])
    return table(["chip", *(f"{lux:,} lux" for lux in LUX)], rows) + "\n"


def value_table(infos: dict[str, dict]) -> str:
    values = {name: info["values"] for name, info in infos.items()}
    units = {key: entry["unit"] for of in values.values() for key, entry in sorted(of.items())}

    def of_chip(name: str, key: str) -> str:
        entry = values[name].get(key)
        return f"{entry['value']:.4g} {confidence(name, entry['source'])}" if entry else ""

    named = [(key, "" if unit == "1" else f", {unit}") for key, unit in sorted(units.items())]
    rows = [[f"`{key}`{unit}", *(of_chip(name, key) for name in infos)] for key, unit in named]
    return table(["value", *infos], rows) + "\n"


def draw(name: str, info: dict, path: Path) -> None:
    """Relative quantum efficiency; corner of the photoreceptor over the illuminance of the chip."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.4), layout="constrained")
    left.plot(info["relative_qe"]["lambda_nm"], info["relative_qe"]["value"], color=INK)
    left.set(xlabel="wavelength / nm", ylabel="relative QE", ylim=(0, 1.05), title=name)
    lux = np.logspace(-2, 4, 13)
    lights = [ask("chip", "info", name, "--lux", f"{e:.6g}")["light"] for e in lux]
    right.loglog(lux, [1e15 * light["photocurrent_a"] for light in lights], color=GREY, label="photocurrent / fA")
    if lights[0]["corner_hz"] is not None:
        right.loglog(lux, [light["corner_hz"] for light in lights], color=INK, label="corner / Hz")
    right.set(xlabel="illuminance of the chip / lux")
    right.legend()
    save(fig, path)


def draw_readout(path: Path) -> None:
    """Columns over time of a texture that moves, as davis346 reads them and as they would wait."""
    t_us, hz = 1000.0 * np.arange(100), np.fft.rfftfreq(346)
    noise = np.random.default_rng(1).standard_normal((260, 346))
    spectrum, moved = np.fft.rfft2(noise) * np.exp(-((15 * hz) ** 2)), 0.06 * np.arange(len(t_us))[:, None, None]
    frames = np.exp(2 * np.fft.irfft2(spectrum * np.exp(2j * np.pi * hz * moved), noise.shape))
    fig, axes = plt.subplots(1, 2, figsize=(7, 2.4), sharey=True, layout="constrained")
    ways = ("davis346", {}), ("columns as they wait", {"readout_idle_s": 0})
    for axis, (title, values) in zip(axes, ways, strict=True):
        events = pecs.simulate(frames, t_us, chip="davis346", photocurrent_a=1e-12, seed=1, overrides=values)
        shown = events[(events["t"] >= 90_000) & (events["t"] < 92_000)]
        colours = np.where(shown["p"] == 1, ON, OFF)
        axis.scatter(shown["t"] / 1000 - 90, shown["x"], s=0.5, c=colours)
        axis.set(title=title, xlabel="time / ms", xlim=(0, 2), ylim=(0, 346))
    axes[0].set_ylabel("x / px")
    save(fig, path)


def section(name: str, info: dict) -> str:
    names = ", ".join(info.get("trade_names", []))
    text = f"\n## {name}\n{info['description']}." + (f" Cameras and other names: {names}." if names else "")
    picture = f"![Relative quantum efficiency of {name}; photocurrent and corner over illuminance](chips/{name}.svg)"
    return f"{text}\n\n{picture}\n"


def main() -> None:
    names = [chip["name"] for chip in ask("chips")]
    infos = {name: ask("chip", "info", name) for name in names}
    infos = {name: info for name, info in infos.items() if "mosaic" not in info}
    for name, info in infos.items():
        draw(name, info, ROOT / f"docs/reference/chips/{name}.svg")
    draw_readout(ROOT / "docs/reference/chips/readout.png")
    real = {name: info for name, info in infos.items() if name != "ideal"}
    text = PREFACE + light_table(list(real)) + VALUES + value_table(real)
    text += "".join(section(name, info) for name, info in infos.items())
    (ROOT / "docs/reference/chips.md").write_text(text)


if __name__ == "__main__":
    main()
