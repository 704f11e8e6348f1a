"""Does the simulator that made the training events matter for optical flow? The light is the same for all; only the
sensor differs. What is compared, and how, is fixed in flow.json.

    pecs dataset examples/recipes/flow.toml -o out/flow/light
    .venv-datasets/bin/python scripts/studies/flow.py out/flow --real R_360_L.hdf5 [--only SIMULATOR] [--seeds 1,2,3]
        [--train] [--picture docs/studies/flow.webp]

Needs PyTorch. Each step whose result is there is left out, so that it can be stopped and run again; processes
with different --only or --seeds can --train at once. Writes results.json and prints tables.
"""

import argparse
import json
from functools import cache
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import torch
from pecs._files import write_json
from pecs.datasets.sequence import Sequence, sequences
from pecs_lab import comparison, report
from pecs_lab.comparison import OURS, kept, mean_scores, table, titled
from pecs_lab.flow_net import FlowConfig, Method, trained
from pecs_lab.flow_windows import Flows, View, Window, disk_speed, real_windows, sharpness

PLAN = json.loads(Path(__file__).with_suffix(".json").read_text())
BASELINES = ("zero", "mean", "farneback")
SHARPER = 0.9  # least share of the windows whose events are sharper along the true flow than against it
SHOWN_PX = 160  # width of a picture's cell


def simulators() -> dict[str, dict]:
    return PLAN["simulators"] | PLAN["more"]["simulators"]


# Events: the same light, another sensor.


@cache
def flows_of(root: Path, split: str) -> list[tuple[Sequence, Flows]]:
    return [(s, Flows(s.cameras[PLAN["camera"]])) for s in sequences(root / "light", split)]


def sensed(sequence: Sequence, output: Path, how: dict, threshold: float | None, light: float, draw: int = 0) -> int:
    camera, seed = sequence.cameras[PLAN["camera"]], 1 + 100 * draw + int(sequence.name)
    return comparison.sensed(sequence, camera, output, how, threshold, light, seed)


def threshold_of(root: Path, name: str) -> float:
    """In all of the light there are as many events as ours are."""
    how = simulators()[name]
    if not how.get("matched"):
        return PLAN["threshold"]
    path = root / "events" / name / "threshold.json"
    chosen = [s for s, _ in flows_of(root, PLAN["matching"]["split"])][:: PLAN["matching"]["every"]]

    def count(of: str, threshold: float) -> int:
        scratch = path.with_name("try.h5")
        return sum(sensed(s, scratch, simulators()[of], threshold, 1.0) for s in chosen)

    return comparison.matched(
        path, lambda: count(OURS, PLAN["threshold"]), lambda value: count(name, value), PLAN["matching"]["tolerance"]
    )


def training_views(root: Path, name: str) -> list[View]:
    out, how = [], PLAN["draws"]
    for (sequence, flows), draw in product(flows_of(root, "train"), range(how["count"])):
        path = root / "events" / name / f"{sequence.name}_{draw}.h5"
        if not path.exists():
            number = int(sequence.name)
            light, factor = (
                comparison.log_uniform([kind, 1000 * draw + number], *how[key])
                for kind, key in ((1, "light"), (2, "threshold"))
            )
            threshold = threshold_of(root, name) * factor
            given = simulators()[name]
            sensed(sequence, path, given, threshold, given.get("light", light), draw)
        out.append(View(flows, path))
    return out


def test_windows(root: Path, sensor: str) -> list[Window]:
    out, how, test = [], PLAN["test"]["sensors"][sensor], PLAN["test"]
    for sequence, flows in flows_of(root, test["split"]):
        path = root / "events" / f"test_{sensor}" / f"{sequence.name}.h5"
        if not path.exists():
            if name := how.get("simulator"):
                sensed(sequence, path, simulators()[name], threshold_of(root, name), 1.0)
            else:
                sensed(sequence, path, how, None, how.get("light", 1.0))
        out += View(flows, path).windows(test["first"], test["intervals"], test["step"])
    return out


# Scores.


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


