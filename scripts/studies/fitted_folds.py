#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Models fitted to other parts of the recording than in fitted_peers.py, scored on what is left: halves, radii, edges.

    scripts/studies/fitted_folds.py RECORDING [-o scripts/studies/fitted_folds.json] [--evaluations 384]

A fit sees a part of one half of the recording (its inner rings, its ON events, ...); the deviance is of the other part
in the other half. Same light, objective and search as in fitted_peers.py, with fewer pixels and simulations;
DVS-Voltmeter and ESIM are left out. `recording`: pixels between those that are scored, as if they were a simulation.
Models of folds that OUTPUT has already are not fitted again. One process, 10 minutes.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from pecs_lab import fitted
from pecs_lab.disk_scores import REGIONS, SECTORS, Part, deviance, on_grid
from pecs_lab.report import cell, table, write_results

FIT_COARSER = 9
MODELS = ("pecs", "v2e", "icns")
EVERY = np.ones((2, REGIONS), bool)
INNER = EVERY & (np.arange(REGIONS) < SECTORS)
ON = EVERY & (np.arange(2)[:, None] == 1)


def folds(halves: fitted.Halves) -> dict[str, tuple[Part, Part]]:
    """What is fitted, what is scored."""

    def within(part: Part, kept: np.ndarray) -> Part:
        return Part(part.begin_us, part.end_us, kept)

    first, second = halves.first, halves.second
    return {
        "inner rings, outer rings": (within(first, INNER), within(second, ~INNER)),
        "ON events, OFF events": (within(first, ON), within(second, ~ON)),
        "OFF events, ON events": (within(first, ~ON), within(second, ON)),
        "outer rings, inner rings": (within(first, ~INNER), within(second, INNER)),
        "second half, first half": (second, first),
    }


def row_of(halves: fitted.Halves, seen: Part, left: Part, evaluations: int, known: dict) -> dict:
    coarser, disk = fitted.SCORE_COARSER, halves.disk.coarser(fitted.SCORE_COARSER)
    real = left.cells(on_grid(halves.events, coarser, 1), disk)
    beside = left.cells(on_grid(halves.events, coarser, 0), disk.moved(0.5, 0.5))
    row = {"recording": deviance(real, beside)} | known
    stage, scoring = halves.stage(FIT_COARSER, seen), halves.stage(coarser, left)
    for model in (m for m in MODELS if m not in known):
        ranges = {}, fitted.SCENE | fitted.BOXES[model]
        values = fitted.fit(model, ranges, stage, seen, halves.target(seen, FIT_COARSER), evaluations)["values"]
        row[model] = deviance(real, left.cells(scoring.events(model, values, 2), disk))
    return row


def tables(report: dict) -> list[str]:
    rows = [[*name.split(", "), *(cell(row.get(m)) for m in ("recording", *MODELS))] for name, row in report.items()]
    return [table(["fitted to", "scored on", "recording", *MODELS], rows)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--evaluations", type=int, default=384)
    args = parser.parse_args()
    report = json.loads(args.output.read_text()) if args.output.exists() else {}
    halves = fitted.Halves(args.recording)
    for name, (seen, left) in folds(halves).items():
        report[name] = row_of(halves, seen, left, args.evaluations, report.get(name, {}))
        write_results(args.output, report)
    print(*tables(report), sep="\n\n")


if __name__ == "__main__":
    main()
