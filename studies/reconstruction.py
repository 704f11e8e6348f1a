"""Does the simulator that made the training events matter for video from events? The light is the same for all; only
the sensor differs. What is compared, and how, is fixed in reconstruction.json.

    pecs dataset examples/recipes/reconstruction.toml -o out/reconstruction/light
    .venv-datasets/bin/python studies/reconstruction.py out/reconstruction [--only SIMULATOR,...] [--seeds 1,2,3]
        [--real R_360_L.hdf5] [--footage FOLDER ...] [--lpips-weights FILE] [--ship python/pecs/learning/firenet]
        [--picture docs/studies/reconstruction.png [--beside python/pecs/learning/firenet.onnx]]

Needs PyTorch, onnxruntime, and piq (with torchvision); --real renders the disk with .venv. Each step whose result is
there is left out, so that it can be stopped and run again. Writes results.json and prints tables.
--ship trains the network that ships alone: NAME.onnx, and NAME.json with its record and scores.
--footage: sequences in the layout of EVREAL or HS-ERGB. --lpips-weights: LPIPS as a TorchScript of two pictures
[1, 3, H, W] in -1 ... 1, as `torch.jit.trace` makes of the package lpips.
"""

import argparse
import json
import math
import shutil
import sys
from functools import cache
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import torch
from pecs import Chip, Light, read, sense
from pecs.datasets.files import write_json
from pecs.datasets.sequence import Sequence, sequences
from pecs.learning.clips import WHITE_PERCENTILE, ClipConfig, Recording, recordings
from pecs.learning.export import export
from pecs.learning.footage import Footage, read_footage
from pecs.learning.networks import NetworkConfig
from pecs.learning.reconstruct import Filter, Network
from pecs.learning.train import TrainConfig, train
from pecs_lab import real_disk
from pecs_lab.video_scores import picture_scores

PLAN = json.loads(Path(__file__).with_suffix(".json").read_text())
OURS, FILTER = "pecs", "filter"
WIDE_PX = 1280  # of the picture


# Events: the same light, another sensor.


def filter_of(sequence: Sequence) -> float:
    low, high = map(math.log, PLAN["neutral_filter"]["range"])
    return math.exp(np.random.Generator(np.random.Philox(key=[1, int(sequence.name)])).uniform(low, high))


def overrides_of(how: dict, threshold: float | None) -> dict[str, float]:
    out = dict(how.get("overrides", {}))
    return out if threshold is None else out | {f"contrast_threshold_{p}": threshold for p in ("on", "off")}


def chip_of(sequence: Sequence) -> str:
    return str(sequence.cameras[PLAN["camera"]].info["chip"])


def sensed(sequence: Sequence, output: Path, how: dict, threshold: float | None, light: float) -> int:
    """Number of events. Models that take pictures see white where the networks are shown it. light: share of it."""
    camera = sequence.cameras[PLAN["camera"]]
    overrides = overrides_of(how, threshold) | {"peak_qe": light * Chip(chip_of(sequence)).peak_qe}
    given = {"chip": chip_of(sequence), "overrides": overrides, "model": how["model"], "noise": how.get("noise", True)}
    if how["model"] != OURS:
        chip = Chip(chip_of(sequence), overrides={"peak_qe": overrides["peak_qe"]})
        with Light(camera.folder / "stack", chip, threads=1) as stack:
            values = stack.at(camera.truth.times_us[::10])
        given |= {"white_a": float(np.percentile(values, WHITE_PERCENTILE)), "readout": "ideal"}
    output.parent.mkdir(parents=True, exist_ok=True)
    more = {"format": "dsec", "duration_us": sequence.duration_us, "threads": 1}
    report = sense(camera.folder / "stack", output, seed=1 + int(sequence.name), **given, **more)
    return int(report["results"]["events"])


def matched_threshold(root: Path, name: str) -> float:
    """With which there are as many events as ours are, in all of the light: the secant method on logarithms of both."""
    path, how = root / "events" / name / "threshold.json", PLAN["matching"]
    if not path.exists():
        chosen = sequences(root / "light", how["split"])[:: how["every"]]
        scratch = path.with_name("try.h5")
        wanted = sum(sensed(s, scratch, PLAN["simulators"][OURS], None, 1.0) for s in chosen)
        tried: list[tuple[float, int]] = []
        value = 0.3
        while not tried or abs(tried[-1][1] / wanted - 1) > how["tolerance"]:
            got = sum(sensed(s, scratch, PLAN["simulators"][name], value, 1.0) for s in chosen)
            tried.append((value, got))
            print(f"{name}: threshold {value:.4f}: {got} events, wanted {wanted}", file=sys.stderr, flush=True)
            slope = -1.0
            if len(tried) > 1:
                slope = math.log(tried[-1][1] / tried[-2][1]) / math.log(tried[-1][0] / tried[-2][0])
            value *= (wanted / got) ** (1 / min(slope, -0.3))
        scratch.unlink()
        write_json(path, {"threshold": tried[-1][0], "tried": tried, "wanted": wanted})
    return float(json.loads(path.read_text())["threshold"])


