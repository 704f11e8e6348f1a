"""Where the lab's lamp hangs, from a recording of the turning disk: parameters of scenes/rotating_disk.

    python tools/fit_lamp.py RECORDING [--sequence scenes/rotating_disk/sequences/R_360_L.json] [--length-mm 1200]

The photoreceptor's corner follows the light, so fit_chip.py's map of corners over the disk is one of illuminance. A
lamp in the plane lamp_up_mm above the axis that shines down gives a point of the disk, at depth d before and h below
an element of the lamp, d h / r^4 (Lambert twice); walls add a constant share, the lens takes cos^4 of the field angle.
Fitted are the lamp's place and the light; its length hardly shows (900 to 1500 mm fit alike) and is given.
"""

import argparse
import json
from pathlib import Path

import fit_chip
import numpy as np
from scipy.optimize import least_squares

ROOT = Path(__file__).resolve().parents[1]
ELEMENTS = (24, 3)  # of the lamp, along its length and width


def illuminance(x_mm: np.ndarray, up_mm: np.ndarray, lamp: dict, walls: float) -> np.ndarray:
    """Relative, at points of the disk's plane; lamp_before_mm: in front of that plane."""
    along, across = (((np.arange(n) + 0.5) / n - 0.5) for n in ELEMENTS)
    total = 0
    for right in lamp["lamp_right_mm"] + lamp["lamp_length_mm"] * along:
        for d in lamp["lamp_before_mm"] + lamp["lamp_width_mm"] * across:
            h = lamp["lamp_up_mm"] - up_mm
            total = total + d * h / ((right - x_mm) ** 2 + h**2 + d**2) ** 2
    return total / total.mean() + walls


def fit(corner_hz, x_mm, up_mm, cos4, area, size: dict, walls: float) -> tuple[dict, float]:
    """The lamp, and the RMS of what ln of the light misses; `area`: of the map's regions, relative."""
    root = np.sqrt(area)

    def lamp(v: np.ndarray) -> dict:
        return dict(zip(("lamp_right_mm", "lamp_up_mm", "lamp_before_mm"), v.tolist(), strict=True)) | size

    def misses(v: np.ndarray) -> np.ndarray:
        ratio = np.log(illuminance(x_mm, up_mm, lamp(v), walls) * cos4 / corner_hz)
        return ((ratio - np.average(ratio, weights=area)) * root).ravel()

    starts = [(right, above, before) for right in (-300, 300) for above in (200, 500) for before in (200, 500)]
    bounds = (-3000, up_mm.max() + 5, size["lamp_width_mm"]), (3000, 3000, 3000)  # above the disk and before it
    best = min((least_squares(misses, s, bounds=bounds) for s in starts), key=lambda found: found.cost)
    return lamp(best.x), float(np.sqrt(np.mean(best.fun**2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("--sequence", type=Path, default=ROOT / "scenes/rotating_disk/sequences/R_360_L.json")
    parser.add_argument("--length-mm", type=float, default=1200, help="of the lamp, left to right")
    parser.add_argument("--width-mm", type=float, default=120)
    parser.add_argument("--walls", type=float, default=0.05, help="light from the walls / mean light from the lamp")
    parser.add_argument("--program", default="build/release/bin/pecs")
    parser.add_argument("--chip", default="imx636")
    parser.add_argument("--contrast", type=float, default=12.0, help="white / black of the disk")
    args = parser.parse_args()

    disk, _, _, seen, real = fit_chip.examine(args.program, args.recording)
    table = fit_chip.tabulate(args.chip, {}, args.contrast, disk)
    corner_hz = fit_chip.light_map(table, real.region_events, seen).reshape(fit_chip.REGIONS)

    p = json.loads(args.sequence.read_text())["parameters"]
    mm_per_px = p["disk_radius_mm"] / (disk.radius + 6)
    around, along = fit_chip.REGIONS
    angle = np.radians((np.arange(around) + 0.5) / around * 360)[:, None]
    radius_mm = mm_per_px * (disk.inner + (np.arange(along) + 0.5) / along * (disk.radius - disk.inner))
    x = p["disk_right_mm"] + radius_mm * np.cos(angle)
    up = p["disk_up_mm"] + radius_mm * np.sin(angle)
    cos4 = (1 + (x**2 + up**2) / p["disk_distance_mm"] ** 2) ** -2
    area = np.broadcast_to(radius_mm / radius_mm.mean(), corner_hz.shape)

    size = {"lamp_length_mm": args.length_mm, "lamp_width_mm": args.width_mm}
    found, rms = fit(corner_hz, x, up, cos4, area, size, args.walls)
    found = {key: round(value, 1) for key, value in found.items()}
    found["lamp_distance_mm"] = round(p["disk_distance_mm"] - found.pop("lamp_before_mm"), 1)
    low, middle, high = np.percentile(corner_hz, (0, 50, 100)).tolist()
    report = {"parameters": found, "rms_ln": rms}
    report |= {"corner_hz": {"min": low, "median": middle, "max": high}}
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
