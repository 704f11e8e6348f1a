#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Which errors each measure of fitted_peers.py detects: one known error at a time.

    scripts/studies/fitted_blind_spots.py RECORDING [-o scripts/studies/fitted_blind_spots.json]

Errors of events are made in the recording's pixels between those that are scored, whose own score is the floor; errors
of the simulation in `pecs` with the values of fitted_peers.json. Two minutes.
"""

import argparse
import json
from copy import copy
from pathlib import Path

import numpy as np
from pecs_lab import fitted
from pecs_lab.disk import Disk
from pecs_lab.disk_scores import MEASURES, between, on_grid, region, seen
from pecs_lab.report import cell, table, write_results

HERE = Path(__file__).parent


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


def of_events(events: np.ndarray, disk: Disk, duration_us: float) -> dict[str, np.ndarray]:
    random = np.random.default_rng(1)

    def changed(t: np.ndarray) -> np.ndarray:
        out = events.copy()
        out["t"] = np.maximum(t, 0)
        return np.sort(out[(t >= 0) & (t < duration_us)], order="t", kind="stable")

    t, swapped = events["t"].astype(float), events.copy()
    swapped["p"] = 1 - swapped["p"]
    return {
        "1 ms late": changed(t + 1000),
        "half dropped": events[random.random(len(events)) < 0.5],
        "ON and OFF swapped": swapped,
        "delays shuffled": changed(shuffled(events, disk, duration_us, random)),
    }


def of_simulation(stage, values: dict) -> dict[str, np.ndarray]:
    thresholds = {k: 1.2 * values[k] for k in ("contrast_threshold_on", "contrast_threshold_off")}
    uniform = copy(stage)
    uniform.light = lambda _: np.ones(len(stage.x), np.float32)
    return {
        "pecs": stage.events("pecs", values, 2),
        "thresholds + 20 %": stage.events("pecs", values | thresholds, 2),
        "light - 20 %": stage.events("pecs", values | {"white_fa": 0.8 * values["white_fa"]}, 2),
        "one speed": uniform.events("pecs", values, 2),
    }


def answer(row: dict, base: dict, key: str) -> str:
    """The score; bold outside the interval of what it was made from."""
    value, low_high = row[key], base[f"{key}_interval"]
    shown = cell(value)
    moved = value is None or (low_high and not low_high[0] <= value <= low_high[1])
    return f"**{shown}**" if row is not base and moved else shown


def tables(report: dict) -> list[str]:
    names = list(report)
    base = [report["recording" if k < names.index("pecs") else "pecs"] for k in range(len(names))]
    rows = [
        [title, *(answer(row, of, key) for row, of in zip(report.values(), base, strict=True))]
        for key, title in MEASURES.items()
    ]
    return [table(["", *report], rows)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    args = parser.parse_args()
    halves = fitted.Halves(args.recording)
    scored, floor = halves.scored()
    beside = on_grid(halves.events, fitted.SCORE_COARSER, 0)
    events, disk = between(
        beside, halves.disk.coarser(fitted.SCORE_COARSER).moved(0.5, 0.5), halves.middle_us, halves.duration_us
    )
    report = {"recording": floor}
    for name, changed in of_events(events, disk, scored.duration_us).items():
        report[name] = scored.scores(changed, disk)
    values = json.loads((HERE / "fitted_peers.json").read_text())["models"]["pecs"]["values"]
    stage = halves.stage(fitted.SCORE_COARSER, halves.second)
    for name, found in of_simulation(stage, values).items():
        report[name] = scored.scores(halves.of_second(found))
    write_results(args.output, report)
    print(*tables(report), sep="\n\n")


if __name__ == "__main__":
    main()
