#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""A chip profile compared with a recording of a turning disk. Only the light of the disk's regions is estimated, each
from its number of events. Model and recording are compared as by `pecs compare --disk` (docs/reference/metrics.md),
background around the disk included.

    scripts/studies/fit_disk.py R_360_L.hdf5 [--chip imx636] [--contrast 12] [--step 150] [--simulation OUT.raw]

--contrast: white / black of the disk; --step: us between the simulated frames; --simulation: the simulated events.
"""

from pathlib import Path

import numpy as np
import pecs
from pecs_lab import computed_disk
from pecs_lab.measure import command


def main(
    recording: str, *, chip: str = "imx636", contrast: float = 12.0, step: float = 150.0, simulation: Path | None = None
) -> dict:
    disk, events, duration_us = computed_disk.examine(recording)
    size = {"width": events.width, "height": events.height}
    corner_hz = computed_disk.corner_map(recording, chip, contrast)
    timing = {"duration_us": duration_us, "step_us": step}
    found = computed_disk.simulate(chip, {}, disk, corner_hz, contrast, **size, **timing, seed=1)
    if simulation:
        pecs.write(simulation, found, **size)
    options = size | {"split_half": False, "origin": "zero"}
    paper = pecs.compare(events, found, normalisation="paper", disk=disk.detected(float(events["t"][0])), **options)
    eq16 = pecs.compare(events, found, normalisation="eq16", **options)
    delays = paper["delays"]

    def by_polarity(key: str) -> dict:
        return {p: delays[p][key] for p in ("on", "off")}

    def background_hz(of: np.ndarray) -> list[float]:
        yy, xx = np.mgrid[: size["height"], : size["width"]].astype(float)
        seconds = (disk.polar(xx, yy)[1] > disk.radius_px + 34).sum() * duration_us * 1e-6
        quiet = disk.polar(of["x"].astype(float), of["y"].astype(float))[1] > disk.radius_px + 34
        return [float((quiet & (of["p"] == p)).sum() / seconds) for p in (1, 0)]

    return {
        "chip": chip,
        "contrast": contrast,
        "corner_hz": dict(zip(("min", "median", "max"), np.percentile(corner_hz, (0, 50, 100)).tolist(), strict=True)),
        "events": {"real": len(events), "simulated": len(found)},
        "events_per_edge": by_polarity("events_per_edge"),
        "delay_overlap": by_polarity("overlap"),
        "earth_mover_deg": by_polarity("earth_mover_deg"),
        "pair_sd_deg": {"real": delays["pair_sd_deg"]["real"], "simulated": delays["pair_sd_deg"]["sim"]},
        "background_hz": {"real": background_hz(events), "simulated": background_hz(found)},
        "paper": {k: paper[k] for k in ("chamfer", "gaussian")},
        "eq16": {k: eq16[k] for k in ("chamfer", "gaussian")},
    }


if __name__ == "__main__":
    command(main)
