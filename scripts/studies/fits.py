#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Pixel models fitted alike to a half of a recording of the rotating disk, and scored on what the fit did not see.
Results are in fits.json (docs/studies/validation.md); each part prints its tables.

    scripts/studies/fits.py peers R_360_L.hdf5          fitted to the first half, scored on the second: 15 minutes, 2 GB
    scripts/studies/fits.py over_light                  the same values on NIST's delays and published noise: 2 minutes
    scripts/studies/fits.py realism R_360_L.hdf5        whether a classifier tells them apart: 2 minutes, 1 GB

    [--output FILE] [--only MODEL ...] [--evaluations N]

A model that FILE has is not fitted again, unless --only names it: then it is, and no other one. `pecs as shipped` has
the light and the contrast fitted alone. In over_light, the lamp's brightness relative to the recording's is not known
to a model without units: each peer has the best of 13, `pecs` the white of its fit. All fits require cma (PyPI).
"""

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import computed_disk, fitted, over_light
from pecs_lab.disk_scores import MEASURES, Part, between, on_grid
from pecs_lab.fitted import FIT_COARSER, SCORE_COARSER, Halves, fit
from pecs_lab.measure import command
from pecs_lab.report import cell, table, with_interval, write

RESULTS = Path(__file__).with_suffix(".json")
SHIPPED = "pecs as shipped"
SLOWEST = ("voltmeter", "v2e", "pecs", "icns", SHIPPED, "esim")  # first
TRIED_FA = np.geomspace(1, 1000, 13)  # photocurrent of the recording's white
SILENT = 1000.0  # a delay that is not there counts as wrong by this factor
DASH = "–"
SCENE_LUX = 148.0  # of R_360_L


def chosen(names: list[str], known: dict, only: list[str]) -> list[str]:
    return only or [name for name in names if name not in known]


# Fitted to the first half, scored on the second.


def searches() -> dict[str, tuple[dict, dict]]:
    """(fixed values, free ranges) of each row."""
    shipped = {k: computed_disk.profile(fitted.CHIP)[k] for k in fitted.BOXES["pecs"] if k in fitted.OF_CHIP}
    light = fitted.SCENE | {"white_fa": fitted.BOXES["pecs"]["white_fa"]}
    return {SHIPPED: (shipped, light)} | {m: ({}, fitted.SCENE | box) for m, box in fitted.BOXES.items()}


def peers(rows: dict, recording: str, only: list[str], evaluations: int, **_: str) -> list[str]:
    halves, ranges = Halves(recording), searches()
    scored, floor = halves.scored()
    rows["recording"] = {"scores": floor}
    what = halves.stage(FIT_COARSER, halves.first), halves.first, halves.target(halves.first), evaluations or 1792
    again = sorted(chosen(list(ranges), rows, only), key=SLOWEST.index)
    with ProcessPoolExecutor(2) as pool:
        fits = {name: pool.submit(fit, name, ranges[name], *what) for name in again}
        rows |= {name: of.result() for name, of in fits.items()}
    stage = halves.stage(SCORE_COARSER, halves.second)
    for name in again if only else ranges:
        events = halves.of_second(stage.events(name.split()[0], rows[name]["values"], 2))
        rows[name]["scores"] = scored.scores(events)
    return peer_tables(rows)


def peer_tables(rows: dict) -> list[str]:
    """Scores, fits, values."""
    rows = {name: rows[name] for name in ("recording", SHIPPED, *fitted.BOXES) if name in rows}
    fits = {name: row for name, row in rows.items() if "values" in row}
    spent = {"parameters": "values", "objective_after_sobol": "after Sobol", "objective": "objective"}
    starts = {name: ", ".join(map(cell, row["objective_of_starts"])) for name, row in fits.items()}
    searched = [[n, *(cell(r[k]) for k in spent), starts[n], ", ".join(r["at_bound"])] for n, r in fits.items()]
    values = [[name, ", ".join(f"{k} {v:.3g}" for k, v in row["values"].items())] for name, row in fits.items()]
    scores = [[title, *(with_interval(row["scores"][key]) for row in rows.values())] for key, title in MEASURES.items()]
    return [
        table(["", *rows], scores),
        table(["model", *spent.values(), "of each start", "at its bound"], searched),
        table(["model", "fitted values"], values),
    ]


# In light that the fit did not see.


def misfit(ratio: dict[str, list]) -> float:
    """Root mean square of ln of the ratio, as a factor."""
    each = [np.log(SILENT if r is None else r) for of in ratio.values() for r in of]
    return float(np.exp(np.sqrt(np.mean(np.square(each)))))


def in_light(model: str, values: dict) -> dict:
    whites = [values["white_fa"]] if model == "pecs" else TRIED_FA
    scale = fitted.sensor(model, values, 1, 1)[1]

    def sensor(width: int, height: int, seed: int = 1) -> pecs.Sensor:
        return fitted.sensor(model, values, width, height, seed=seed)[0]

    delays = ((over_light.median_delays_us(sensor, scale / w), float(w)) for w in whites)
    ratio, white_fa = min(((over_light.ratios(of), w) for of, w in delays), key=lambda tried: misfit(tried[0]))
    noise = over_light.noise_hz(partial(sensor, seed=3), scale / white_fa)
    return {"white_fa": white_fa, "delay_ratio": ratio, "delay_factor": misfit(ratio), "noise_hz": noise}


def over_lights(rows: dict, fits: dict, only: list[str], **_: object) -> list[str]:
    with ProcessPoolExecutor(2) as pool:
        names = only or [name for name in fits if "values" in fits[name]]
        found = {name: pool.submit(in_light, name.split()[0], fits[name]["values"]) for name in names}
        rows |= {name: of.result() for name, of in found.items()}
    delays, noise, published = [], [], over_light.PUBLISHED_HZ
    for name, row in rows.items():
        for p in ("on", "off"):
            cells = [DASH if r is None else f"{r:.2f}" for r in row["delay_ratio"][p]]
            delays.append([name, p.upper(), *cells, f"{row['delay_factor']:.2f}", f"{row['white_fa']:.2g}"])
            noise.append([name, p.upper(), *(f"{hz:.2g}" for hz in row["noise_hz"][p])])
    noise += [["published", p.upper(), *of] for p, of in published.items()]
    for p, of in published.items():
        ratio = np.divide(rows["pecs"]["noise_hz"][p], of)
        noise.append(["pecs / published", p.upper(), *(f"{r:.2f}" for r in ratio)])
    head = ["model", "", *over_light.IRRADIANCE_W_M2, "typical factor", "white, fA"]
    return [table(head, delays), table(["model", "", *over_light.LUX], noise)]


# A classifier.


def realism(rows: dict, fits: dict, recording: str, only: list[str], **_: object) -> list[str]:
    """The whole recording in the ring of the disk, on the grid of the scores. `NAME, defaults`: the light and the chip
    of `pecs as shipped`, each model's own defaults."""
    halves = Halves(recording)
    stage = halves.stage(SCORE_COARSER, Part(0, halves.duration_us))
    whole = halves.disk.coarser(SCORE_COARSER), 0, halves.duration_us
    real = between(on_grid(halves.events, SCORE_COARSER, 1), *whole)[0]
    known = fits[SHIPPED]["values"] | {"white_lux": SCENE_LUX}
    models = {name: fits[name]["values"] for name in (SHIPPED, *fitted.BOXES)}
    models |= {f"{name}, defaults": known for name in fitted.BOXES if name != "pecs"}
    for name in chosen(list(models), rows, only):
        events = between(stage.events(name.split(",")[0].split()[0], models[name], 2), *whole)[0]
        size = {"width": stage.width, "height": stage.height, "origin": "zero", "split_half": False}
        found = pecs.compare(real, events, realism=True, **size)["realism"] or {}
        rows[name] = found and found | {"cues": {cue: one["auc"] for cue, one in found["cues"].items()}}
    cells = []
    for name, row in rows.items():
        of = [row, row["floor"]] if row else []
        named = ", ".join(row["named"]) if row else "silent"
        areas = (with_interval([r["auc"], *r["interval"]]) if r else DASH for r in of)
        cells.append([name, *areas, named])
        cells[-1] += map(cell, row["cues"].values() if row else [])
    cues = next(row for row in rows.values() if row)["cues"]
    return [table(["simulation", "area", "recording against itself", "named", *cues], cells)]


PARTS = {"peers": peers, "over_light": over_lights, "realism": realism}


def main(part: str, recording: str = "", *, output: Path = RESULTS, only: list[str] = (), evaluations: int = 0) -> None:
    if part not in PARTS:
        sys.exit(f"fits.py: got {part}, wanted one of {', '.join(PARTS)}")
    report = json.loads(output.read_text()) if output.exists() else {}
    rows, fits = report.setdefault(part, {}), report.get("peers", {})
    tables = PARTS[part](rows, fits=fits, recording=recording, only=only, evaluations=evaluations)
    write(output, report)
    print(*tables, sep="\n\n")


if __name__ == "__main__":
    command(main)