def events_of(root: Path, name: str, sequence: Sequence) -> Path:
    path, how = root / "events" / name / f"{sequence.name}.h5", PLAN["simulators"][name]
    if not path.exists():
        threshold = matched_threshold(root, name) if how.get("matched") else None
        sensed(sequence, path, how, threshold, filter_of(sequence))
    return path


@cache
def light_of(root: Path, split: str) -> list[tuple[Sequence, Recording]]:
    found = sequences(root / "light", split)
    return list(zip(found, recordings(found), strict=True))


def seen_by(root: Path, name: str, split: str) -> list[Recording]:
    return [recording.with_events(read(events_of(root, name, s), "dsec")) for s, recording in light_of(root, split)]


# Training and scores.


def network_of(root: Path, name: str, seed: int) -> Path:
    """Trained on one simulator's events: its network.onnx."""
    run = root / "runs" / f"{name}_{seed}"
    if not (run / "network.onnx").exists():
        learnt(run, seen_by(root, name, "train"), PLAN["training"], seed)
    return run / "network.onnx"


def learnt(run: Path, sources: list[Recording], how: dict, seed: int) -> None:
    config = TrainConfig(
        NetworkConfig(how["network"], channels=how["channels"]),
        ClipConfig(how["windows"], how["crop"]),
        how["steps"],
        how["batch"],
        how["learning_rate"],
        how.get("decay_steps", 0),
        seed=seed,
    )

    def say(step: int, loss: float) -> None:
        if step % 50 == 0:
            print(f"{run.name}: {step}/{how['steps']}, loss {loss:.4f}", file=sys.stderr, flush=True)

    train(sources, run, config, progress=say)
    export(run, run / "network.onnx")


def shipped(root: Path, name: Path, real: Path | None) -> None:
    """The network of the plan's "shipped": NAME.onnx, NAME.json."""
    how = PLAN["shipped"]
    sources = []
    for sequence, recording in light_of(root, "train"):
        for draw in range(how["draws"]):
            rng = np.random.Generator(np.random.Philox(key=[how["seed"], 1000 * int(sequence.name) + draw]))
            share = math.exp(rng.uniform(*map(math.log, how["light"])))
            overrides = {f"contrast_threshold_{p}": rng.uniform(*how["threshold"]) for p in ("on", "off")}
            path = root / "events" / "shipped" / f"{sequence.name}_{draw}.h5"
            if not path.exists():
                sensed(sequence, path, {"model": OURS, "overrides": overrides}, None, share)
            sources.append(recording.with_events(read(path, "dsec")))
    run = root / "runs" / "shipped"
    learnt(run, sources, how["training"], how["seed"])
    shutil.copy(run / "network.onnx", name.with_suffix(".onnx"))
    found = {}
    for who, weights in (("network", run / "network.onnx"), (FILTER, None)):
        rows = [scores(method_of(weights, f.size), f, None) for f in footage_of(root, OURS)]
        found[who] = {"held_out": mean_scores(rows)}
        if real:
            footage, disk = real_disk.load(real, root / "real", PLAN["real"])
            method = method_of(weights, footage.size)
            found[who][footage.name] = real_disk.scores(method, footage, disk, PLAN["real"])
    record = {"plan": PLAN, "run": json.loads((run / "config.json").read_text()), "scores": found}
    write_json(name.with_suffix(".json"), record)


def method_of(weights: Path | None, size: tuple[int, int]) -> Filter | Network:
    return Network(weights, *size, threads=1) if weights else Filter(*size, 1.0)


def weights_of(root: Path, name: str, seed: int) -> Path | None:
    return None if name == FILTER else network_of(root, name, seed)