def method_of(root: Path, name: str, seed: int):
    """Window -> flow [2, H, W]. "mean" is told the mean of the true flow."""
    if name == "farneback":
        return farneback
    if name == "zero":
        return lambda window: np.zeros(window.flow.shape, np.float32)
    if name == "mean":
        return lambda window: np.broadcast_to(
            window.flow[:, window.has_events].mean(1)[:, None, None], window.flow.shape
        )
    net = Method(root / "runs" / f"{name}_{seed}" / "network.pt")
    return lambda window: net(window.events, window.shape, window.begin_us, window.end_us)


def tested(root: Path, name: str, seed: int, on: str, windows: list[Window]) -> dict[str, float]:
    def make() -> dict[str, float]:
        method = method_of(root, name, seed)
        return mean_scores([scores(window, method(window)) for window in windows])

    return kept(root / "scores" / f"{name}_{seed}_on_{on}.json", make)


def check_truth(windows: dict[str, list[Window]], real: Path | None) -> dict[str, float]:
    """Shares of the windows whose events are sharper along the true flow than against it; speed of the disk by its
    events alone. An error if either speaks against the truth."""
    found = {}
    for on, some in windows.items():
        better = [sharpness(w, 1.0) > sharpness(w, -1.0) for w in some]
        found[on] = float(np.mean(better))
        assert found[on] >= SHARPER, f"{on}: got {found[on]:.2f} of the windows sharper along the true flow"
    if real:
        speed, true = disk_speed(real, PLAN["real"])
        found["disk_deg_s"] = speed
        assert abs(speed / true - 1) < 0.1, f"the disk: got {speed:.0f} deg/s by its events, wanted {true:.0f}"
    return found


def noise_of(root: Path, name: str) -> float:
    """Share of the events of a folder that the noise of the renderer made, by the estimate of `pecs sense`."""
    found = [json.loads(p.read_text())["results"] for p in (root / "events" / name).glob("[0-9]*.run.json")]
    noisy = sum(r["events"] * r.get("render_noise", {"share": 0.0})["share"] for r in found)
    return noisy / sum(r["events"] for r in found)


def all_windows(root: Path, real: Path | None) -> dict[str, list[Window]]:
    out = {on: test_windows(root, on) for on in PLAN["test"]["sensors"]}
    for on in [on for on in PLAN["test"]["by_scene"] if on in out]:
        for scene in dict.fromkeys(s.info["scene"] for s, _ in flows_of(root, PLAN["test"]["split"])):
            names = {s.name for s, _ in flows_of(root, PLAN["test"]["split"]) if s.info["scene"] == scene}
            out[f"{on}, {scene}"] = [w for w in out[on] if w.name in names]
    if real:
        plan = PLAN["real"]
        out[plan["sequence"]] = real_windows(real, plan)
        for more in plan["also"]:
            name = f"{plan['sequence']}, {more['coarser']} x {more['coarser']}, {more['window_us'] // 1000} ms"
            out[name] = real_windows(real, plan | more)
    return out


def groups(names: list[str]) -> list[list[str]]:
    """Test sets of one table: those of the plan; the recording in other windows; each sensor's scenes."""
    first = [on for on in names if "," not in on]
    return [
        first,
        *([on for on in names if on.startswith(f"{one}, ")] for one in first if f"{one}, " in " ".join(names)),
    ]


# Pictures.


def wheel(flow: np.ndarray, most_px: float) -> np.ndarray:
    """Direction as hue, length as saturation; grey where unknown. BGR."""
    known = np.isfinite(flow).all(0)
    x, y = np.nan_to_num(flow)
    hue = (np.degrees(np.arctan2(y, x)) % 360) / 2
    strong = np.clip(np.hypot(x, y) / most_px, 0, 1) * 255
    hsv = np.stack([hue, strong, np.full_like(hue, 255)], -1).astype(np.uint8)
    shown = cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)
    shown[~known] = 128
    return shown


def event_picture(window: Window) -> np.ndarray:
    shown = np.full((*window.shape, 3), 255, np.uint8)
    events = window.events
    shown[events["y"], events["x"]] = np.where(events["p"][:, None] > 0, (30, 100, 220), (190, 120, 20))
    return shown


