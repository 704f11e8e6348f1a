#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Every pixel model fitted to the first half of a recording of the turning disk, scored on its second half.

    scripts/studies/fitted_peers.py RECORDING [-o fitted_peers.json] [--tried 64] [--rounds 320]

The disk is computed, not rendered (scripts/tools/fit_chip.py). Its light is one map for all models, found from the
first half with the chip as shipped, so that the map favours `pecs`. All models have the same objective, over ON and
OFF: the earth mover's distance between the histograms of delays behind the edges in units of 10 degrees, plus the
logarithm of the ratio of events per edge. All have the same search: `--tried` points of a Sobol sequence in the box of
PARAMETERS, then Nelder-Mead from the best four, `--rounds` evaluations in all. No model starts from its defaults.

Scores are of the second half, of every fourth pixel in x and y, in the ring of `pecs.delays`; the simulation has
another seed than in the fit. Writes JSON, and prints the tables of docs/studies/validation.md.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import disk_fit
from pecs_lab.disk import Disk
from pecs_lab.report import table
from scipy.optimize import minimize
from scipy.stats import qmc, wasserstein_distance

CHIP, CONTRAST, WARMUP_PERIODS, STEP_US = "imx636", 12.0, 4, 500.0
STARTS = 4
DEGREES = 10.0  # of delay count as much as a factor of e in the number of events
FIT_COARSER, SCORE_COARSER = 8, 4
THRESHOLDS = {"contrast_threshold_on": (0.1, 0.8), "contrast_threshold_off": (0.1, 0.8)}
MISMATCH, REFRACTORY = {"threshold_mismatch": (0.01, 0.299)}, {"refractory_period_s": (1e-6, 0.02)}
WHITE = {"white_fa": (0.5, 20.0)}  # photocurrent of grey 255; of `pecs`: what the light map is multiplied by
PARAMETERS = {
    "pecs": THRESHOLDS | MISMATCH | {"noise_std": (0.01, 0.2), "light": (0.25, 4.0)},
    "esim": THRESHOLDS | REFRACTORY | WHITE | {"log_eps": (1e-4, 1.0)},
    "v2e": THRESHOLDS | MISMATCH | REFRACTORY | WHITE | {"cutoff_hz": (0.5, 100.0), "linear_below": (1.0, 100.0)},
    "voltmeter": WHITE
    | {"k1": (0.3, 20.0), "k2": (0.1, 200.0), "k3": (1e-5, 0.1), "k4": (1e-9, 1e-5), "k6": (1e-6, 0.02)},
    "icns": THRESHOLDS | MISMATCH | REFRACTORY | WHITE | {"white_lux": (0.1, 1e4), "jitter_us": (1.0, 5e3)},
}  # fmt: skip
OF_CHIP = ("contrast_threshold_on", "contrast_threshold_off", "threshold_mismatch", "refractory_period_s", "noise_std")


