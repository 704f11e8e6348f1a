#!/usr/bin/env -S sh -c 'P="$(dirname "$0")/../../.venv/bin/python"; [ -x "$P" ] || P=python3; exec "$P" "$0" "$@"'
"""Chips with frames that are drawn at random, recorded by the sensor and fitted by `pecs fit --davis`: how often the
intervals hold the drawn values (docs/howto/fit_camera.md)."""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from pecs.fit import Davis, fit_davis

sys.path.insert(0, str(Path(__file__).parents[1] / "lab"))
from simulated_davis import record

KEYS = (
    "contrast_threshold_on", "contrast_threshold_off", "threshold_mismatch", "noise_std", "background_on_hz",
    "frame_step", "frame_step_spread",
)  # fmt: skip


def drawn(seed):
    """Values, light of white [A] and size."""
    rng = np.random.default_rng(1000 + seed)
    on = rng.uniform(0.14, 0.35)
    white_a, exposure_s = 10 ** rng.uniform(-12.5, -11.7), 10 ** rng.uniform(-2.2, -1.1)
    values = {
        "contrast_threshold_on": on,
        "contrast_threshold_off": on * rng.uniform(0.8, 1.25),
        "threshold_mismatch": rng.uniform(0.04, 0.15),
        "noise_std": on * rng.uniform(0.12, 0.22),
        "background_on_hz": rng.uniform(0.0, 0.3),
        "frame_step": on * rng.uniform(0.3, 0.7),
        "frame_step_spread": rng.uniform(0.3, 0.6),
        "frame_exposure_s": exposure_s,
        "frame_period_s": exposure_s + rng.uniform(0.02, 0.06),
        "frame_gain_e": float(np.clip(white_a * exposure_s / 1.602e-19 / 700, 1, 1000)),
    }
    return values, white_a, (int(rng.integers(100, 200)), int(rng.integers(80, 150)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:8", help="FIRST:END")
    parser.add_argument("--pixels", type=int, default=768)
    args = parser.parse_args()
    held = {key: [] for key in KEYS}
    for seed in range(*map(int, args.seeds.split(":"))):
        values, white_a, size = drawn(seed)
        with tempfile.TemporaryDirectory() as folder:
            record(Path(folder) / "r", seed, values, white_a=white_a, size=size)
            found = fit_davis(Davis(Path(folder) / "r"), "davis240c", pixels=args.pixels).values
        for key in KEYS:
            of = found[key]
            held[key].append((of.value / values[key], of.interval[0] <= values[key] <= of.interval[1], of.fitted))
            print(f"{seed} {key}: {values[key]:.4g}, {of.value:.4g} {of.interval if of.fitted else of.why}", flush=True)
    for key, rows in held.items():
        of = [(ratio, inside) for ratio, inside, fitted in rows if fitted]
        ratios = np.quantile([ratio for ratio, _ in of] or [np.nan], [0.1, 0.5, 0.9]).round(3).tolist()
        print(f"{key:24} fitted {len(of)} of {len(rows)}, held {sum(i for _, i in of)}, fitted / drawn {ratios}")


if __name__ == "__main__":
    main()
