#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Finds where the lab's lamp hangs, from a recording of the turning disk: parameters of scenes/rotating_disk.

    scripts/tools/fit_lamp.py RECORDING [--sequence scenes/rotating_disk/sequences/R_360_L.json] [--length-mm 1200]

The photoreceptor's corner follows the light, so the map of corners over the disk (`pecs fit --disk`) is one of
illuminance. A lamp in the plane lamp_up_mm above the axis that shines down gives a point of the disk, at depth d before
and h below an element of the lamp, d h / r^4 (Lambert twice); walls add a constant share, the lens takes cos^4 of the
field angle. Fitted are the lamp's place and the light; its length hardly shows (900 to 1500 mm fit alike) and is given.
--length-mm and --width-mm: of the lamp, left to right and across; --walls: light from the walls / mean light from the
lamp; --contrast: white / black of the disk.
"""

import json
from pathlib import Path

import numpy as np
from pecs_lab import computed_disk, lamp_fit
from pecs_lab.measure import command

ROOT = Path(__file__).resolve().parents[2]


def main(
    recording: str, *, sequence: Path = ROOT / "scenes/rotating_disk/sequences/R_360_L.json",
    length_mm: float = 1200, width_mm: float = 120, walls: float = 0.05, chip: str = "imx636", contrast: float = 12.0,
) -> None:  # fmt: skip
    disk = computed_disk.detect(recording)
    corner_hz = computed_disk.corner_map(recording, chip, contrast)

    p = json.loads(sequence.read_text())["parameters"]
    around, along = corner_hz.shape
    inner_px, outer_px = (share * disk.radius_px for share in computed_disk.RING)
    angle = np.radians(((np.arange(around) + 0.5) / around - 0.5) * 360)[:, None]
    radius_px = inner_px + (np.arange(along) + 0.5) / along * (outer_px - inner_px)
    radius_mm = p["disk_radius_mm"] / disk.radius_px * radius_px
    x = p["disk_right_mm"] + radius_mm * np.cos(angle)
    up = p["disk_up_mm"] + radius_mm * np.sin(angle)
    cos4 = (1 + (x**2 + up**2) / p["disk_distance_mm"] ** 2) ** -2
    area = np.broadcast_to(radius_mm / radius_mm.mean(), corner_hz.shape)

    size = {"lamp_length_mm": length_mm, "lamp_width_mm": width_mm}
    found, rms = lamp_fit.fit(corner_hz, x, up, cos4, area, size, walls)
    found = {key: round(value, 1) for key, value in found.items()}
    found["lamp_distance_mm"] = round(p["disk_distance_mm"] - found.pop("lamp_before_mm"), 1)
    low, middle, high = np.percentile(corner_hz, (0, 50, 100)).tolist()
    report = {"parameters": found, "rms_ln": rms}
    report |= {"corner_hz": {"min": low, "median": middle, "max": high}}
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    command(main)