def picture(root: Path, path: Path, names: list[str], seed: int, windows: list[Window]) -> None:
    """A row for each window: events, the flow of each method, the true one."""
    lines = []
    for window in windows:
        most = float(np.nanpercentile(np.hypot(*window.flow), 95))
        cells = [event_picture(window)]
        for name in names:
            found = method_of(root, name, seed)(window).astype(np.float32)
            cells.append(wheel(np.where(window.known, found, np.nan), most))
        cells.append(wheel(window.flow, most))
        height = round(SHOWN_PX * window.shape[0] / window.shape[1])
        lines.append(np.hstack([cv2.resize(c, (SHOWN_PX, height), interpolation=cv2.INTER_NEAREST) for c in cells]))
    shown = titled(np.vstack(lines), ["events", *names, "truth"])
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), shown, [cv2.IMWRITE_WEBP_QUALITY, 90])


def data_picture(root: Path, path: Path) -> None:
    """Training data: a window of the first sequences by each simulator, and its flow."""
    lines = []
    views = {name: training_views(root, name) for name in PLAN["simulators"]}
    for k in range(0, min(8, len(views[OURS]))):
        shown = [v[k].windows(4, 2, 2)[0] for v in views.values()]
        cells = [*map(event_picture, shown), wheel(shown[0].flow, 4.0)]
        lines.append(np.hstack([cv2.resize(c, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST) for c in cells]))
    cv2.imwrite(str(path), titled(np.vstack(lines), [*views, "flow"]))


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder with the set `light`, and of the results")
    parser.add_argument("--only", help='simulators, a list (default: all of the plan but "more")')
    parser.add_argument("--seeds", help="a list (default: those of the plan)")
    parser.add_argument("--train", action="store_true", help="train, and score nothing")
    parser.add_argument("--real", type=Path, help="the recording R_360_L")
    parser.add_argument("--picture", type=Path, help="events, flows of the first seed's networks, true flow")
    parser.add_argument("--data-picture", type=Path, help="events of the training set, by each simulator")
    args = parser.parse_args(words)
    root, names = args.root, args.only.split(",") if args.only else list(PLAN["simulators"])
    if unknown := set(names) - set(simulators()):
        parser.error(f"--only: got {', '.join(unknown)}, wanted some of {', '.join(simulators())}")
    seeds = [int(s) for s in args.seeds.split(",")] if args.seeds else PLAN["seeds"]
    torch.set_num_threads(1)

    if args.data_picture:
        data_picture(root, args.data_picture)
        return
    how = PLAN["training"] | {"intervals": tuple(PLAN["training"]["intervals"])}
    for seed, name in product(seeds, names):  # whole comparisons first
        trained(
            root / "runs" / f"{name}_{seed}", lambda name=name: training_views(root, name), FlowConfig(**how, seed=seed)
        )
    if args.train:
        return

    windows = all_windows(root, args.real)
    truth = check_truth(windows, args.real)
    results: dict[str, dict[str, list[dict[str, float]]]] = {}
    for name in [*names, *BASELINES]:
        of = [0] if name in BASELINES else seeds
        results[name] = {on: [tested(root, name, s, on, some) for s in of] for on, some in windows.items()}
    counts = {name: sum(len(v.events) for v in training_views(root, name)) for name in names}
    thresholds = {name: threshold_of(root, name) for name in names}
    noise = {name: noise_of(root, name) for name in names} | {
        on: noise_of(root, f"test_{on}") for on in PLAN["test"]["sensors"]
    }
    found = {
        "plan": PLAN,
        "truth": truth,
        "events": counts,
        "noise": noise,
        "thresholds": thresholds,
        "results": results,
    }
    write_json(root / "results.json", found)
    print(report.table(["", *names], [["threshold", *thresholds.values()], ["training events", *counts.values()]]))
    print(truth, noise)
    for metric, group in product(PLAN["test"]["metrics"], groups(list(windows))):
        print("\n" + table(results, [(on, metric) for on in group], BASELINES))
    if args.real:
        on = PLAN["real"]["sequence"]
        print("\n" + table(results, [(on, metric) for metric in results["zero"][on][0]], BASELINES))
    if args.picture:
        first = next(iter(windows.values()))
        by_sequence = [[w for w in first if w.name == name] for name in dict.fromkeys(w.name for w in first)]
        rows = [some[len(some) // 2] for some in by_sequence]
        rows += windows[PLAN["real"]["sequence"]][10:11] if args.real else []
        picture(root, args.picture, [*names, BASELINES[-1]], seeds[0], rows)


if __name__ == "__main__":
    main()
