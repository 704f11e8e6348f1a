"""The other simulators' own programs and PECS's models of them, on the same 8-bit frames; a Markdown table. In
brackets: the peer against itself with another seed.

    python scripts/studies/peers/compare.py --esim rpg_vid2e --v2e v2e --icns IEBCS --voltmeter DVS-Voltmeter
        [--peer-python PYTHON] [--scene disk] [--frames 100]

Each PATH is a checkout of github.com/uzh-rpg/rpg_vid2e, SensorsINI/v2e, neuromorphicsystems/IEBCS,
Lynn0306/DVS-Voltmeter; what is not given is left out. --peer-python has their needs (torch, easydict, opencv, …);
esim is compiled here (g++, OpenCV, Eigen, Boost).
"""

import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pecs
from numpy.lib.recfunctions import unstructured_to_structured
from pecs_lab import scenes
from pecs_lab.measure import answer, by_pixel, command, partners
from pecs_lab.peers import build_esim, options_of, run_esim
from pecs_lab.report import table

HERE = Path(__file__).resolve().parent
EVENTS = np.dtype([("t", "<f8"), ("x", "<i8"), ("y", "<i8"), ("p", "<i8")])


def chip(on: float = 0.2, off: float = 0.2, **more: float) -> dict:
    return {"contrast_threshold_on": on, "contrast_threshold_off": off, **more}


ICNS = {"latency_us": 100, "jitter_us": 0, "tau_us": 40, "white_lux": 1e4}
K346 = {"k1": 0.00018 * 29250, "k2": 20, "k3": 0.0001, "k4": 1e-7, "k5": 5e-9, "k6": 0.00001}
V2E_NOISE = {"threshold_mismatch": 0.15, "leak_rate_hz": 2, "background_on_hz": 5, "background_off_hz": 5}
ICNS_NOISE = {"threshold_mismatch": 0.1, "background_on_hz": 2, "background_off_hz": 1}
CASES = [  # program, setting, whether it is random, overrides, parameters
    ("esim", "thresholds 0.2", False, chip(), {}),
    ("esim", "refractory 1 ms", False, chip(0.25, 0.3, refractory_period_s=1e-3), {}),
    ("v2e", "ideal", False, chip(), {"cutoff_hz": 0}),
    ("v2e", "refractory 0.7 ms", False, chip(refractory_period_s=7e-4), {"cutoff_hz": 0}),
    ("v2e", "200 Hz", False, chip(), {"cutoff_hz": 200}),
    ("v2e", "noisy", True, chip(**V2E_NOISE), {"cutoff_hz": 200}),
    ("icns", "ideal", False, chip(refractory_period_s=1e-4), ICNS),
    ("icns", "noisy", True, chip(refractory_period_s=1e-4, **ICNS_NOISE), ICNS | {"jitter_us": 30}),
    ("voltmeter", "DAVIS346", True, {}, K346),
    ("voltmeter", "more noise", True, {}, K346 | {"k3": 1e-3, "k4": 1e-6, "k6": 1e-4}),
]


@dataclass
class Program:
    """One of them, on frames."""

    peer: str
    checkout: Path
    python: str
    folder: Path
    frames: np.ndarray
    t_us: np.ndarray

    def run(self, values: dict, seed: int = 1) -> tuple[np.ndarray, float]:
        """Events, times in whole us as those of PECS (v2e's single-precision seconds scatter about them); seconds."""
        rows, seconds = self.esim(values) if self.peer == "esim" else self.other(values, seed)
        events = unstructured_to_structured(rows, EVENTS)
        events["t"] = np.round(events["t"])
        return events, seconds

    def other(self, values: dict, seed: int) -> tuple[np.ndarray, float]:
        frames, t_us, out = (self.folder / f"{name}.npy" for name in ("frames", "t_us", "out"))
        np.save(frames, self.frames)
        np.save(t_us, self.t_us)
        options = json.dumps(options_of(self.peer, values, seed))
        said = answer(self.python, HERE / "run_peer.py", self.peer, self.checkout, frames, t_us, out, options)
        return np.load(out), float(said.split()[-1])

    def esim(self, values: dict) -> tuple[np.ndarray, float]:
        driver = self.folder / "esim_driver"
        if not driver.exists():
            build_esim(self.checkout, driver)
        thresholds = values["contrast_threshold_on"], values["contrast_threshold_off"]
        frames, step_s = self.frames.astype(np.float32) / np.float32(255), (self.t_us[1] - self.t_us[0]) * 1e-6
        return run_esim(driver, frames, step_s, thresholds, values.get("refractory_period_s", 0), 0.001)


