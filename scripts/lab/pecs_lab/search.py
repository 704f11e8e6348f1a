"""The search that every fitted model gets: points of a Sobol sequence over the ranges, then CMA-ES from the best of
them. Requires cma (PyPI)."""

import time
import warnings
from collections.abc import Callable

import numpy as np
from scipy.stats import qmc

STARTS, SOBOL, POPULATION = 2, 256, 16


class Box:
    """Free values as points of the unit cube; in their logarithm where a range's low end is above 0."""

    def __init__(self, ranges: dict):
        self.names = list(ranges)
        low, high = np.array(list(ranges.values())).T
        self.log = low > 0
        self.low, self.high = (np.where(self.log, np.log(np.maximum(v, 1e-300)), v) for v in (low, high))

    def values(self, x: np.ndarray) -> dict:
        at = self.low + np.clip(x, 0, 1) * (self.high - self.low)
        at = np.where(self.log, np.exp(np.where(self.log, at, 0)), at)
        return {k: float(f"{v:.4g}") for k, v in zip(self.names, at.tolist(), strict=True)}

    def point(self, values: dict) -> np.ndarray:
        at = np.array([values[k] for k in self.names])
        at = np.where(self.log, np.log(np.where(self.log, at, 1)), at)
        return np.clip((at - self.low) / (self.high - self.low), 0, 1)


def search(loss: Callable[[dict], float], ranges: dict, evaluations: int, start: dict | None = None) -> dict:
    """The values of the least loss, and how they were found. `start`: values to start from, instead of a sequence."""
    import cma

    warnings.filterwarnings("ignore", module="cma")
    box, done, began = Box(ranges), [], time.process_time()

    def tried(x: np.ndarray) -> float:
        done.append((loss(box.values(x)), np.clip(x, 0, 1)))
        return done[-1][0]

    if start:
        starts, width = [box.point(start)], 0.1
        tried(starts[0])
    else:
        points = qmc.Sobol(len(box.names), seed=1).random(SOBOL)
        starts, width = points[np.argsort([tried(x) for x in points])[:STARTS]], 0.2
    after_first, rest, ends = min(miss for miss, _ in done), (evaluations - len(done)) // len(starts), []
    for i, x in enumerate(starts):
        options = {"bounds": [0, 1], "popsize": POPULATION, "seed": i + 1, "verbose": -9, "maxfevals": rest}
        before = len(done)
        cma.fmin2(tried, x, width, options)
        ends.append(min(miss for miss, _ in done[before:]))
    miss, x = min(done, key=lambda d: d[0])
    at_bound = [k for k, v in zip(box.names, x.tolist(), strict=True) if min(v, 1 - v) < 0.01]
    spent = {"evaluations": len(done), "cpu_s": round(time.process_time() - began)}
    row = {"parameters": len(box.names), "objective": miss, "objective_after_sobol": after_first}
    return row | {"objective_of_starts": ends, "at_bound": at_bound} | spent | {"values": box.values(x)}
