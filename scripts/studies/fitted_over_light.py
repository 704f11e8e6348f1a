#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Pixel models fitted to a recording in dim light (fitted_peers.py), in light that the fit did not see: NIST's delays
over a factor of 66 of light, and published rates of noise in still light (pecs_lab/over_light.py).

    scripts/studies/fitted_over_light.py [--fitted scripts/studies/fitted_peers.json] [-o fitted_over_light.json]

No value of the fit is changed. The ratio of the lamp's light to the recording's is not known to a model without units.
So each peer has it chosen among 13 for the least misfit of its delays: `white_fa`, the photocurrent that the
recording's mean white would have, from 1 to 1,000 fA. `pecs` has the white of its fit; nothing is chosen. Two
processes, two minutes.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pecs
from pecs_lab import fitted, over_light
from pecs_lab.report import table, write_results

HERE = Path(__file__).parent
TRIED_FA = np.geomspace(1, 1000, 13)
SILENT = 1000.0  # a delay that is not there counts as wrong by this factor


def misfit(ratio: dict[str, list]) -> float:
    """Root mean square of ln of the ratio, as a factor."""
    each = [np.log(SILENT if r is None else r) for of in ratio.values() for r in of]
    return float(np.exp(np.sqrt(np.mean(np.square(each)))))


def of_model(model: str, values: dict) -> dict:
    whites = [values["white_fa"]] if model == "pecs" else TRIED_FA
    scale = fitted.sensor(model, values, 1, 1)[1]

    def sensor(width: int, height: int, seed: int = 1) -> pecs.Sensor:
        return fitted.sensor(model, values, width, height, seed=seed)[0]

    delays = ((over_light.median_delays_us(sensor, scale / w), float(w)) for w in whites)
    tried = ((over_light.ratios(of), w) for of, w in delays)
    ratio, white_fa = min(tried, key=lambda t: misfit(t[0]))
    noise = over_light.noise_hz(lambda w, h: sensor(w, h, 3), scale / white_fa)
    return {"white_fa": white_fa, "delay_ratio": ratio, "delay_factor": misfit(ratio), "noise_hz": noise}


def tables(report: dict) -> list[str]:
    delays, noise = [], []
    for name, row in report.items():
        for p in ("on", "off"):
            of = row["delay_ratio"][p]
            cells = ["–" if r is None else f"{r:.2f}" for r in of]
            delays.append([name, p.upper(), *cells, f"{row['delay_factor']:.2f}", f"{row['white_fa']:.2g}"])
            noise.append([name, p.upper(), *(f"{hz:.2g}" for hz in row["noise_hz"][p])])
    published = over_light.PUBLISHED_HZ
    noise += [["published", p.upper(), *of] for p, of in published.items()]
    for p, of in published.items():
        ratio = np.divide(report["pecs"]["noise_hz"][p], of)
        noise.append(["pecs / published", p.upper(), *(f"{r:.2f}" for r in ratio)])
    head = ["model", "", *over_light.IRRADIANCE_W_M2, "typical factor", "white, fA"]
    return [table(head, delays), table(["model", "", *over_light.LUX], noise)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fitted", type=Path, default=HERE / "fitted_peers.json")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    args = parser.parse_args()
    rows = {n: row for n, row in json.loads(args.fitted.read_text())["models"].items() if "values" in row}
    with ProcessPoolExecutor(2) as pool:
        found = [pool.submit(of_model, n.split()[0], row["values"]) for n, row in rows.items()]
        report = {name: of.result() for name, of in zip(rows, found, strict=True)}
    write_results(args.output, report)
    print(*tables(report), sep="\n\n")


if __name__ == "__main__":
    main()
