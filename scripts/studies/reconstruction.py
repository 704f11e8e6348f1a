"""Does the simulator that made the training events matter for video from events? The light is the same for all; only
the sensor differs. What is compared, and how, is fixed in reconstruction.json.

    pecs dataset examples/recipes/reconstruction.toml -o out/reconstruction/light
    .venv-datasets/bin/python scripts/studies/reconstruction.py out/reconstruction [--only SIMULATOR] [--seeds 1,2,3]
        [--full [--device cuda]] [--real R_360_L.hdf5] [--footage FOLDER ...] [--lpips-weights FILE]
        [--ship python/pecs/learning/firenet]
        [--picture docs/studies/reconstruction.png [--beside python/pecs/learning/firenet.onnx]]

Needs PyTorch, onnxruntime, and piq (with torchvision); --real renders the disk with .venv. Each step whose result is
there is left out, so that it can be stopped and run again. Writes results.json and prints tables.
--ship trains the network that ships alone: NAME.onnx, and NAME.json with its record and scores.
--only: also of the plan's "more". --full: the plan's "full" in place of "training", in the folder `full`.
--footage: sequences in the layout of EVREAL or HS-ERGB. --lpips-weights: as pecs.learning.lpips reads them.
"""

import argparse
import json
import math
import shutil
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import torch
from pecs import read
from pecs._files import write_json
from pecs.datasets.sequence import Sequence, sequences
from pecs.learning.clips import ClipConfig, Recording
from pecs.learning.footage import Footage, read_footage
from pecs.learning.networks import NetworkConfig
from pecs.learning.reconstruct import Filter, Network
from pecs.learning.train import TrainConfig
from pecs_lab import comparison, real_disk
from pecs_lab.comparison import OURS, kept, mean_scores, table, titled
from pecs_lab.training import learnt, method_of
from pecs_lab.video_scores import picture_scores

PLAN = json.loads(Path(__file__).with_suffix(".json").read_text())
FILTER = "filter"
WIDE_PX = 1280  # of the picture


@dataclass(frozen=True)
class Work:
    """root: of light and events; what is trained depends on `training`, a part of the plan."""

    root: Path
    training: str = "training"
    device: str = "cpu"

    @property
    def folder(self) -> Path:
        """Of runs, scores and results."""
        return self.root if self.training == "training" else self.root / self.training


def simulators() -> dict[str, dict]:
    return PLAN["simulators"] | PLAN["more"]["simulators"]


# Events: the same light, another sensor.


def filter_of(sequence: Sequence) -> float:
    return comparison.log_uniform([1, int(sequence.name)], *PLAN["neutral_filter"]["range"])


def sensed(sequence: Sequence, output: Path, how: dict, threshold: float | None, light: float) -> int:
    camera = sequence.cameras[PLAN["camera"]]
    return comparison.sensed(sequence, camera, output, how, threshold, light, seed=1 + int(sequence.name))


def matched_threshold(work: Work, name: str) -> float:
    """With which there are as many events as ours are, in all of the light."""
    path, how = work.root / "events" / name / "threshold.json", PLAN["matching"]
    chosen = sequences(work.root / "light", how["split"])[:: how["every"]]

    def count(of: str, threshold: float | None) -> int:
        return sum(sensed(s, path.with_name("try.h5"), simulators()[of], threshold, 1.0) for s in chosen)

    return comparison.matched(path, lambda: count(OURS, None), lambda value: count(name, value), how["tolerance"])


def events_of(work: Work, name: str, sequence: Sequence) -> Path:
    path, how = work.root / "events" / name / f"{sequence.name}.h5", simulators()[name]
    if not path.exists():
        threshold = matched_threshold(work, name) if how.get("matched") else None
        sensed(sequence, path, how, threshold, filter_of(sequence))
    return path


@cache
def light_of(work: Work, split: str) -> list[tuple[Sequence, Recording]]:
    return [(s, Recording(s.cameras[PLAN["camera"]])) for s in sequences(work.root / "light", split)]


