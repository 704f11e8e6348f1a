"""How many pictures per second does a network make?

    .venv-datasets/bin/python scripts/bench/reconstruction.py [--weights NETWORK.onnx] [--threads 1]

Reconstruction (346x260, 1 million events/s, 50 pictures/s) is timed from event file to MP4, by the network, by it with
--smooth and by the filter in turn. Prints JSON: medians over passes, by the clock and by the CPU time of all threads
(on a machine with other work the clock says more about that), and the load.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
import pecs
import torch
from pecs.learning.reconstruct import WEIGHTS, reconstruct
from pecs_lab.measure import command

PASSES, SECONDS = 3, 4.0  # each of so long a recording
WIDTH, HEIGHT, EVENTS_PER_S = 346, 260, 1_000_000


def reconstruction(weights: Path, threads: int) -> dict:
    rng = np.random.default_rng(1)
    events = np.zeros(int(EVENTS_PER_S * SECONDS), pecs.EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, int(SECONDS * 1e6), len(events)))
    events["x"], events["y"] = rng.integers(0, WIDTH, len(events)), rng.integers(0, HEIGHT, len(events))
    events["p"] = rng.integers(0, 2, len(events))
    ways = {"network": {"weights": weights}, "smooth": {"weights": weights, "smooth": True}}
    ways["filter"] = {"method": "filter"}
    rates = {how: [] for how in ways}  # [pictures/s, CPU seconds of a picture]
    with tempfile.TemporaryDirectory() as scratch:
        pecs.write(f"{scratch}/events.raw", events, WIDTH, HEIGHT)
        for one in range(PASSES):
            for how, options in ways.items():
                begin, begin_cpu = time.perf_counter(), time.process_time()
                video = f"{scratch}/{how}{one}.mp4"
                done = reconstruct(f"{scratch}/events.raw", video, threads=threads, **options)
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
    return {"reconstruction": reconstruction(weights, threads), "threads": threads}


if __name__ == "__main__":
    command(main)