class Stage:
    """The computed disk on every `coarser`-th pixel: light in fA, from the warm-up on."""

    def __init__(self, disk: Disk, coarser: int, corner_hz: np.ndarray, seen: disk_fit.Seen, duration_us: float):
        from scipy.ndimage import map_coordinates

        self.disk, of = disk.coarser(coarser), seen.delays["regions"]
        self.width, self.height, self.coarser = 1280 // coarser, 720 // coarser, coarser
        half = int(np.ceil(self.disk.radius_px))
        self.x0, self.y0 = (max(0, int(c) - half) for c in self.disk.centre_px)
        x1, y1 = min(self.width, self.x0 + 2 * half), min(self.height, self.y0 + 2 * half)
        yy, xx = np.mgrid[self.y0 : y1, self.x0 : x1].astype(float)
        angle, radius = self.disk.polar(xx, yy)
        around, along = seen.regions
        grid = np.pad(np.log(corner_hz).reshape(around, along), ((1, 1), (0, 0)), "wrap")
        u = (angle / 360 + 0.5) * around + 0.5
        v = (radius * coarser - of["inner_px"]) / (of["outer_px"] - of["inner_px"]) * along - 0.5
        kappa = disk_fit.profile(CHIP)["corner_hz_per_a"]
        white = np.exp(map_coordinates(grid, [u, v], order=1, mode="nearest")) / kappa * 1e15
        self.warmup_us = WARMUP_PERIODS * disk_fit.period_us(disk)
        self.t_us = np.arange(0, self.warmup_us + duration_us + 2 * STEP_US, STEP_US)
        self.duration_us = duration_us
        self.frames = np.empty((len(self.t_us), *white.shape), np.float32)
        for frame, t in zip(self.frames, self.t_us - self.warmup_us, strict=True):
            on, off = (self.disk.past_deg(angle, t, e) for e in (self.disk.on_edge_deg, self.disk.off_deg))
            frame[:] = np.where(radius > self.disk.radius_px, white / 3, np.where(on < off, white, white / CONTRAST))

    def events(self, model: str, values: dict, seed: int) -> np.ndarray:
        overrides = {k: v for k, v in values.items() if k in OF_CHIP}
        of_model = {k: v for k, v in values.items() if k not in OF_CHIP and k not in ("white_fa", "light")}
        ampere = 1e-15 * values["light"] if model == "pecs" else 1e-15
        frames, white = self.frames, values.get("white_fa")
        # A peer's frame is in units of its white, and `photocurrent_a` says so by its value 1.
        frames = frames if white is None else frames / np.float32(white)
        sensor = pecs.Sensor(
            *frames.shape[:0:-1], CHIP, model=model, parameters=of_model, overrides=overrides, photocurrent_a=ampere,
            seed=seed,
        )  # fmt: skip
        found = np.concatenate([sensor.push(frames, self.t_us), sensor.finish()])
        found["x"] += self.x0
        found["y"] += self.y0
        found["t"] -= round(self.warmup_us)
        return found[(found["t"] >= 0) & (found["t"] < self.duration_us)]