def seen_by(work: Work, name: str, split: str) -> list[Recording]:
    return [recording.with_events(read(events_of(work, name, s), "dsec")) for s, recording in light_of(work, split)]


# Training and scores.


def network_of(work: Work, name: str, seed: int) -> Path:
    """Trained on one simulator's events: its network.onnx."""
    run = work.folder / "runs" / f"{name}_{seed}"
    if not (run / "network.onnx").exists():
        learnt(run, seen_by(work, name, "train"), config_of(PLAN[work.training], seed), work.device)
    return run / "network.onnx"


def config_of(how: dict, seed: int) -> TrainConfig:
    return TrainConfig(
        NetworkConfig(how["network"], channels=how["channels"], levels=how.get("levels", 0)),
        ClipConfig(how["windows"], how["crop"]),
        how["steps"],
        how["batch"],
        how["learning_rate"],
        how.get("decay_steps", 0),
        seed=seed,
    )


def shipped(work: Work, name: Path, real: Path | None) -> None:
    """The network of the plan's "shipped": NAME.onnx, NAME.json."""
    how = PLAN["shipped"]
    sources = []
    for sequence, recording in light_of(work, "train"):
        for draw in range(how["draws"]):
            rng = np.random.Generator(np.random.Philox(key=[how["seed"], 1000 * int(sequence.name) + draw]))
            share = math.exp(rng.uniform(*map(math.log, how["light"])))
            overrides = {f"contrast_threshold_{p}": rng.uniform(*how["threshold"]) for p in ("on", "off")}
            path = work.root / "events" / "shipped" / f"{sequence.name}_{draw}.h5"
            if not path.exists():
                sensed(sequence, path, {"model": OURS, "overrides": overrides}, None, share)
            sources.append(recording.with_events(read(path, "dsec")))
    run = work.folder / "runs" / "shipped"
    learnt(run, sources, config_of(how["training"], how["seed"]), work.device)
    shutil.copy(run / "network.onnx", name.with_suffix(".onnx"))
    found = {}
    for who, weights in (("network", run / "network.onnx"), (FILTER, None)):
        rows = [scores(method_of(weights, f.size), f, None) for f in footage_of(work, OURS)]
        found[who] = {"held_out": mean_scores(rows)}
        if real:
            footage, disk = real_disk.load(real, work.root / "real", PLAN["real"])
            method = method_of(weights, footage.size)
            found[who][footage.name] = real_disk.scores(method, footage, disk, PLAN["real"])
    record = {"plan": PLAN, "run": json.loads((run / "config.json").read_text()), "scores": found}
    write_json(name.with_suffix(".json"), record)


def weights_of(work: Work, name: str, seed: int) -> Path | None:
    return None if name == FILTER else network_of(work, name, seed)


def scores(method: Filter | Network, footage: Footage, lpips: Path | None) -> dict[str, float]:
    """Means over the pictures after the first windows."""
    rows = []
    for k, window in enumerate(footage.windows):
        picture = method(window)
        if k >= PLAN["test"]["skipped_windows"]:
            rows.append(picture_scores(picture, footage.pictures[k + 1] / 255.0, lpips))
    return mean_scores(rows)


def footage_of(work: Work, on: str) -> list[Footage]:
    """A simulator's test set."""
    found = seen_by(work, on, PLAN["test"]["split"])
    return [Footage(r.camera.name, r.events, r.times_us, r.pictures) for r in found]


def tested(work: Work, name: str, seed: int, on: str, some: list[Footage], lpips: Path | None) -> dict[str, float]:
    """The network of one simulator: means over pictures, then over footage."""

    def make() -> dict[str, float]:
        weights = weights_of(work, name, seed)
        return mean_scores([scores(method_of(weights, footage.size), footage, lpips) for footage in some])

    what = f"{name}_{seed}_on_{on}" + ("_lpips" if lpips else "")
    return kept(work.folder / "scores" / f"{what}.json", make)


