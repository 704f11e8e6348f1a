#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/reference/chips.md and the figures in docs/reference/chips/, of every profile in sensor/chips.

scripts/pictures/chips.py
"""

from pathlib import Path

import numpy as np
from figures import GREY, INK, ROOT, plt, save
from pecs_lab.measure import ask
from pecs_lab.report import cell, table

LUX = (1, 10, 100, 1000, 10_000)
FNUMBERS = (1.4, 2, 4)
PREFACE = """# Chips

These are the profiles of `pecs chips` without [colour filters](sensor.md#colour-pixels), with all
values and sources. `scripts/pictures/chips.py` writes this page from
`sensor/chips/*.json`. [Sensor](sensor.md#chips) explains the keys.

The confidence follows from the source: *assumed* without a published figure, *fitted* to recordings,
*measured* in one, *published* otherwise.

## From illuminance to photocurrent
A white surface (reflectance 1) in 3000 K light is seen through a lens. The table lists the photocurrent of a pixel and
the corner of its photoreceptor, as `pecs chip info CHIP --lux E --fnumber N` prints them. The photocurrent is
proportional to E / N².

"""


def confidence(source: str) -> str:
    if source.startswith(("assumed", "no published")):
        return "assumed"
    if source.startswith(("R_360_L", "the recording")):
        return "measured"
    return "fitted" if source.startswith("fitted") else "published"


def light_table(names: list[str]) -> str:
    rows = []
    for name in names:
        for fnumber in FNUMBERS:
            lights = [ask("chip", "info", name, "--lux", lux, "--fnumber", fnumber)["light"] for lux in LUX]
            cells = [f"{cell(1e15 * light['photocurrent_a'])} fA, {cell(light['corner_hz'])} Hz" for light in lights]
            rows.append([name, f"{fnumber:g}", *cells])
    return table(["chip", "f-number", *(f"{lux:,} lux" for lux in LUX)], rows) + "\n"


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


def section(name: str, info: dict) -> str:
    rows = []
    for key, entry in info["values"].items():
        unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
        rows.append([f"`{key}`", f"{entry['value']:.4g}{unit}", confidence(entry["source"]), entry["source"]])
    names = ", ".join(info.get("trade_names", []))
    text = f"\n## {name}\n{info['description']}." + (f" Cameras and other names: {names}." if names else "")
    picture = f"![Relative quantum efficiency of {name}; photocurrent and corner over illuminance](chips/{name}.svg)"
    return text + f"\n\n{picture}\n\n" + table(["value", "", "confidence", "source"], rows) + "\n"


def main() -> None:
    names = [chip["name"] for chip in ask("chips")]
    infos = {name: ask("chip", "info", name) for name in names}
    infos = {name: info for name, info in infos.items() if "mosaic" not in info}
    for name, info in infos.items():
        draw(name, info, ROOT / f"docs/reference/chips/{name}.svg")
    text = PREFACE + light_table([name for name in infos if name != "ideal"])
    text += "".join(section(name, info) for name, info in infos.items())
    (ROOT / "docs/reference/chips.md").write_text(text)


if __name__ == "__main__":
    main()
