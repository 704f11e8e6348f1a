"""The other simulators' own programs beside PECS's models of them, on the same 8-bit frames; a Markdown table. In
brackets: the peer against itself with another seed.

    python scripts/studies/peers/compare.py --esim rpg_vid2e --v2e v2e --icns IEBCS --voltmeter DVS-Voltmeter
        [--peer-python PYTHON] [--scene disk] [--frames 100] [--json FILE]

Each PATH is a checkout of github.com/uzh-rpg/rpg_vid2e, SensorsINI/v2e, neuromorphicsystems/IEBCS,
Lynn0306/DVS-Voltmeter; what is not given is left out. --peer-python has their needs (torch, easydict, opencv, …);
esim is compiled here (g++, OpenCV, Eigen, Boost).
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pecs
from numpy.lib.recfunctions import unstructured_to_structured
from pecs_lab import scenes
from pecs_lab.measure import by_pixel
from pecs_lab.peers import build_esim, run_esim
from pecs_lab.report import table

HERE = Path(__file__).resolve().parent
EVENTS = np.dtype([("t", "<f8"), ("x", "<i8"), ("y", "<i8"), ("p", "<i8")])


@dataclass
class Case:
    peer: str
    name: str
    deterministic: bool
    model: dict  # for pecs.simulate
    options: dict = field(default_factory=dict)  # for the peer


def chip(on: float = 0.2, off: float = 0.2, **more: float) -> dict:
    return {"contrast_threshold_on": on, "contrast_threshold_off": off, **more}


V2E = {"pos_thres": 0.2, "neg_thres": 0.2, "sigma_thres": 0, "leak_rate_hz": 0, "cutoff_hz": 0}
ICNS = {"lat": 100, "jit": 0, "ref": 100, "tau": 40, "th_pos": 0.2, "th_neg": 0.2, "th_noise": 0}
ICNS |= {"bgnp": 1e-9, "bgnn": 1e-9, "white_lux": 1e4}
ICNS_PARAMETERS = {"latency_us": 100, "jitter_us": 0, "tau_us": 40, "white_lux": 1e4}
REFRACTORY = 100e-6
K346 = [0.00018 * 29250, 20, 0.0001, 1e-7, 5e-9, 0.00001]

CASES = [
    Case("esim", "thresholds .2", True, {"overrides": chip()}, {"refractory_s": 0}),
    Case(
        "esim", "refractory 1 ms", True, {"overrides": chip(0.25, 0.3, refractory_period_s=1e-3)},
        {"on": 0.25, "off": 0.3, "refractory_s": 1e-3},
    ),
    Case("v2e", "ideal", True, {"overrides": chip()}, V2E),
    Case(
        "v2e", "refractory .7 ms", True, {"overrides": chip(refractory_period_s=7e-4)},
        V2E | {"refractory_period_s": 7e-4},
    ),
    Case("v2e", "200 Hz", True, {"overrides": chip(), "parameters": {"cutoff_hz": 200}}, V2E | {"cutoff_hz": 200}),
    Case(
        "v2e", "noisy", False,
        {
            "overrides": chip(threshold_mismatch=0.15, leak_rate_hz=2, background_on_hz=5, background_off_hz=5),
            "parameters": {"cutoff_hz": 200},
        },
        V2E | {"sigma_thres": 0.03, "leak_rate_hz": 2, "shot_noise_rate_hz": 10, "cutoff_hz": 200},
    ),
    Case(
        "icns", "ideal", True, {"overrides": chip(refractory_period_s=REFRACTORY), "parameters": ICNS_PARAMETERS}, ICNS,
    ),
    Case(
        "icns", "noisy", False,
        {
            "overrides": chip(
                refractory_period_s=REFRACTORY, threshold_mismatch=0.1, background_on_hz=2, background_off_hz=1
            ),
            "parameters": ICNS_PARAMETERS | {"jitter_us": 30},
        },
        ICNS | {"jit": 30, "th_noise": 0.02, "bgnp": 2, "bgnn": 1},
    ),
    Case("voltmeter", "DAVIS346", False, {}, {"k": K346}),
    Case(
        "voltmeter", "more noise", False, {"parameters": {"k3": 1e-3, "k4": 1e-6, "k6": 1e-4}},
        {"k": [K346[0], 20, 1e-3, 1e-6, 5e-9, 1e-4]},
    ),
]  # fmt: skip


class Peers:
    def __init__(self, args: argparse.Namespace, folder: Path, frames: np.ndarray, t_us: np.ndarray):
        self.args, self.folder, self.frames, self.t_us = args, folder, frames, t_us
        np.save(folder / "frames.npy", frames)
        np.save(folder / "t_us.npy", t_us)

    def run(self, case: Case, seed: int = 1) -> tuple[np.ndarray, float]:
        """Events, times in whole us as ours are (v2e's single-precision seconds scatter about them); seconds."""
        rows, seconds = (self.esim if case.peer == "esim" else self.other)(case, seed)
        events = unstructured_to_structured(rows, EVENTS)
        events["t"] = np.round(events["t"])
        return events, seconds

    def other(self, case: Case, seed: int) -> tuple[np.ndarray, float]:
        checkout = getattr(self.args, case.peer)
        files = [str(self.folder / n) for n in ("frames.npy", "t_us.npy", "out.npy")]
        command = [
            self.args.peer_python,
            HERE / "run_peer.py",
            case.peer,
            checkout,
            *files,
            json.dumps(case.options | {"seed": seed}),
        ]
        done = subprocess.run(command, capture_output=True, text=True, cwd=self.folder)
        if done.returncode:
            raise SystemExit(f"{case.peer}: {done.stderr.strip()[-2000:]}")
        return np.load(files[2]), float(done.stdout.split()[-1])

    def esim(self, case: Case, _seed: int) -> tuple[np.ndarray, float]:
        driver, options = self.folder / "esim_driver", case.options
        if not driver.exists():
            build_esim(Path(self.args.esim), driver)
        thresholds = options.get("on", 0.2), options.get("off", 0.2)
        frames, step_s = self.frames.astype(np.float32) / np.float32(255), (self.t_us[1] - self.t_us[0]) * 1e-6
        return run_esim(driver, frames, step_s, thresholds, options["refractory_s"], 0.001)


def matched(ours: np.ndarray, theirs: np.ndarray, width: int, tolerance_us: float) -> float:
    """Fraction of the larger stream that has a partner in the other: same pixel and polarity, at most so far away."""
    (ka, ta), (kb, tb) = by_pixel(ours, width), by_pixel(theirs, width)
    pairs = i = j = 0
    while i < len(ka) and j < len(kb):
        if ka[i] == kb[j] and abs(ta[i] - tb[j]) <= tolerance_us:
            pairs, i, j = pairs + 1, i + 1, j + 1
        elif (ka[i], ta[i]) < (kb[j], tb[j]):
            i += 1
        else:
            j += 1
    return pairs / max(len(ka), len(kb), 1)


def interval_overlap(ours: np.ndarray, theirs: np.ndarray, width: int) -> float:
    """Common area of the histograms of the times between a pixel's events of one polarity (40 bins a decade)."""
    edges = np.geomspace(1, 1e7, 281)
    histograms = []
    for events in (ours, theirs):
        key, t = by_pixel(events, width)
        gaps = np.diff(t)[np.diff(key) == 0]
        h = np.histogram(np.clip(gaps, 1, 1e7), edges)[0].astype(float)
        histograms.append(h / max(h.sum(), 1))
    return float(np.minimum(*histograms).sum())


def phase_overlap(ours: np.ndarray, theirs: np.ndarray, step_us: float) -> float:
    """The same of the delays behind the last frame, 100 bins."""
    histograms = [
        np.histogram(np.mod(e["t"] - 1e-3, step_us), 100, (0, step_us))[0] / max(len(e), 1) for e in (ours, theirs)
    ]
    return float(np.minimum(*histograms).sum())


HEAD = ("model", "setting", "events of the peer", "ours/peer", "ON", "OFF", "same within 1 µs", "intervals", "delays")


def cells(row: dict) -> list[str]:
    again = row.get("peer_again")

    def beside(key: str, digits: int) -> str:
        return f"{row[key]:.{digits}f}" + (f" ({again[key]:.{digits}f})" if again else "")

    counts = [row["model"], row["setting"], f"{row['peer_events']:,}", beside("events_ratio", 4)]
    same = "random" if again else f"{100 * row['matched_1us']:.3f} %"
    overlaps = beside("interval_overlap", 3), beside("phase_overlap", 3)
    return [*counts, f"{row['on_ratio']:.4f}", f"{row['off_ratio']:.4f}", same, *overlaps]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for peer in ("esim", "v2e", "icns", "voltmeter"):
        parser.add_argument(f"--{peer}", metavar="PATH")
    parser.add_argument("--peer-python", default=sys.executable)
    parser.add_argument("--scene", choices=scenes.SCENES, default="disk")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()

    light, t_us = scenes.frames(args.scene, args.frames)
    frames = np.clip(np.round(light * 235), 1, 255).astype(np.uint8)
    width = frames.shape[2]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        peers = Peers(args, Path(folder), frames, t_us)
        for case in CASES:
            if not getattr(args, case.peer):
                continue
            theirs, seconds = peers.run(case)
            ours = pecs.simulate(frames, t_us, chip="ideal", model=case.peer, encoding="linear", **case.model)
            later = t_us[1] if case.peer == "esim" else 0  # esim's first interval is wrong (docs/reference/models.md)
            row = {
                "model": case.peer,
                "setting": case.name,
                "peer_events": len(theirs),
                "events_ratio": len(ours) / len(theirs),
                "on_ratio": float((ours["p"] > 0).sum() / (theirs["p"] > 0).sum()),
                "off_ratio": float((ours["p"] == 0).sum() / (theirs["p"] == 0).sum()),
                "interval_overlap": interval_overlap(ours, theirs, width),
                "phase_overlap": phase_overlap(ours, theirs, t_us[1]),
                "peer_seconds": seconds,
            }
            if not case.deterministic:
                again, _ = peers.run(case, seed=2)
                row["peer_again"] = {
                    "events_ratio": len(again) / len(theirs),
                    "interval_overlap": interval_overlap(again, theirs, width),
                    "phase_overlap": phase_overlap(again, theirs, t_us[1]),
                }
            else:
                a, b = ours[ours["t"] > later], theirs[theirs["t"] > later]
                row["matched_1us"] = matched(a, b, width, 1.01)
            rows.append(row)
            print(json.dumps(row), file=sys.stderr)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    print(table(HEAD, map(cells, rows)))


if __name__ == "__main__":
    main()
