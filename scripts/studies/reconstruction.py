"""Does the simulator that made the training events matter for video from events? The light is the same for all; only
the sensor differs. What is compared, and how, is fixed in reconstruction.json.

    pecs dataset examples/recipes/reconstruction.toml -o out/reconstruction/light
    .venv-datasets/bin/python scripts/studies/reconstruction.py out/reconstruction [--only SIMULATOR ...]
        [--seeds 1 2 3] [--real R_360_L.hdf5] [--picture docs/studies/reconstruction.png]

Needs PyTorch, onnxruntime, and piq (with torchvision); --real renders the disk with .venv. Each step whose result is
there is left out, so that it can be stopped and run again. Writes results.json and prints tables; `shipped` is the
network of `pecs reconstruct`.
"""

import json
import sys
from functools import cache, partial
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import torch
from pecs import read
from pecs._files import write_json
from pecs.datasets.sequence import Sequence
from pecs.learning.clips import ClipConfig, Recording
from pecs.learning.export import export
from pecs.learning.footage import Footage
from pecs.learning.networks import NetworkConfig
from pecs.learning.reconstruct import WEIGHTS, Filter, Network
from pecs.learning.train import TrainConfig, train
from pecs_lab import real_disk
from pecs_lab.comparison import OURS, Comparison, mean_scores, table, titled
from pecs_lab.measure import command

PLAN = json.loads(Path(__file__).with_suffix(".json").read_text())
FILTER, SHIPPED = "filter", "shipped"
WIDE_PX = 1280  # of the picture


@cache
def light_of(study: Comparison, split: str) -> list[tuple[Sequence, Recording]]:
    return [(s, Recording(study.camera(s))) for s in study.sequences(split)]


def seen_by(study: Comparison, name: str, split: str) -> list[Recording]:
    return [recording.with_events(read(study.events(name, s), "dsec")) for s, recording in light_of(study, split)]


def trained(study: Comparison, name: str, seed: int) -> Path:
    """Trained on one simulator's events: its network.onnx."""
    run, how = study.root / "runs" / f"{name}_{seed}", PLAN["training"]
    if not (run / "network.onnx").exists():
        clips = ClipConfig(how["windows"], how["crop"])
        network = NetworkConfig("firenet", channels=how["channels"])
        config = TrainConfig(network, clips, how["steps"], how["batch"], how["learning_rate"], seed=seed)
        print(run, file=sys.stderr, flush=True)
        train(seen_by(study, name, "train"), run, config)
        export(run, run / "network.onnx")
    return run / "network.onnx"


def method_of(study: Comparison, name: str, seed: int, size: tuple[int, int]) -> Filter | Network:
    if name == FILTER:
        return Filter(*size, 1.0)
    return Network(WEIGHTS if name == SHIPPED else trained(study, name, seed), *size, threads=1)


def scores(method: Filter | Network, footage: Footage) -> dict[str, float]:
    """Means over the pictures after the first windows."""
    rows = []
    for k, window in enumerate(footage.windows):
        picture = method(window)
        if k >= PLAN["test"]["skipped_windows"]:
            rows.append(real_disk.picture_scores(picture, footage.pictures[k + 1] / 255.0))
    return mean_scores(rows)


def footage_of(study: Comparison, on: str) -> list[Footage]:
    """A simulator's test set."""
    found = seen_by(study, on, PLAN["test"]["split"])
    return [Footage(r.camera.name, r.events, r.times_us, r.pictures) for r in found]


def tested(study: Comparison, some: list[Footage], name: str, seed: int) -> dict[str, float]:
    """Means over pictures, then over footage."""
    return mean_scores([scores(method_of(study, name, seed, footage.size), footage) for footage in some])


def on_disk(study: Comparison, real: Path, name: str, seed: int) -> dict[str, float]:
    footage, disk = real_disk.load(real, study.root / "real", PLAN["real"])
    return real_disk.scores(method_of(study, name, seed, footage.size), footage, disk, PLAN["real"])


def draw(study: Comparison, path: Path, names: list[str], seed: int, real: Path | None) -> None:
    """One row for each of our test set, and the recording: the last picture, by each method, and truth."""
    rows, lines = footage_of(study, OURS), []
    if real:
        rows = [*rows[:2], real_disk.load(real, study.root / "real", PLAN["real"])[0]]
    for footage in rows:
        methods = [method_of(study, name, seed, footage.size) for name in names]
        shown = [[method(window) for window in footage.windows][-1] * 255 for method in methods]
        line = np.hstack([*shown, footage.pictures[-1]])
        scale = WIDE_PX / line.shape[1]
        lines.append(cv2.resize(line, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    cv2.imwrite(str(path), titled(np.vstack(lines).round().astype(np.uint8), [*names, "truth"]))


def main(
    root: Path, *, only: list[str] = (), seeds: list[int] = tuple(PLAN["seeds"]), real: Path | None = None,
    picture: Path | None = None,
) -> None:  # fmt: skip
    study = Comparison(root, PLAN)
    names = study.chosen(only)
    torch.set_num_threads(1)
    for seed, name in product(seeds, names):  # whole comparisons first
        trained(study, name, seed)
    tests = {on: partial(tested, study, footage_of(study, on)) for on in names}
    if real:
        tests[PLAN["real"]["sequence"]] = partial(on_disk, study, real)
    results = study.scored(names, (SHIPPED, FILTER), seeds, tests)
    if picture:
        draw(study, picture, [FILTER, *names, SHIPPED], seeds[0], real)
    write_json(root / "results.json", {"plan": PLAN, "results": results})
    for metric in PLAN["test"]["metrics"]:
        print(table(results, [(on, metric) for on in names]) + "\n")
    if real:
        on = PLAN["real"]["sequence"]
        print(table(results, [(on, metric) for metric in results[FILTER][on][0]]))


if __name__ == "__main__":
    command(main)
