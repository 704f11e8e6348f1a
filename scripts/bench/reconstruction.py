"""Does making clips slow training down, and how many pictures per second does a network make?

    .venv-datasets/bin/python scripts/bench/reconstruction.py [--weights NETWORK.onnx] [--threads 1]

Training (the defaults of `pecs train`, on a few drawn sequences) is timed with clips that are made, and with the same
clips as tensors in memory, in turn. Reconstruction (346x260, 1 million events/s, 50 pictures/s) is timed from event
file to MP4, by the network and by the filter in turn. Prints JSON: medians over passes, by the clock and by the CPU
time of all threads (on a machine with other work the clock says more about that), and the load.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
import pecs
import torch
from pecs.learning.clips import Clips
from pecs.learning.networks import RecurrentUNet
from pecs.learning.procedural import ProceduralConfig, sequences
from pecs.learning.reconstruct import WEIGHTS, reconstruct
from pecs.learning.train import TrainConfig, learn
from pecs_lab.measure import command

SEQUENCES, STEPS = 4, 6  # of training
PASSES, SECONDS = 5, 1.0  # of reconstruction, each of so long a recording
CLOCKS = "clock", "cpu"
WIDTH, HEIGHT, EVENTS_PER_S = 346, 260, 1_000_000


def training() -> dict:
    config = TrainConfig()
    net = RecurrentUNet(config.network)
    optimiser = torch.optim.Adam(net.parameters())
    sources = sequences(1, ProceduralConfig(count=SEQUENCES))
    clips = Clips(sources, config.clips, config.network.bins, 1, STEPS * config.batch)
    kept = list(torch.utils.data.DataLoader(clips, config.batch))
    read = iter(torch.utils.data.DataLoader(clips, config.batch))
    learn(net, optimiser, kept[0], config)  # allocations
    seconds = {"read": [], "in_memory": []}  # of a step: by the clock, of CPU
    for k in range(STEPS):
        for how, took in seconds.items():
            begin, begin_cpu = time.perf_counter(), time.process_time()
            learn(net, optimiser, next(read) if how == "read" else kept[k], config)
            took.append((time.perf_counter() - begin, time.process_time() - begin_cpu))
    shares = np.array(seconds["in_memory"]) / seconds["read"]
    return {
        "s_per_step": {how: dict(zip(CLOCKS, np.median(v, 0).tolist(), strict=True)) for how, v in seconds.items()},
        "speed_of_in_memory": dict(zip(CLOCKS, np.median(shares, 0).tolist(), strict=True)),
        "steps": shares.round(3).tolist(),
    }


def reconstruction(weights: Path, threads: int) -> dict:
    rng = np.random.default_rng(1)
    events = np.zeros(int(EVENTS_PER_S * SECONDS), pecs.EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, int(SECONDS * 1e6), len(events)))
    events["x"], events["y"] = rng.integers(0, WIDTH, len(events)), rng.integers(0, HEIGHT, len(events))
    events["p"] = rng.integers(0, 2, len(events))
    rates = {"network": [], "filter": []}  # [pictures/s, CPU seconds of a picture]
    with tempfile.TemporaryDirectory() as scratch:
        pecs.write(f"{scratch}/events.raw", events, WIDTH, HEIGHT)
        for one in range(PASSES):
            for how, file in (("network", weights), ("filter", None)):
                begin, begin_cpu = time.perf_counter(), time.process_time()
                video = f"{scratch}/{how}{one}.mp4"
                done = reconstruct(f"{scratch}/events.raw", video, method=how, weights=file, threads=threads)
                took = time.perf_counter() - begin, time.process_time() - begin_cpu
                rates[how].append((done["pictures"] / took[0], took[1] / done["pictures"]))
    return {
        how: {
            "pictures_per_s": float(np.median(values, 0)[0]),
            "cpu_s_per_picture": float(np.median(values, 0)[1]),
            "passes": np.round(values, 3).tolist(),
        }
        for how, values in rates.items()
    }


def main(*, weights: Path = WEIGHTS, threads: int = 1) -> dict:
    torch.set_num_threads(threads)  # more than are free slow all down
    return {"training": training(), "reconstruction": reconstruction(weights, threads), "threads": threads}


if __name__ == "__main__":
    command(main)
