"""Does the simulator that made the training events matter for optical flow? The light is the same for all; only the
sensor differs. What is compared, and how, is fixed in flow.json.

    pecs dataset examples/recipes/flow.toml -o out/flow/light
    .venv-datasets/bin/python scripts/studies/flow.py out/flow --real R_360_L.hdf5 [--only SIMULATOR ...]
        [--seeds 1 2 3] [--train] [--picture docs/studies/flow.webp]

Needs PyTorch. Each step whose result is there is left out, so that it can be stopped and run again; processes
with different --only or --seeds can --train at once. Writes results.json and prints tables.
"""

import json
from functools import cache, partial
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pecs
import torch
from pecs._files import write_json
from pecs.datasets.sequence import Sequence
from pecs.datasets.writers._pictures import flow_picture
from pecs_lab import report
from pecs_lab.comparison import Comparison, mean_scores, table, titled
from pecs_lab.flow import FlowConfig, Flows, Method, View, Window, disk_speed, real_windows, sharpness, trained
from pecs_lab.measure import command

PLAN = json.loads(Path(__file__).with_suffix(".json").read_text())
BASELINES = ("zero", "mean", "farneback")
SHARPER = 0.9  # least share of the windows whose events are sharper along the true flow than against it
SHOWN_PX = 160  # width of a picture's cell


@cache
def flows_of(study: Comparison, split: str) -> list[tuple[Sequence, Flows]]:
    return [(s, Flows(study.camera(s))) for s in study.sequences(split)]


def training_views(study: Comparison, name: str) -> list[View]:
    draws = range(PLAN["draws"]["count"])
    return [View(flows, study.events(name, s, draw)) for (s, flows), draw in product(flows_of(study, "train"), draws)]


def test_windows(study: Comparison, sensor: str) -> list[Window]:
    out, how, test = [], PLAN["test"]["sensors"][sensor], PLAN["test"]
    for sequence, flows in flows_of(study, test["split"]):
        path = study.root / "events" / f"test_{sensor}" / f"{sequence.name}.h5"
        if not path.exists():
            if name := how.get("simulator"):
                study.sensed(sequence, path, PLAN["simulators"][name], study.threshold(name))
            else:
                study.sensed(sequence, path, how, None, how.get("light", 1.0))
        out += View(flows, path).windows(test["first"], test["intervals"], test["step"])
    return out


def all_windows(study: Comparison, real: Path | None) -> list[dict[str, list[Window]]]:
    """Test sets of each table: those of the plan; each sensor's scenes; the recording in other windows."""
    first = {on: test_windows(study, on) for on in PLAN["test"]["sensors"]}
    scene_of = {s.name: s.info["scene"] for s, _ in flows_of(study, PLAN["test"]["split"])}
    tables = [first]
    for on in PLAN["test"]["by_scene"]:
        scenes = dict.fromkeys(scene_of.values())
        tables.append({f"{on}, {scene}": [w for w in first[on] if scene_of[w.name] == scene] for scene in scenes})
    if real:
        plan = PLAN["real"]
        first[plan["sequence"]] = real_windows(real, plan)
        tables.append({})
        for more in plan["also"]:
            name = f"{plan['sequence']}, {more['coarser']} x {more['coarser']}, {more['window_us'] // 1000} ms"
            tables[-1][name] = real_windows(real, plan | more)
    return tables


def scores(window: Window, found: np.ndarray) -> dict[str, float]:
    at, known = window.has_events, window.known
    apart = np.hypot(*(found - window.flow))
    length = np.hypot(*window.flow)
    along = (found * window.flow).sum(0)[at]
    both = np.hypot(*found)[at] * length[at]
    bad = apart[at] > np.clip(length[at] / 2, 1.0, 3.0)
    return {
        "epe_px": float(apart[at].mean()),
        "epe_all_px": float(apart[known].mean()),
        "relative": float(apart[at].mean() / length[at].mean()),
        "outliers": float(bad.mean()),
        "angle_deg": float(np.median(np.degrees(np.arccos(np.clip(along / np.maximum(both, 1e-6), -1, 1))))),
        "gain": float(along.sum() / (length[at] ** 2).sum()),
    }


def farneback(window: Window) -> np.ndarray:
    """Twice the flow between pictures of the polarities of the window's two halves (Farnebaeck, SCIA 2003)."""
    middle = (window.begin_us + window.end_us) / 2
    halves = []
    for half in (window.events[window.events["t"] < middle], window.events[window.events["t"] >= middle]):
        image = np.zeros(window.shape, np.float32)
        np.add.at(image, (half["y"], half["x"]), np.where(half["p"] > 0, 1.0, -1.0))
        image = cv2.GaussianBlur(np.clip(image / max(image.std(), 1e-6), -3, 3), (0, 0), 1.0)
        halves.append(np.clip(128 + 40 * image, 0, 255).astype(np.uint8))
    found = cv2.calcOpticalFlowFarneback(*halves, None, 0.5, 3, 15, 3, 5, 1.1, 0)
    return 2 * np.moveaxis(found, -1, 0)