def on_grid(events: np.ndarray, coarser: int) -> np.ndarray:
    kept = events[(events["x"] % coarser == coarser // 2) & (events["y"] % coarser == coarser // 2)].copy()
    for axis in "xy":
        kept[axis] //= coarser
    return kept


def half(events: np.ndarray, disk: Disk, begin_us: float, end_us: float, ring: tuple) -> tuple[np.ndarray, Disk]:
    """Its events in the ring, from 0 on, and the disk then."""
    _, radius = disk.polar(events["x"].astype(float), events["y"].astype(float))
    inside = (radius > ring[0]) & (radius < ring[1]) & (events["t"] >= begin_us) & (events["t"] < end_us)
    kept = np.sort(events[inside], order="t")
    kept["t"] -= round(begin_us)
    turned = disk.speed_deg_s * 1e-6 * round(begin_us)
    return kept, replace(disk, on_edge_deg=disk.on_edge_deg + turned, off_edge_deg=disk.off_deg + turned)


def intervals_decades(events: np.ndarray) -> np.ndarray:
    order = np.lexsort((events["t"], events["x"], events["y"]))
    e = events[order]
    same = (np.diff(e["x"].astype(int)) == 0) & (np.diff(e["y"].astype(int)) == 0)
    return np.log10(np.maximum(1, np.diff(e["t"].astype(np.int64))[same]))


def medians_deg(events: np.ndarray, disk: Disk, ring: tuple) -> np.ndarray:
    """[ON or OFF, region of 12 x 4]: the median delay behind the edge; NaN below 8 events."""
    angle, radius = disk.polar(events["x"].astype(float), events["y"].astype(float))
    along = np.clip((radius - ring[0]) / (ring[1] - ring[0]) * 4, 0, 3.99).astype(int)
    region = ((angle + 180) // 30).astype(int) % 12 * 4 + along
    found = np.full((2, 48), np.nan)
    for row, (p, edge) in enumerate(((1, disk.on_edge_deg), (0, disk.off_deg))):
        delay = np.mod(disk.past_deg(angle, events["t"].astype(float), edge) + 10, disk.period_deg) - 10
        for k in range(48):
            of = delay[(events["p"] == p) & (region == k) & (delay < 100)]
            found[row, k] = np.median(of) if len(of) >= 8 else np.nan
    return found


def scores(real: np.ndarray, sim: np.ndarray, disk: Disk, stage: Stage, duration_us: float, ring: tuple) -> dict:
    size = {"width": stage.width, "height": stage.height, "origin": "zero"}
    shared = pecs.compare(real, sim, disk=disk.detected, **size)
    medians = [medians_deg(e, disk, ring) for e in (real, sim)]
    miss = np.sqrt(np.nanmean((medians[0] - medians[1]) ** 2, axis=1))
    bins = np.arange(0, duration_us, 1000)
    counts = [np.histogram(e["t"], bins)[0] for e in (real, sim)]
    result = {k: shared[k] for k in ("chamfer", "chamfer_interval", "gaussian", "gaussian_interval")}
    result["floor"] = shared["split_half"]
    for i, p in enumerate(("on", "off")):
        of = shared["delays"][p]
        result[f"earth_mover_{p}_deg"], result[f"overlap_{p}"] = of["earth_mover_deg"], of["overlap"]
        result[f"median_delay_rms_{p}_deg"] = float(miss[i])
        result[f"median_regions_{p}"] = int(np.isfinite(medians[0][i] - medians[1][i]).sum())
    result["events_ratio"] = len(sim) / len(real)
    result["rate_rms"] = float(np.sqrt(np.mean(np.subtract(*counts) ** 2.0)) / counts[0].mean())
    gaps = [intervals_decades(e) for e in (real, sim)]
    result["interval_decades"] = float(wasserstein_distance(*gaps)) if all(map(len, gaps)) else None
    result["on_share"] = [float((e["p"] == 1).mean()) for e in (real, sim)]
    return result


def objective(found: np.ndarray, stage: Stage, seen: disk_fit.Seen) -> float:
    size = {"width": stage.width, "height": stage.height, "duration_us": round(stage.duration_us)}
    delays, miss = pecs.delays(found, disk=stage.disk.detected, **size), 0.0
    for p, real in zip(("on", "off"), seen.histograms, strict=True):
        sim = np.array(delays[p]["histogram"])
        if sim.sum() == 0:
            return 100.0
        between = np.abs(np.cumsum(sim / sim.sum() - real / real.sum())).sum() * stage.disk.period_deg / 90
        miss += between / DEGREES + abs(np.log(sim.sum() / real.sum()))
    return float(miss)


def fit(model: str, stage: Stage, seen: disk_fit.Seen, tried: int, rounds: int) -> dict:
    names, box = list(PARAMETERS[model]), np.log(np.array(list(PARAMETERS[model].values())))
    done = []

    def loss(x: np.ndarray) -> float:
        values = dict(zip(names, np.exp(np.clip(x, *box.T)).tolist(), strict=True))
        found = np.sort(stage.events(model, values, 1), order="t")
        miss = objective(found, stage, seen) if len(found) else 100.0
        done.append(miss)
        return miss

    points = qmc.scale(qmc.Sobol(len(names), seed=1).random(tried), *box.T)
    order = np.argsort([loss(x) for x in points])
    after_tried, side, ends = min(done), 0.1 * (box[:, 1] - box[:, 0]), []
    for start in points[order[:STARTS]]:
        simplex = np.vstack([start, *(start + np.diag(np.where(start + side > box[:, 1], -side, side)))])
        options = {"maxfev": rounds // STARTS, "initial_simplex": simplex}
        ends.append(minimize(loss, start, method="Nelder-Mead", bounds=box, options=options))
    best = min(ends, key=lambda end: end.fun)
    values = {k: float(f"{v:.4g}") for k, v in zip(names, np.exp(best.x), strict=True)}
    at_bound = [k for k, x, of in zip(names, best.x, box, strict=True) if np.abs(of - x).min() < 0.01]
    spent = {"objective": best.fun, "objective_after_tried": after_tried, "evaluations": len(done)}
    return {"values": values, "at_bound": at_bound} | spent


MEASURES = {
    "chamfer": "Chamfer",
    "gaussian": "Gaussian",
    "earth_mover_on_deg": "delays ON, °",
    "earth_mover_off_deg": "OFF, °",
    "overlap_on": "overlap ON",
    "overlap_off": "OFF",
    "median_delay_rms_on_deg": "median by region ON, °",
    "median_delay_rms_off_deg": "OFF, °",
    "events_ratio": "events / recorded",
    "rate_rms": "rate over time",
    "interval_decades": "intervals, decades",
}


def cell(value: float | None) -> str:
    return "–" if value is None or np.isnan(value) else f"{value:.3g}"


def tables(report: dict) -> str:
    measured, fitted = [], []
    for name, row in report["models"].items():
        scored = row["second_half"]
        measured.append([name, *(cell(scored[k]) for k in MEASURES), cell(scored["on_share"][1])])
        values = ", ".join(
            f"{k} {v:.3g}" + (" (bound)" if k in row.get("at_bound", ()) else "") for k, v in row["values"].items()
        )
        fitted.append([name, row["parameters"], row["evaluations"], cell(row.get("objective")), values])
    head = ["model", *MEASURES.values(), f"ON share (recorded {scored['on_share'][0]:.3g})"]
    return table(head, measured) + "\n\n" + table(["model", "parameters", "evaluations", "objective", "values"], fitted)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("-o", "--output", type=Path, default=Path("fitted_peers.json"))
    parser.add_argument("--tried", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=320)
    args = parser.parse_args()

    disk, events, duration_us, _ = disk_fit.examine(args.recording)
    middle_us = float(duration_us // 2)
    first = events[events["t"] < middle_us]
    seen = disk_fit.look(first, disk, 1280, 720, middle_us)
    corner_hz = disk_fit.light_map(disk_fit.tabulate(CHIP, {}, CONTRAST, disk), seen)
    fit_stage = Stage(disk, FIT_COARSER, corner_hz, seen, middle_us)
    stage = Stage(disk, SCORE_COARSER, corner_hz, seen, duration_us)
    ring = tuple(seen.delays["regions"][k] / SCORE_COARSER for k in ("inner_px", "outer_px"))
    real = on_grid(events, SCORE_COARSER)
    real_second, disk_second = half(real, stage.disk, middle_us, duration_us, ring)
    real_first, _ = half(real, stage.disk, 0, middle_us, ring)
    halves = {"interval_decades": float(wasserstein_distance(*map(intervals_decades, (real_first, real_second))))}
    report = {"halves": halves, "middle_us": middle_us, "events_second_half": len(real_second), "models": {}}
    candidates = {m: lambda m=m: fit(m, fit_stage, seen, args.tried, args.rounds) for m in PARAMETERS}
    shipped = {k: disk_fit.profile(CHIP)[k] for k in OF_CHIP} | {"light": 1.0}
    candidates = {"pecs as shipped": lambda: {"values": shipped, "evaluations": 0}} | candidates
    for name, fitted in candidates.items():
        began, row = time.process_time(), fitted()
        sim, _ = half(stage.events(name.split()[0], row["values"], 2), stage.disk, middle_us, duration_us, ring)
        row["parameters"] = len(PARAMETERS.get(name, ()))
        row["second_half"] = scores(real_second, sim, disk_second, stage, middle_us, ring)
        row["cpu_s"] = time.process_time() - began
        report["models"][name] = row
        args.output.write_text(json.dumps(report, indent=1) + "\n")
    print(tables(report))


if __name__ == "__main__":
    main()
