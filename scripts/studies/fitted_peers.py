#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Every pixel model fitted to the first half of a recording of the rotating disk, scored on its second half.

    scripts/studies/fitted_peers.py RECORDING [-o scripts/studies/fitted_peers.json] [--evaluations 1792]
    scripts/studies/fitted_peers.py BRIGHTER --keep scripts/studies/fitted_peers.json -o brighter.json

The disk is computed, not rendered, and each model fits its light, too (pecs_lab/fitted.py has the free values and
their ranges). All models have the same objective: the deviance of the recording's numbers of events, by polarity, 24
regions and 10 degrees of delay behind the edge, where the simulation's are expected (Poisson). All have the same
search: 256 points of a Sobol sequence over the ranges, then CMA-ES from its best two, 1,792 evaluations in all. No
model starts from its defaults.

`pecs as shipped` fits the light and the contrast alone; its other values were chosen on the whole recording.

With --keep, a recording of such a disk in other light is scored with the values of an earlier fit; only the lamp's
place, its brightness and the contrast are fitted to its first half.

Scores are of the second half, of every fourth pixel in x and y between 0.2 and 0.98 of the radius; the simulation has
another seed than in the fit. `recording` is the same recording's pixels beside those, scored as if they were a
simulation: the floor of each measure. Requires cma (PyPI). Two processes, about 15 minutes and 1 GB.
"""

import argparse
import json
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import disk_fit, fitted
from pecs_lab.disk import Disk
from pecs_lab.report import table
from scipy.stats import qmc, wasserstein_distance

STARTS, SOBOL, POPULATION = 2, 256, 16
FIT_COARSER, SCORE_COARSER = 6, 4
SHIPPED = "pecs as shipped"
KEPT_BRIGHTNESS = (0.1, 1e5)  # of another recording, in each model's unit
SLOWEST = ("voltmeter", "v2e", "pecs", "icns", SHIPPED, "esim")  # first


def deviance(real: np.ndarray, sim: np.ndarray) -> float:
    """Per event, of Poisson numbers `real` where `sim` is expected: that of the shares, and that of the total number.
    Half an event in each cell for what a simulation of this size cannot show; in the total number silence is wrong."""
    if sim.sum() == 0:
        return 100.0
    ratio = sim.sum() / real.sum()
    sim = sim / ratio + 0.5
    misses = np.where(real > 0, real * np.log(np.maximum(real, 1e-9) / sim), 0) - (real - sim)
    return float(2 * misses.sum() / real.sum() + 2 * (ratio - 1 - np.log(ratio)))


class Box:
    """Free values as points of the unit cube."""

    def __init__(self, ranges: dict):
        self.names = list(ranges)
        low, high = np.array(list(ranges.values())).T
        self.log = low > 0
        self.low, self.high = (np.where(self.log, np.log(np.maximum(v, 1e-300)), v) for v in (low, high))

    def values(self, x: np.ndarray) -> dict:
        at = self.low + np.clip(x, 0, 1) * (self.high - self.low)
        at = np.where(self.log, np.exp(np.where(self.log, at, 0)), at)
        return {k: float(f"{v:.4g}") for k, v in zip(self.names, at.tolist(), strict=True)}


def searches(kept: Path | None) -> dict[str, tuple[dict, dict]]:
    """(fixed values, free ranges) of each row. With `kept`, the light alone is free: SCENE and the brightness."""
    if not kept:
        shipped = {k: disk_fit.profile(fitted.CHIP)[k] for k in fitted.BOXES["pecs"] if k in fitted.OF_CHIP}
        light = fitted.SCENE | {"white_fa": fitted.BOXES["pecs"]["white_fa"]}
        return {SHIPPED: (shipped, light)} | {m: ({}, fitted.SCENE | box) for m, box in fitted.BOXES.items()}
    found = {}
    for name, row in json.loads(kept.read_text())["models"].items():
        if "values" in row:
            brightness = fitted.BRIGHTNESS.get(name.split()[0], "white_grey")
            light = fitted.SCENE | {brightness: KEPT_BRIGHTNESS}
            found[name] = {k: v for k, v in row["values"].items() if k not in light}, light
    return found


def fit(name: str, search: tuple, stage: fitted.Stage, seen: np.ndarray, evaluations: int) -> dict:
    """`seen`: numbers of the recording's events in `cells`, per pixel of the stage."""
    import cma

    warnings.filterwarnings("ignore", module="cma")
    (fixed, ranges), done, began = search, [], time.process_time()
    box = Box(ranges)

    def loss(x: np.ndarray) -> float:
        found, _ = half(
            stage.events(name.split()[0], fixed | box.values(x), 1, threads=1), stage.disk, 0, stage.duration_us
        )
        done.append((deviance(seen, cells(found, stage.disk)), np.clip(x, 0, 1)))
        return done[-1][0]

    points = qmc.Sobol(len(box.names), seed=1).random(SOBOL)
    starts = points[np.argsort([loss(x) for x in points])[:STARTS]]
    after_tried, ends = min(miss for miss, _ in done), []
    for i, start in enumerate(starts):
        options = {"bounds": [0, 1], "popsize": POPULATION, "seed": i + 1, "verbose": -9}
        before = len(done)
        cma.fmin2(loss, start, 0.2, options | {"maxfevals": (evaluations - SOBOL) // STARTS})
        ends.append(min(miss for miss, _ in done[before:]))
    miss, x = min(done, key=lambda d: d[0])
    at_bound = [k for k, v in zip(box.names, x.tolist(), strict=True) if min(v, 1 - v) < 0.01]
    spent = {"evaluations": len(done), "cpu_s": round(time.process_time() - began)}
    row = {"parameters": len(box.names), "objective": miss, "objective_after_sobol": after_tried}
    return row | {"objective_of_starts": ends, "at_bound": at_bound} | spent | {"values": fixed | box.values(x)}


def on_grid(events: np.ndarray, coarser: int, offset: int) -> np.ndarray:
    kept = events[(events["x"] % coarser == offset) & (events["y"] % coarser == offset)].copy()
    for axis in "xy":
        kept[axis] //= coarser
    return kept


def half(events: np.ndarray, disk: Disk, begin_us: float, end_us: float) -> tuple[np.ndarray, Disk]:
    """Its events in the ring, from 0 on, and the disk then."""
    radius = disk.polar(events["x"].astype(float), events["y"].astype(float))[1] / disk.radius_px
    inside = (radius > fitted.RING[0]) & (radius < fitted.RING[1])
    kept = np.sort(events[inside & (events["t"] >= begin_us) & (events["t"] < end_us)], order="t")
    kept["t"] -= round(begin_us)
    turned = disk.speed_deg_s * 1e-6 * round(begin_us)
    return kept, replace(disk, on_edge_deg=disk.on_edge_deg + turned, off_edge_deg=disk.off_deg + turned)


def intervals_decades(events: np.ndarray) -> np.ndarray:
    order = np.lexsort((events["t"], events["x"], events["y"]))
    e = events[order]
    same = (np.diff(e["x"].astype(int)) == 0) & (np.diff(e["y"].astype(int)) == 0)
    return np.log10(np.maximum(1, np.diff(e["t"].astype(np.int64))[same]))


def placed(events: np.ndarray, disk: Disk) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of ON and OFF events: delay behind the edge in degrees, sector of 12, ring of 4."""
    angle, radius = disk.polar(events["x"].astype(float), events["y"].astype(float))
    low, high = (share * disk.radius_px for share in fitted.RING)
    ring = np.clip((radius - low) / (high - low) * 4, 0, 3.99).astype(int)
    sector = ((angle + 180) // 30).astype(int) % 12
    found = []
    for p, edge in ((1, disk.on_edge_deg), (0, disk.off_deg)):
        delay = np.mod(disk.past_deg(angle, events["t"].astype(float), edge) + 10, disk.period_deg) - 10
        kept = (events["p"] == p) & (delay < 100)
        found.append((delay[kept], sector[kept], ring[kept]))
    return found


def cells(events: np.ndarray, disk: Disk) -> np.ndarray:
    """Numbers of events by polarity, 12 sectors, 2 rings, and 11 bins of 10 degrees of delay."""
    bins = [np.arange(13), np.arange(0, 5, 2), np.arange(-10, 101, 10)]
    return np.stack([np.histogramdd(np.stack([s, r, d], 1), bins)[0] for d, s, r in placed(events, disk)])


def medians_deg(delay: np.ndarray, sector: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """By region of 12 x 4; NaN below 20 events."""
    of = [delay[(sector == s) & (ring == r)] for s in range(12) for r in range(4)]
    return np.array([np.median(d) if len(d) >= 20 else np.nan for d in of])


def scores(real: np.ndarray, sim: np.ndarray, disk: Disk, stage: fitted.Stage, duration_us: float) -> dict:
    size = {"width": stage.width, "height": stage.height, "origin": "zero"}
    shared = pecs.compare(real, sim, disk=disk.detected, **size)
    result = {k: shared[k] for k in ("chamfer", "chamfer_interval", "gaussian", "gaussian_interval", "map_correlation")}
    result["split_half"] = shared["split_half"]
    kinds = zip(("on", "off"), placed(real, disk), placed(sim, disk), strict=True)
    for p, (delay_r, sector_r, ring_r), (delay_s, sector_s, ring_s) in kinds:
        of = shared["delays"][p]
        result[f"earth_mover_{p}_deg"], result[f"overlap_{p}"] = of["earth_mover_deg"], of["overlap"]
        rings = [(delay_r[ring_r == k], delay_s[ring_s == k]) for k in range(4)]
        result[f"rings_{p}_deg"] = [float(wasserstein_distance(a, b)) if len(b) else None for a, b in rings]
        result[f"ring_medians_{p}_deg"] = [[float(np.median(d)) if len(d) else None for d in ab] for ab in rings]
        medians = [medians_deg(delay_r, sector_r, ring_r), medians_deg(delay_s, sector_s, ring_s)]
        a, b = (m[np.isfinite(medians[0]) & np.isfinite(medians[1])] for m in medians)
        result[f"regions_{p}"] = len(a)
        result[f"median_rms_{p}_deg"] = float(np.sqrt(np.mean((a - b) ** 2))) if len(a) else None
        result[f"slope_{p}"] = float(np.cov(a, b)[0, 1] / a.var(ddof=1)) if len(a) > 2 else None
    result["deviance"] = deviance(cells(real, disk), cells(sim, disk))
    counts = [np.histogram(e["t"], np.arange(0, duration_us, 1000))[0] for e in (real, sim)]
    result["events_ratio"] = len(sim) / len(real)
    result["rate_rms"] = float(np.sqrt(np.mean(np.subtract(*counts) ** 2.0)) / counts[0].mean())
    gaps = [intervals_decades(e) for e in (real, sim)]
    result["interval_decades"] = float(wasserstein_distance(*gaps)) if all(map(len, gaps)) else None
    result["on_share"] = float((sim["p"] == 1).mean())
    return result


MEASURES = {
    "chamfer": "Chamfer (shared normalisation)",
    "gaussian": "Gaussian",
    "earth_mover_on_deg": "delays, ON, earth mover's distance, °",
    "earth_mover_off_deg": "delays, OFF, °",
    "overlap_on": "delays, ON, overlap",
    "overlap_off": "delays, OFF, overlap",
    "median_rms_on_deg": "median delay by region, ON, RMS, °",
    "median_rms_off_deg": "median delay by region, OFF, °",
    "slope_on": "slope of these medians on the recording's, ON",
    "slope_off": "slope, OFF",
    "deviance": "deviance per event",
    "events_ratio": "events / recorded",
    "on_share": "share of ON",
    "rate_rms": "rate over time, RMS / mean",
    "interval_decades": "intervals, decades",
    "map_correlation": "map, correlation",
}


def cell(value: float | None) -> str:
    return "–" if value is None or not np.isfinite(value) else f"{value:.3g}"


def scored(row: dict, key: str) -> str:
    low_high = row.get(f"{key}_interval")
    return cell(row[key]) + (" ({}…{})".format(*map(cell, low_high)) if low_high else "")


def tables(report: dict) -> list[str]:
    """Of docs/studies/validation.md: scores, rings, fits, values."""
    models = report["models"]
    halves = {name: row["second_half"] for name, row in models.items()}
    fits = {name: row for name, row in models.items() if "values" in row}
    measured = [[title, *(scored(of, key) for of in halves.values())] for key, title in MEASURES.items()]
    rings = [
        [f"{p.upper()}, ring {k + 1}", *(cell(of[f"rings_{p}_deg"][k]) for of in halves.values())]
        for p in ("on", "off")
        for k in range(4)
    ]
    spent = {"parameters": "values", "objective_after_sobol": "after Sobol", "objective": "objective"}
    searched = [
        [
            name,
            *(cell(row[k]) for k in spent),
            ", ".join(map(cell, row["objective_of_starts"])),
            ", ".join(row["at_bound"]),
        ]
        for name, row in fits.items()
    ]
    values = [[name, ", ".join(f"{k} {v:.3g}" for k, v in row["values"].items())] for name, row in fits.items()]
    return [
        table(["", *halves], measured),
        table(["", *halves], rings),
        table(["model", *spent.values(), "of each start", "at its bound"], searched),
        table(["model", "fitted values"], values),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--evaluations", type=int, default=1792)
    parser.add_argument(
        "--keep", type=Path, metavar="JSON", help="of another recording: its values, only light is fitted"
    )
    args = parser.parse_args()

    disk, events, duration_us, _ = disk_fit.examine(args.recording)
    middle_us = float(duration_us // 2)
    seen = cells(half(events, disk, 0, middle_us)[0], disk) / FIT_COARSER**2
    fit_stage = fitted.Stage(disk.coarser(FIT_COARSER), FIT_COARSER, middle_us)
    stage = fitted.Stage(disk.coarser(SCORE_COARSER), SCORE_COARSER, duration_us)
    real, disk_second = half(on_grid(events, SCORE_COARSER, SCORE_COARSER // 2), stage.disk, middle_us, duration_us)
    beside, _ = half(on_grid(events, SCORE_COARSER, SCORE_COARSER // 2 + 1), stage.disk, middle_us, duration_us)
    report = {"recording": Path(args.recording).name, "middle_us": middle_us, "duration_us": duration_us}
    report |= {"events_second_half": len(real), "models": {}}
    first = {"recording": {"second_half": scores(real, beside, disk_second, stage, middle_us)}}
    report["models"] |= first
    rows = searches(args.keep)
    with ProcessPoolExecutor(2) as pool:
        fits = {
            name: pool.submit(fit, name, rows[name], fit_stage, seen, args.evaluations)
            for name in sorted(rows, key=SLOWEST.index)
        }
        report["models"] |= {name: fits[name].result() for name in rows}
        args.output.write_text(json.dumps(report, indent=1) + "\n")
        for name in rows:
            row = report["models"][name]
            sim, _ = half(stage.events(name.split()[0], row["values"], 2), stage.disk, middle_us, duration_us)
            row["second_half"] = scores(real, sim, disk_second, stage, middle_us)
    args.output.write_text(json.dumps(report, indent=1) + "\n")
    print(*tables(report), sep="\n\n")


if __name__ == "__main__":
    main()
