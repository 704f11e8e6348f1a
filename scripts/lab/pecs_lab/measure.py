"""Measurements that benches share: a program's time and memory, medians of passes, pairs of events."""

import os
import statistics
import subprocess
import time
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Run:
    exit: int
    seconds: float
    cpu_s: float  # of all threads and of the processes that it waited for
    peak_mb: float
    errors: str  # standard error


def measured(command: list) -> Run:
    start = time.perf_counter()
    child = subprocess.Popen(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    errors = child.stderr.read().decode()
    _, status, usage = os.wait4(child.pid, 0)
    seconds, code = time.perf_counter() - start, os.waitstatus_to_exitcode(status)
    return Run(code, seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, errors)


def median_s(work, passes: int) -> tuple[float, object]:
    """Median wall time of the passes, and what `work` returned last."""
    seconds, value = [], None
    for _ in range(passes):
        start = time.perf_counter()
        value = work()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), value


def by_pixel(events, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Keys (pixel, polarity) and times of events, sorted by key and time."""
    key = (events["y"].astype(np.int64) * width + events["x"]) * 2 + events["p"]
    order = np.lexsort((events["t"], key))
    return key[order], events["t"][order].astype(float)
