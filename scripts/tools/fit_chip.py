#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Fits a chip profile to a recording of a turning disk with black and white sectors, or checks how a profile does.

    scripts/tools/fit_chip.py RECORDING [--chip imx636] [--fit] [--write PROFILE.json] [--simulation OUT.raw]

The disk is computed, not rendered: centre, speed and phase come from `pecs align detect`; its light is a map over 24 x
4 regions, each region's light chosen so that the number of its events comes out right. Without --fit nothing but this
map is free. With it, thresholds, mismatch, noise and the disk's contrast are shared by all regions and fitted to the
histograms of the delays behind the edges (Nelder-Mead).

Model and recording are compared as by `pecs compare --disk` (docs/reference/metrics.md), background beside the disk
included.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import disk_fit


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("--chip", default="imx636")
    parser.add_argument("--contrast", type=float, default=12.0, help="white / black of the disk")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--rounds", type=int, default=80, help="of the fit")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", type=Path, help="the fitted profile")
    parser.add_argument("--simulation", type=Path, help="the simulated events")
    args = parser.parse_args()

    disk, events, duration_us, real = disk_fit.examine(args.recording)
    width, height = events.width, events.height
    overrides, contrast = {}, args.contrast
    if args.fit:
        overrides, contrast = disk_fit.fit(args.chip, real, disk, contrast, args.rounds)
    corner_hz = disk_fit.light_map(disk_fit.tabulate(args.chip, overrides, contrast, disk), real)
    size = {"width": width, "height": height}
    found = disk_fit.simulate(
        args.chip, overrides, disk, corner_hz, contrast, real, **size, duration_us=duration_us, seed=args.seed
    )
    sim = disk_fit.look(found, disk, width, height, duration_us)

    def compared(normalisation: str, **more: object) -> dict:
        sizes = size | {"split_half": False, "origin": "zero"}
        return pecs.compare(events, found, normalisation=normalisation, **sizes, **more)

    paper, eq16 = compared("paper", disk=disk.detected), compared("eq16")
    delays = paper["delays"]

    def by_polarity(key: str) -> dict:
        return {p: delays[p][key] for p in ("on", "off")}

    report = {
        "chip": args.chip,
        "fitted": overrides,
        "contrast": contrast,
        "corner_hz": {
            "min": float(corner_hz.min()),
            "median": float(np.median(corner_hz)),
            "max": float(corner_hz.max()),
        },
        "events": {"real": real.events, "simulated": sim.events},
        "events_per_edge": by_polarity("events_per_edge"),
        "delay_overlap": by_polarity("overlap"),
        "earth_mover_deg": by_polarity("earth_mover_deg"),
        "pair_sd_deg": {"real": delays["pair_sd_deg"]["real"], "simulated": delays["pair_sd_deg"]["sim"]},
        "background_hz": {"real": real.background_hz, "simulated": sim.background_hz},
        "paper": {k: paper[k] for k in ("chamfer", "gaussian")},
        "eq16": {k: eq16[k] for k in ("chamfer", "gaussian")},
    }
    print(json.dumps(report, indent=1))
    if args.simulation:
        pecs.write(args.simulation, found, width=width, height=height)
    if args.write:
        chip = json.loads(disk_fit.chip_file(args.chip).read_text())
        for key, value in overrides.items():
            chip["values"][key] |= {
                "value": value,
                "source": f"fitted to {Path(args.recording).name} by scripts/tools/fit_chip.py",
            }
        args.write.write_text(json.dumps(chip, indent=2) + "\n")


if __name__ == "__main__":
    main()