def on_disk(work: Work, name: str, seed: int, real: Path) -> dict[str, float]:
    def make() -> dict[str, float]:
        footage, disk = real_disk.load(real, work.root / "real", PLAN["real"])
        return real_disk.scores(method_of(weights_of(work, name, seed), footage.size), footage, disk, PLAN["real"])

    return kept(work.folder / "scores" / f"{name}_{seed}_on_{PLAN['real']['sequence']}.json", make)


# Tables.


def picture(work: Work, path: Path, names: list[str], seed: int, real: Path | None, more: Path | None) -> None:
    """One row for each of our test set, and the recording: the last picture, by the filter and each network, and truth.
    more: a network beside them."""
    rows = footage_of(work, OURS)
    if real:
        rows = [*rows[:2], real_disk.load(real, work.root / "real", PLAN["real"])[0]]
    methods = [weights_of(work, name, seed) for name in [FILTER, *names]] + ([more] if more else [])
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
    titles = [FILTER, *names, *(["network that ships"] if more else []), "truth"]
    cv2.imwrite(str(path), titled(np.vstack(lines).round().astype(np.uint8), titles))


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder with the set `light`, and of the results")
    parser.add_argument("--only", help='simulators, a list (default: all of the plan but "more")')
    parser.add_argument("--seeds", help="a list (default: those of the plan)")
    parser.add_argument("--full", action="store_true", help="networks and training of the plan's full size")
    parser.add_argument("--device", default="cpu", help="device of PyTorch for training: cpu, cuda")
    parser.add_argument("--real", type=Path, help="the recording R_360_L")
    parser.add_argument("--footage", type=Path, nargs="*", default=[], help="folders of other sequences")
    parser.add_argument("--lpips-weights", type=Path, help="LPIPS beside the other scores")
    parser.add_argument("--ship", type=Path, help="NAME of the two files")
    parser.add_argument("--picture", type=Path, help="PNG: filter, networks of the first seed, --beside, truth")
    parser.add_argument("--beside", type=Path, help="another network for the picture")
    args = parser.parse_args(words)
    work = Work(args.root, "full" if args.full else "training", args.device)
    names = args.only.split(",") if args.only else list(PLAN["simulators"])
    if unknown := set(names) - set(simulators()):
        parser.error(f"--only: got {', '.join(unknown)}, wanted some of {', '.join(simulators())}")
    seeds = [int(s) for s in args.seeds.split(",")] if args.seeds else PLAN["seeds"]
    torch.set_num_threads(1)

    if args.ship:
        shipped(work, args.ship, args.real)
        return
    for seed, name in product(seeds, names):  # whole comparisons first
        network_of(work, name, seed)
    others = {on: footage_of(work, on) for on in names} | {f.name: [read_footage(f)] for f in args.footage}
    results: dict[str, dict[str, list[dict[str, float]]]] = {}
    for name in [*names, FILTER]:
        of = [0] if name == FILTER else seeds
        results[name] = {}
        for on, some in others.items():
            results[name][on] = [tested(work, name, s, on, some, args.lpips_weights) for s in of]
        if args.real:
            results[name][PLAN["real"]["sequence"]] = [on_disk(work, name, s, args.real) for s in of]
    if args.picture:
        picture(work, args.picture, names, seeds[0], args.real, args.beside)
    write_json(work.folder / "results.json", {"plan": PLAN, "results": results})
    for metric in PLAN["test"]["metrics"] + (["lpips"] if args.lpips_weights else []):
        print(table(results, [(on, metric) for on in others], (FILTER,)) + "\n")
    if args.real:
        on = PLAN["real"]["sequence"]
        print(table(results, [(on, metric) for metric in results[FILTER][on][0]], (FILTER,)))


if __name__ == "__main__":
    main()