def mean_flow(window: Window) -> np.ndarray:
    """That of the true flow."""
    return np.broadcast_to(window.flow[:, window.has_events].mean(1)[:, None, None], window.flow.shape)


def method_of(study: Comparison, name: str, seed: int):
    """Window -> flow [2, H, W]."""
    known = {"farneback": farneback, "mean": mean_flow, "zero": lambda window: np.zeros(window.flow.shape, np.float32)}
    return known.get(name) or Method(study.root / "runs" / f"{name}_{seed}")


def tested(study: Comparison, windows: list[Window], name: str, seed: int) -> dict[str, float]:
    method = method_of(study, name, seed)
    return mean_scores([scores(window, method(window)) for window in windows])


def check_truth(windows: dict[str, list[Window]], real: Path | None) -> dict[str, float]:
    """Shares of the windows whose events are sharper along the true flow than against it; speed of the disk by its
    events alone. An error if either speaks against the truth."""
    found = {}
    for on, some in windows.items():
        found[on] = float(np.mean([sharpness(w, 1.0) > sharpness(w, -1.0) for w in some]))
        assert found[on] >= SHARPER, f"{on}: got {found[on]:.2f} of the windows sharper along the true flow"
    if real:
        speed, true = disk_speed(real, PLAN["real"])
        found["disk_deg_s"] = speed
        assert abs(speed / true - 1) < 0.1, f"the disk: got {speed:.0f} deg/s by its events, wanted {true:.0f}"
    return found


def noise_of(study: Comparison, name: str) -> float:
    """Share of the events of a folder that the noise of the renderer made, by the estimate of `pecs sense`."""
    found = [json.loads(p.read_text())["results"] for p in (study.root / "events" / name).glob("[0-9]*.run.json")]
    noisy = sum(r["events"] * r.get("render_noise", {"share": 0.0})["share"] for r in found)
    return noisy / sum(r["events"] for r in found)


def draw(study: Comparison, path: Path, names: list[str], seed: int, windows: list[Window]) -> None:
    """A row for each window: events, the flow of each method, the true one."""
    lines = []
    for window in windows:
        flows = [method_of(study, name, seed)(window).astype(np.float32) for name in names]
        flows = [*(np.where(window.known, flow, np.nan) for flow in flows), window.flow]
        cells = [
            pecs.event_picture(window.events, *window.shape[::-1]),
            *(flow_picture(np.moveaxis(f, 0, -1)) for f in flows),
        ]
        size = SHOWN_PX, round(SHOWN_PX * window.shape[0] / window.shape[1])
        lines.append(np.hstack([cv2.resize(c, size, interpolation=cv2.INTER_NEAREST)[..., ::-1] for c in cells]))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), titled(np.vstack(lines), ["events", *names, "truth"]), [cv2.IMWRITE_WEBP_QUALITY, 90])


def main(
    root: Path, *, only: list[str] = (), seeds: list[int] = tuple(PLAN["seeds"]), train: bool = False,
    real: Path | None = None, picture: Path | None = None,
) -> None:  # fmt: skip
    study = Comparison(root, PLAN)
    names = study.chosen(only)
    torch.set_num_threads(1)
    how = PLAN["training"] | {"intervals": tuple(PLAN["training"]["intervals"])}
    for seed, name in product(seeds, names):  # whole comparisons first
        config = FlowConfig(**how, seed=seed)
        trained(root / "runs" / f"{name}_{seed}", lambda name=name: training_views(study, name), config)
    if train:
        return

    tables = all_windows(study, real)
    windows = {on: some for one in tables for on, some in one.items()}
    truth = check_truth(windows, real)
    tests = {on: partial(tested, study, some) for on, some in windows.items()}
    results = study.scored(names, BASELINES, seeds, tests)
    counts = {name: sum(len(v.events) for v in training_views(study, name)) for name in names}
    thresholds = {name: study.threshold(name) for name in names}
    noise = {name: noise_of(study, name) for name in [*names, *(f"test_{on}" for on in PLAN["test"]["sensors"])]}
    found = {"truth": truth, "events": counts, "noise": noise, "thresholds": thresholds, "results": results}
    write_json(root / "results.json", {"plan": PLAN} | found)
    print(report.table(["", *names], [["threshold", *thresholds.values()], ["training events", *counts.values()]]))
    print(truth, noise)
    for metric, one in product(PLAN["test"]["metrics"], tables):
        print("\n" + table(results, [(on, metric) for on in one]))
    if picture:
        first = [w for on in list(windows)[:1] for w in windows[on]]
        by_sequence = [[w for w in first if w.name == name] for name in dict.fromkeys(w.name for w in first)]
        rows = [some[len(some) // 2] for some in by_sequence]
        rows += windows[PLAN["real"]["sequence"]][10:11] if real else []
        draw(study, picture, [*names, BASELINES[-1]], seeds[0], rows)


if __name__ == "__main__":
    command(main)
