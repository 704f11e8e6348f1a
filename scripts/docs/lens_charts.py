#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""docs/reference/lenses.md and the charts in docs/reference/lenses/, of every lens in lens_data/lenses.

.venv/bin/python scripts/docs/lens_charts.py    (needs build/release/bin/pecs, or build/dev/bin/pecs)
"""

import json
import subprocess
from pathlib import Path

import pecs

ROOT = Path(__file__).resolve().parents[2]
FILMS_MM = ((36.0, 24.0), (6.2208, 3.4992))  # full frame; 1280 x 720 pixels of 4.86 um
LEAST_LIGHT = 0.02  # of the corner, relative to the middle
PREFACE = """# The shipped lenses
Written by `scripts/docs/lens_charts.py`. Focus at infinity, wide open. Film: the larger of 36 x 24 mm and
6.2208 x 3.4992 mm (1280 x 720 pixels of 4.86 um) that the lens lights to its corners. Field: the film's diagonal.
Distortion, illumination and spot at 587.6 nm; the spot on the axis and in the corner, RMS. Each prescription lists what
is estimated in it (housing radii, matched glasses). A C-mount leaves 17.5 mm behind its flange: the choice from 5 to
50 mm is the `cmount_*` lenses and `dgauss_50mm_tronnier`.

| lens | EFL mm | f-number | BFL mm | film mm | field deg | corner light | distortion % | spot um |
|---|---|---|---|---|---|---|---|---|
"""


def covered(name):
    """The largest film that a lens of lens_data lights to its corners, and its `Lens.info` there."""
    with pecs.Lens(name) as lens:
        for width, height in FILMS_MM:
            info = lens.info(lambda_nm=587.5618, field_rows=9, film_width_mm=width, film_height_mm=height)
            if info["field"][-1]["relative_illumination"] > LEAST_LIGHT:
                return (width, height), info
    raise SystemExit(f"{name}: lights no film of {FILMS_MM} mm")


def main():
    charts = ROOT / "docs/reference/lenses"
    charts.mkdir(exist_ok=True)
    rows, sections = "", ""
    for path in sorted((ROOT / "lens_data/lenses").glob("*.json")):
        name, lens = path.stem, json.loads(path.read_text())
        film_mm, info = covered(name)
        film = " x ".join(f"{side:.2f}".removesuffix(".00") for side in film_mm)
        corner, axis = info["field"][-1], info["field"][0]
        rows += (
            f"| [{name}](#{name}) | {info['efl_mm']:.3f} | {info['fnumber']:.2f} | {info['bfl_mm']:.2f} | {film} "
            f"| {2 * corner['angle_deg']:.1f} | {corner['relative_illumination']:.3f} "
            f"| {corner['distortion_percent']:.2f} "
            f"| {axis['rms_spot_um'][0]:.1f} / {corner['rms_spot_um'][0]:.1f} |\n"
        )
        chart = charts / f"{name}.svg"
        film_options = [f"--film-width={film_mm[0]}", f"--film-height={film_mm[1]}"]
        command = [pecs.program(), "lens", "chart", name, "-o", chart, *film_options]
        subprocess.run(command, check=True, capture_output=True)
        chart.with_name(f"{chart.name}.run.json").unlink()
        source = "; ".join(str(v) for v in lens["source"].values())
        sections += f"\n## {name}\n{lens['name']}. {source}.\n\n![chart of {name}](lenses/{name}.svg)\n"
    (ROOT / "docs/reference/lenses.md").write_text(PREFACE + rows + sections)


if __name__ == "__main__":
    main()
