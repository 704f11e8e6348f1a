#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Pixel models fitted alike to a half of a recording of the rotating disk, and scored on what the fit did not see.
Results are in fits.json (docs/studies/validation.md, blind_spots.md); each part prints its tables.

    scripts/studies/fits.py peers R_360_L.hdf5          fitted to the first half, scored on the second: 15 minutes, 2 GB
    scripts/studies/fits.py over_light                  the same values on NIST's delays and published noise: 2 minutes
    scripts/studies/fits.py blind_spots R_360_L.hdf5    which error changes which measure: 2 minutes
    scripts/studies/fits.py programs R_360_L.hdf5 --v2e PATH --icns PATH    programs instead of models: 15 minutes
    scripts/studies/fits.py peers BRIGHTER.hdf5 --keep scripts/studies/fits.json --output brighter.json

    scripts/studies/fits.py realism R_360_L.hdf5        whether a classifier tells them apart: 2 minutes, 1 GB

    [--output FILE] [--only MODEL ...] [--evaluations N]

A model that FILE has is not fitted again, unless --only names it: then it is, and no other one. `pecs as shipped` has
the light and the contrast fitted alone. --keep: a recording in other light, with the values of an earlier fit but for
the light. In over_light, the lamp's brightness relative to the recording's is not known to a model without units: each
peer has the best of 13, `pecs` the white of its fit. programs: of checkouts of github.com/SensorsINI/v2e and
neuromorphicsystems/IEBCS, with the values of their models, and a second search from there; by a Python that has what
they require and PYTHONPATH=python:scripts/lab. All fits require cma (PyPI).
"""

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from copy import copy
from functools import partial
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import computed_disk, fitted, over_light
from pecs_lab.disk import Disk
from pecs_lab.disk_scores import MEASURES, Part, between, on_grid, region, seen
from pecs_lab.fitted import FIT_COARSER, SCORE_COARSER, Halves, Stage, fit
from pecs_lab.measure import command
from pecs_lab.peers import options_of
from pecs_lab.report import cell, table, with_interval, write

RESULTS = Path(__file__).with_suffix(".json")
SHIPPED = "pecs as shipped"
SLOWEST = ("voltmeter", "v2e", "pecs", "icns", SHIPPED, "esim")  # first
KEPT_BRIGHTNESS = (0.1, 1e5)  # of another recording, in each model's unit
TRIED_FA = np.geomspace(1, 1000, 13)  # photocurrent of the recording's white
SILENT = 1000.0  # a delay that is not there counts as wrong by this factor
DASH = "–"
SCENE_LUX = 148.0  # of R_360_L


def chosen(names: list[str], known: dict, only: list[str]) -> list[str]:
    return only or [name for name in names if name not in known]


def score_table(columns: dict[str, dict]) -> str:
    return table(["", *columns], [[t, *(with_interval(of[k]) for of in columns.values())] for k, t in MEASURES.items()])


# Fitted to the first half, scored on the second.


def searches(kept: Path | None) -> dict[str, tuple[dict, dict]]:
    """(fixed values, free ranges) of each row. With `kept`, the light alone is free: SCENE and the brightness."""
    if not kept:
        shipped = {k: computed_disk.profile(fitted.CHIP)[k] for k in fitted.BOXES["pecs"] if k in fitted.OF_CHIP}
        light = fitted.SCENE | {"white_fa": fitted.BOXES["pecs"]["white_fa"]}
        return {SHIPPED: (shipped, light)} | {m: ({}, fitted.SCENE | box) for m, box in fitted.BOXES.items()}
    found = {}
    for name, row in json.loads(kept.read_text())["peers"].items():
        if "values" in row:
            light = fitted.SCENE | {fitted.BRIGHTNESS.get(name.split()[0], "white_grey"): KEPT_BRIGHTNESS}
            found[name] = {k: v for k, v in row["values"].items() if k not in light}, light
    return found


def peers(rows: dict, recording: str, only: list[str], evaluations: int, keep: Path | None, **_: str) -> list[str]:
    halves, ranges = Halves(recording), searches(keep)
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
    return [
        score_table({name: row["scores"] for name, row in rows.items()}),
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


# One known error at a time.


def shuffled(events: np.ndarray, disk: Disk, duration_us: float, random: np.random.Generator) -> np.ndarray:
    """Times, the delays of each region and polarity exchanged among its events; old times where the new one is out of
    the window."""
    of, old = seen(events, disk), events["t"].astype(float)
    group, new = np.where(np.isfinite(of["delay"]), region(of) * 2 + of["p"], -1), old.copy()
    for g in np.unique(group[group >= 0]):
        mine = np.flatnonzero(group == g)
        later = of["delay"][random.permutation(mine)] - of["delay"][mine]
        new[mine] += later / abs(disk.speed_deg_s) * 1e6
    return np.where((new >= 0) & (new < duration_us), new, old)


def spoiled(events: np.ndarray, disk: Disk, duration_us: float) -> dict[str, np.ndarray]:
    random = np.random.default_rng(1)

    def changed(t: np.ndarray) -> np.ndarray:
        out = events.copy()
        out["t"] = np.maximum(t, 0)
        return np.sort(out[(t >= 0) & (t < duration_us)], order="t", kind="stable")

    swapped = events.copy()
    swapped["p"] = 1 - swapped["p"]
    return {
        "1 ms late": changed(events["t"].astype(float) + 1000),
        "half dropped": events[random.random(len(events)) < 0.5],
        "ON and OFF swapped": swapped,
        "delays shuffled": changed(shuffled(events, disk, duration_us, random)),
    }


def wrong_simulations(stage: Stage, values: dict) -> dict[str, np.ndarray]:
    thresholds = {k: 1.2 * values[k] for k in ("contrast_threshold_on", "contrast_threshold_off")}
    uniform = copy(stage)
    uniform.light = lambda _: np.ones(len(stage.x), np.float32)
    return {
        "pecs": stage.events("pecs", values, 2),
        "thresholds + 20 %": stage.events("pecs", values | thresholds, 2),
        "light - 20 %": stage.events("pecs", values | {"white_fa": 0.8 * values["white_fa"]}, 2),
        "one speed": uniform.events("pecs", values, 2),
    }


def blind_spots(rows: dict, fits: dict, recording: str, **_: object) -> list[str]:
    """Errors of events in the recording's pixels between those that are scored, whose own score is the floor; errors of
    the simulation in the fitted `pecs`. Bold: outside the interval of what it was made from."""
    halves = Halves(recording)
    scored, rows["recording"] = halves.scored()
    beside, disk = halves.beside()
    for name, changed in spoiled(beside, disk, scored.duration_us).items():
        rows[name] = scored.scores(changed, disk)
    stage = halves.stage(SCORE_COARSER, halves.second)
    for name, found in wrong_simulations(stage, fits["pecs"]["values"]).items():
        rows[name] = scored.scores(halves.of_second(found))

    def shown(name: str, key: str) -> str:
        base = "recording" if list(rows).index(name) < list(rows).index("pecs") else "pecs"
        value, (_, *ends) = rows[name][key][0], rows[base][key]
        moved = value is None or (ends and not ends[0] <= value <= ends[1])
        return f"**{cell(value)}**" if name != base and moved else cell(value)

    return [table(["", *rows], [[title, *(shown(name, key) for name in rows)] for key, title in MEASURES.items()])]


# The programs instead of their models.


def run_program(peer: str, checkout: str, stage: Stage, seed: int, values: dict) -> np.ndarray:
    sys.path.append(str(RESULTS.parent / "peers"))
    import run_peer

    chip = {k: v for k, v in computed_disk.profile(fitted.CHIP).items() if k.startswith("background")}
    options, scale = options_of(peer, values | chip | {"white_lux": 255.0}, seed), values.get("white_grey")
    frames = stage.frames(values, scale or values["white_lux"])  # of the recording's mean white
    _, rows = getattr(run_peer, peer)(checkout, frames, stage.t_us + stage.warmup_us, options)
    events = np.empty(len(rows), pecs.EVENT_DTYPE)
    for k, key in enumerate("txyp"):
        events[key] = np.round(rows[:, k])
    return stage.unpacked(events)


def programs(rows: dict, fits: dict, recording: str, evaluations: int, v2e: str, icns: str, **_: object) -> list[str]:
    halves = Halves(recording)
    scored, _floor = halves.scored()
    first, second = halves.stage(FIT_COARSER, halves.first), halves.stage(SCORE_COARSER, halves.second)
    for peer, checkout in {"v2e": v2e, "icns": icns}.items():
        if not checkout:
            continue
        start, target = fits[peer]["values"], halves.target(halves.first)
        loss = fitted.misses(partial(run_program, peer, checkout, first, 1), first.disk, halves.first, target)
        if peer not in rows:
            found = fitted.search(loss, fitted.SCENE | fitted.BOXES[peer], evaluations or 400, start)
            rows[peer] = found | {"objective_same_values": loss(start)}
        events = run_program(peer, checkout, second, 2, rows[peer]["values"])
        rows[peer]["scores"] = scored.scores(halves.of_second(events))
    columns, keys = {}, ("evaluations", "objective_same_values", "objective")
    for peer, row in rows.items():
        columns |= {f"{peer}, model": fits[peer]["scores"], f"{peer}, program": row["scores"]}
    head = ["program", "simulations", "objective with the model's values", "least objective"]
    return [score_table(columns), table(head, [[peer, *(cell(row[k]) for k in keys)] for peer, row in rows.items()])]


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


PARTS = {
    "peers": peers, "over_light": over_lights, "blind_spots": blind_spots, "programs": programs, "realism": realism,
}  # fmt: skip


def main(
    part: str, recording: str = "", *, output: Path = RESULTS, only: list[str] = (), evaluations: int = 0,
    keep: Path | None = None, v2e: str = "", icns: str = "",
) -> None:  # fmt: skip
    if part not in PARTS:
        sys.exit(f"fits.py: got {part}, wanted one of {', '.join(PARTS)}")
    report = json.loads(output.read_text()) if output.exists() else {}
    rows, fits = report.setdefault(part, {}), report.get("peers", {})
    tables = PARTS[part](
        rows, fits=fits, recording=recording, only=only, evaluations=evaluations, keep=keep, v2e=v2e, icns=icns
    )
    write(output, report)
    print(*tables, sep="\n\n")


if __name__ == "__main__":
    command(main)