def matched(ours: np.ndarray, theirs: np.ndarray, tolerance_us: float) -> float:
    """Fraction of the larger stream that has a partner in the other: same pixel and polarity, at most so far away."""
    return len(partners(ours, theirs, tolerance_us)[0]) / max(len(ours), len(theirs), 1)


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


HEAD = ("model", "setting", "events of the peer", "PECS/peer", "ON", "OFF", "same within 1 µs", "intervals", "delays")


def cells(row: dict) -> list[str]:
    again = row.get("peer_again")

    def beside(key: str, digits: int) -> str:
        return f"{row[key]:.{digits}f}" + (f" ({again[key]:.{digits}f})" if again else "")

    counts = [row["model"], row["setting"], f"{row['peer_events']:,}", beside("events_ratio", 4)]
    same = "random" if again else f"{100 * row['matched_1us']:.3f} %"
    overlaps = beside("interval_overlap", 3), beside("phase_overlap", 3)
    return [*counts, f"{row['on_ratio']:.4f}", f"{row['off_ratio']:.4f}", same, *overlaps]


def row_of(case: tuple, program: Program) -> dict:
    peer, setting, random, overrides, parameters = case
    theirs, seconds = program.run(overrides | parameters)
    frames, t_us = program.frames, program.t_us
    given = {"overrides": overrides, "parameters": parameters}
    ours = pecs.simulate(frames, t_us, chip="ideal", model=peer, encoding="linear", **given)
    width = frames.shape[2]

    def beside(events: np.ndarray) -> dict:
        return {
            "events_ratio": len(events) / len(theirs),
            "interval_overlap": interval_overlap(events, theirs, width),
            "phase_overlap": phase_overlap(events, theirs, t_us[1]),
        }

    row = {"model": peer, "setting": setting, "peer_events": len(theirs), "peer_seconds": seconds} | beside(ours)
    row["on_ratio"] = float((ours["p"] > 0).sum() / (theirs["p"] > 0).sum())
    row["off_ratio"] = float((ours["p"] == 0).sum() / (theirs["p"] == 0).sum())
    if random:
        return row | {"peer_again": beside(program.run(overrides | parameters, seed=2)[0])}
    later = t_us[1] if peer == "esim" else 0  # esim's first interval is wrong (docs/reference/models.md)
    return row | {"matched_1us": matched(ours[ours["t"] > later], theirs[theirs["t"] > later], 1.01)}


def main(
    *, esim: Path | None = None, v2e: Path | None = None, icns: Path | None = None, voltmeter: Path | None = None,
    peer_python: str = sys.executable, scene: str = "disk", frames: int = 100,
) -> None:  # fmt: skip
    light, t_us = scenes.frames(scene, frames)
    pictures = np.clip(np.round(light * 235), 1, 255).astype(np.uint8)
    checkouts, rows = {"esim": esim, "v2e": v2e, "icns": icns, "voltmeter": voltmeter}, []
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            if checkout := checkouts[case[0]]:
                program = Program(case[0], checkout, peer_python, Path(folder), pictures, t_us)
                rows.append(row_of(case, program))
                print(json.dumps(rows[-1]), file=sys.stderr)
    print(table(HEAD, map(cells, rows)))


if __name__ == "__main__":
    command(main)