def mean_scores(rows: list[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def scores(method: Filter | Network, footage: Footage, lpips: Path | None) -> dict[str, float]:
    """Means over the pictures after the first windows."""
    rows = []
    for k, window in enumerate(footage.windows):
        picture = method(window)
        if k >= PLAN["test"]["skipped_windows"]:
            rows.append(picture_scores(picture, footage.pictures[k + 1] / 255.0, lpips))
    return mean_scores(rows)


def kept(path: Path, make) -> dict[str, float]:
    if not path.exists():
        write_json(path, make())
    return json.loads(path.read_text())


def footage_of(root: Path, on: str) -> list[Footage]:
    """A simulator's test set."""
    found = seen_by(root, on, PLAN["test"]["split"])
    return [Footage(r.camera.name, r.events, r.times_us, r.pictures) for r in found]


def tested(root: Path, name: str, seed: int, on: str, some: list[Footage], lpips: Path | None) -> dict[str, float]:
    """The network of one simulator: means over pictures, then over footage."""

    def make() -> dict[str, float]:
        weights = weights_of(root, name, seed)
        return mean_scores([scores(method_of(weights, footage.size), footage, lpips) for footage in some])

    return kept(root / "scores" / f"{name}_{seed}_on_{on}.json", make)


def on_disk(root: Path, name: str, seed: int, real: Path) -> dict[str, float]:
    def make() -> dict[str, float]:
        footage, disk = real_disk.load(real, root / "real", PLAN["real"])
        return real_disk.scores(method_of(weights_of(root, name, seed), footage.size), footage, disk, PLAN["real"])

    return kept(root / "scores" / f"{name}_{seed}_on_{PLAN['real']['sequence']}.json", make)


# Tables.


def table(results: dict[str, dict[str, list[dict[str, float]]]], keys: list[tuple[str, str]]) -> str:
    """keys: (tested on, metric), one column each. Mean ± standard deviation over seeds; in brackets the mean of the
    paired differences to ours ± its standard error."""
    lines = ["| trained on | " + " | ".join(f"{on}: {metric}" for on, metric in keys) + " |"]
    lines.append("|---|" + "---|" * len(keys))
    for name, row in results.items():
        cells = []
        for on, metric in keys:
            values = np.array([r[metric] for r in row[on]])
            ours = np.array([r[metric] for r in results.get(OURS, {}).get(on, [])])
            cell = f"{values.mean():.3f}" + (f" ± {values.std(ddof=1):.3f}" if len(values) > 1 else "")
            if name not in (OURS, FILTER) and len(values) == len(ours) > 1:
                apart = values - ours
                cell += f" ({apart.mean():+.3f} ± {apart.std(ddof=1) / math.sqrt(len(apart)):.3f})"
            cells.append(cell)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def picture(root: Path, path: Path, names: list[str], seed: int, real: Path | None, more: Path | None) -> None:
    """One row for each of our test set, and the recording: the last picture, by the filter and each network, and truth.
    more: a network beside them."""
    rows = footage_of(root, OURS)
    if real:
        rows = [*rows[:2], real_disk.load(real, root / "real", PLAN["real"])[0]]
    methods = [weights_of(root, name, seed) for name in [FILTER, *names]] + ([more] if more else [])
    lines = []
    for footage in rows:
        shown = []
        for weights in methods:
            method = method_of(weights, footage.size)
            shown.append([method(window) for window in footage.windows][-1] * 255)
        line = np.hstack([*shown, footage.pictures[-1]])
        lines.append(
            cv2.resize(line, None, fx=(scale := WIDE_PX / line.shape[1]), fy=scale, interpolation=cv2.INTER_AREA)
        )
    cv2.imwrite(str(path), np.vstack(lines).round().astype(np.uint8))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder with the set `light`, and of the results")
    parser.add_argument("--only", help="simulators, a list (default: all)")
    parser.add_argument("--seeds", help="a list (default: those of the plan)")
    parser.add_argument("--real", type=Path, help="the recording R_360_L")
    parser.add_argument("--footage", type=Path, nargs="*", default=[], help="folders of other sequences")
    parser.add_argument("--lpips-weights", type=Path)
    parser.add_argument("--ship", type=Path, help="NAME of the two files")
    parser.add_argument("--picture", type=Path, help="PNG: filter, networks of the first seed, --beside, truth")
    parser.add_argument("--beside", type=Path, help="another network for the picture")
    args = parser.parse_args()
    names = args.only.split(",") if args.only else list(PLAN["simulators"])
    seeds = [int(s) for s in args.seeds.split(",")] if args.seeds else PLAN["seeds"]
    torch.set_num_threads(1)

    if args.ship:
        shipped(args.root, args.ship, args.real)
        return
    for seed, name in product(seeds, names):  # whole comparisons first
        network_of(args.root, name, seed)
    others = {on: footage_of(args.root, on) for on in names} | {f.name: [read_footage(f)] for f in args.footage}
    results: dict[str, dict[str, list[dict[str, float]]]] = {}
    for name in [*names, FILTER]:
        of = [0] if name == FILTER else seeds
        results[name] = {}
        for on, some in others.items():
            results[name][on] = [tested(args.root, name, s, on, some, args.lpips_weights) for s in of]
        if args.real:
            results[name][PLAN["real"]["sequence"]] = [on_disk(args.root, name, s, args.real) for s in of]
    if args.picture:
        picture(args.root, args.picture, names, seeds[0], args.real, args.beside)
    write_json(args.root / "results.json", {"plan": PLAN, "results": results})
    for metric in PLAN["test"]["metrics"] + (["lpips"] if args.lpips_weights else []):
        print(table(results, [(on, metric) for on in others]) + "\n")
    if args.real:
        on = PLAN["real"]["sequence"]
        print(table(results, [(on, metric) for metric in results[FILTER][on][0]]))


if __name__ == "__main__":
    main()
