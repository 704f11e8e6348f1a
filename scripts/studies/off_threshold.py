#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Which OFF threshold the recording of the disk allows, and which one NIST's delays want.

    scripts/studies/off_threshold.py RECORDING [-o scripts/studies/off_threshold.json] [--evaluations 256]

For each OFF threshold, the other values of `pecs` are fitted to the recording's first half again, from those of
fitted_peers.json; then its second half is scored, and NIST's delays are simulated. Ten minutes of one core.
"""

import argparse
import json
from pathlib import Path

import pecs
from pecs_lab import fitted, over_light
from pecs_lab.disk_scores import MEASURES
from pecs_lab.over_light import IRRADIANCE_W_M2
from pecs_lab.report import cell, table, with_interval
from pecs_lab.search import search

HERE = Path(__file__).parent
KEY, THRESHOLDS = "contrast_threshold_off", (0.24, 0.267, 0.3, 0.34, 0.38, 0.42)
SHOWN = ("deviance", "earth_mover_on_deg", "earth_mover_off_deg", "events_ratio")


def delays_us(values: dict) -> dict:
    def sensor(width: int, height: int) -> pecs.Sensor:
        return fitted.sensor("pecs", values, width, height, seed=1)[0]

    return over_light.median_delays_us(sensor, 1.0)  # frames of `pecs` are in fA


def tables(report: dict) -> list[str]:
    head = ["OFF threshold, ln", "first half", *(MEASURES[k] for k in SHOWN)]
    rows = [
        [threshold, cell(row["objective"]), *(with_interval(row["second_half"], k) for k in SHOWN)]
        for threshold, row in report.items()
    ]
    ratios = [[t, *row["delay_ratio"]["on"], *row["delay_ratio"]["off"]] for t, row in report.items()]
    light = [f"{p} {e}" for p in ("ON", "OFF") for e in IRRADIANCE_W_M2]
    return [table(head, rows), table(["OFF threshold, ln", *light], ratios)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--evaluations", type=int, default=256)
    args = parser.parse_args()
    start = json.loads((HERE / "fitted_peers.json").read_text())["models"]["pecs"]["values"]
    ranges = {k: r for k, r in (fitted.SCENE | fitted.BOXES["pecs"]).items() if k != KEY}
    halves = fitted.Halves(args.recording)
    scored, _ = halves.scored()
    first, target = halves.stage(fitted.FIT_COARSER, halves.first), halves.target(halves.first)
    second, report = halves.stage(fitted.SCORE_COARSER, halves.second), {}
    for threshold in THRESHOLDS:
        loss = fitted.misses(
            lambda v, t=threshold: first.events("pecs", v | {KEY: t}, 1), first.disk, halves.first, target
        )
        row = search(loss, ranges, args.evaluations, start)
        values = row["values"] | {KEY: threshold}
        row["second_half"] = scored.scores(halves.of_second(second.events("pecs", values, 2)))
        row["delay_ratio"] = over_light.ratios(delays_us(values))
        report[str(threshold)] = row
        args.output.write_text(json.dumps(report, indent=1) + "\n")
    print(*tables(report), sep="\n\n")


if __name__ == "__main__":
    main()
