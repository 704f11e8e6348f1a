#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Every pixel model fitted to the first half of a recording of the rotating disk, scored on its second half.

    scripts/studies/fitted_peers.py RECORDING [-o scripts/studies/fitted_peers.json] [--evaluations 1792]
    scripts/studies/fitted_peers.py BRIGHTER --keep scripts/studies/fitted_peers.json -o brighter.json

The disk is computed, not rendered, and each model fits its light, too (pecs_lab/fitted.py has the free values and
their ranges). All models have the same objective: the deviance of the recording's numbers of events, by polarity, 24
regions and 10 degrees of delay behind the edge, where the simulation's are expected (Poisson). All have the same
search: 256 points of a Sobol sequence over the ranges, then CMA-ES from its best two, 1,792 evaluations in all. No
model starts from its defaults. Models that OUTPUT has already are scored, not fitted again.

`pecs as shipped` fits the light and the contrast alone; its other values were chosen on the whole recording.

With --keep, a recording of such a disk in other light is scored with the values of an earlier fit; only the lamp's
place, its brightness and the contrast are fitted to its first half.

Scores are of the second half, of every second pixel in x and y between 0.2 and 0.98 of the radius; the simulation has
another seed than in the fit. `recording` is the same recording's pixels between those, scored as if they were a
simulation: the floor of each measure (pecs_lab/disk_scores.py). Requires cma (PyPI). Two processes, about 15 minutes
and 2 GB.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from pecs_lab import computed_disk, fitted
from pecs_lab.disk_scores import MEASURES
from pecs_lab.fitted import FIT_COARSER, SCORE_COARSER, Halves, fit
from pecs_lab.report import cell, table, with_interval, write_results

SHIPPED = "pecs as shipped"
KEPT_BRIGHTNESS = (0.1, 1e5)  # of another recording, in each model's unit
SLOWEST = ("voltmeter", "v2e", "pecs", "icns", SHIPPED, "esim")  # first


def searches(kept: Path | None) -> dict[str, tuple[dict, dict]]:
    """(fixed values, free ranges) of each row. With `kept`, the light alone is free: SCENE and the brightness."""
    if not kept:
        shipped = {k: computed_disk.profile(fitted.CHIP)[k] for k in fitted.BOXES["pecs"] if k in fitted.OF_CHIP}
        light = fitted.SCENE | {"white_fa": fitted.BOXES["pecs"]["white_fa"]}
        return {SHIPPED: (shipped, light)} | {m: ({}, fitted.SCENE | box) for m, box in fitted.BOXES.items()}
    found = {}
    for name, row in json.loads(kept.read_text())["models"].items():
        if "values" in row:
            brightness = fitted.BRIGHTNESS.get(name.split()[0], "white_grey")
            light = fitted.SCENE | {brightness: KEPT_BRIGHTNESS}
            found[name] = {k: v for k, v in row["values"].items() if k not in light}, light
    return found


def tables(report: dict) -> list[str]:
    """Of docs/studies/validation.md: scores, rings, fits, values."""
    models = report["models"]
    halves = {name: row["second_half"] for name, row in models.items()}
    fits = {name: row for name, row in models.items() if "values" in row}
    measured = [[title, *(with_interval(of, key) for of in halves.values())] for key, title in MEASURES.items()]
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

    halves = Halves(args.recording)
    scored, floor = halves.scored()
    known = json.loads(args.output.read_text())["models"] if args.output.exists() else {}
    report = {"recording": Path(args.recording).name, "middle_us": halves.middle_us, "duration_us": halves.duration_us}
    report |= {"events_second_half": len(scored.events), "models": {"recording": {"second_half": floor}}}
    rows = searches(args.keep)
    what = halves.stage(FIT_COARSER, halves.first), halves.first, halves.target(halves.first), args.evaluations
    with ProcessPoolExecutor(2) as pool:
        fits = {n: pool.submit(fit, n, rows[n], *what) for n in sorted(rows, key=SLOWEST.index) if n not in known}
        report["models"] |= {name: known[name] if name in known else fits[name].result() for name in rows}
    write_results(args.output, report)
    stage = halves.stage(SCORE_COARSER, halves.second)
    for name in rows:
        row = report["models"][name]
        row["second_half"] = scored.scores(halves.of_second(stage.events(name.split()[0], row["values"], 2)))
    write_results(args.output, report)
    print(*tables(report), sep="\n\n")


if __name__ == "__main__":
    main()
