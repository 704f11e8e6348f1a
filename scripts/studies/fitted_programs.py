"""The programs of v2e and ICNS instead of PECS's models of them, before the same light: with the values that the models
were fitted to in fitted_peers.py, and fitted on from there, with the same objective.

    PYTHONPATH=python:scripts/lab PYTHON scripts/studies/fitted_programs.py RECORDING --v2e PATH --icns PATH
        [-o scripts/studies/fitted_programs.json] [--evaluations 400]

PATH: checkouts of github.com/SensorsINI/v2e and neuromorphicsystems/IEBCS. PYTHON has what they require (torch, numba,
opencv-python-headless, h5py, screeninfo, tqdm, dv-processing, engineering-notation, easygui, tkinter) and cma, scipy.

CMA-ES with 400 simulations of the program follows the 1,826 of its model: a whole search with the programs would take
hours. A program takes one deviation for both thresholds: the mismatch times their mean. Programs that OUTPUT has
already are scored, not fitted again. One process, 15 minutes.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from pecs_lab import computed_disk, fitted
from pecs_lab.disk_scores import MEASURES
from pecs_lab.report import cell, table, with_interval, write_results
from pecs_lab.search import search

HERE = Path(__file__).parent
CHIP = computed_disk.profile(fitted.CHIP)
BACKGROUND = CHIP["background_on_hz"], CHIP["background_off_hz"]


def options(peer: str, values: dict, seed: int) -> tuple[dict, float]:
    """Of run_peer.py; and the recording's mean white in a frame."""
    on, off = values["contrast_threshold_on"], values["contrast_threshold_off"]
    sigma = values["threshold_mismatch"] * (on + off) / 2
    if peer == "v2e":
        kept = {k: values[k] for k in ("cutoff_hz", "refractory_period_s", "linear_below")}
        found = {"pos_thres": on, "neg_thres": off, "sigma_thres": sigma, "leak_rate_hz": 0, "seed": seed}
        return found | {"shot_noise_rate_hz": sum(BACKGROUND)} | kept, values["white_grey"]
    found = {"th_pos": on, "th_neg": off, "th_noise": sigma, "bgnp": BACKGROUND[0], "bgnn": BACKGROUND[1]}
    found |= {"lat": values["latency_us"], "jit": values["jitter_us"], "ref": values["refractory_period_s"] * 1e6}
    return found | {"tau": values["tau_us"], "seed": seed, "white_lux": 255.0}, values["white_lux"]


def simulate(peer: str, checkout: str, stage: fitted.Stage, values: dict, seed: int) -> np.ndarray:
    import run_peer

    made, scale = options(peer, values, seed)
    _, rows = getattr(run_peer, peer)(checkout, stage.frames(values, scale), stage.t_us + stage.warmup_us, made)
    events = np.empty(len(rows), [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    for k, key in enumerate("txyp"):
        events[key] = np.round(rows[:, k])
    return stage.unpacked(events)


def tables(report: dict) -> list[str]:
    peers = json.loads((HERE / "fitted_peers.json").read_text())["models"]
    columns = {}
    for peer, row in report["models"].items():
        columns |= {f"{peer}, model": peers[peer]["second_half"], f"{peer}, program": row["second_half"]}
    measured = [[title, *(with_interval(of, key) for of in columns.values())] for key, title in MEASURES.items()]
    keys = ("evaluations", "objective_same_values", "objective")
    found = [[name, *(cell(row[k]) for k in keys)] for name, row in report["models"].items()]
    return [
        table(["", *columns], measured),
        table(["program", "simulations", "objective with the model's values", "least objective"], found),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("--v2e")
    parser.add_argument("--icns")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--evaluations", type=int, default=400)
    args = parser.parse_args()
    sys.path.append(str(HERE / "peers"))
    peers = json.loads((HERE / "fitted_peers.json").read_text())["models"]
    report = json.loads(args.output.read_text()) if args.output.exists() else {"models": {}}
    halves = fitted.Halves(args.recording)
    scored, _ = halves.scored()
    first, second = (
        halves.stage(coarser, part)
        for coarser, part in ((fitted.FIT_COARSER, halves.first), (fitted.SCORE_COARSER, halves.second))
    )
    for peer in ("v2e", "icns"):
        checkout = getattr(args, peer)
        if not checkout:
            continue
        start = peers[peer]["values"]
        loss = fitted.misses(
            lambda values, of=(peer, checkout): simulate(*of, first, values, 1),
            first.disk, halves.first, halves.target(halves.first),
        )  # fmt: skip
        if peer not in report["models"]:
            ranges = fitted.SCENE | fitted.BOXES[peer]
            report["models"][peer] = search(loss, ranges, args.evaluations, start) | {
                "objective_same_values": loss(start)
            }
            write_results(args.output, report)
        row = report["models"][peer]
        row["second_half"] = scored.scores(halves.of_second(simulate(peer, checkout, second, row["values"], 2)))
        write_results(args.output, report)
    print(*tables(report), sep="\n\n")


if __name__ == "__main__":
    main()
