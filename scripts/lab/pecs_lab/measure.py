"""Parts that studies and benches share: a command line, a program's time and memory, medians of passes, pairs of
events."""

import argparse
import inspect
import json
import os
import statistics
import subprocess
import sys
import time
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pecs


def command(work: Callable[..., object]) -> None:
    """Calls `work` with the words of the command line. Its keyword-only parameters are options, those before them
    arguments; bool: a flag; list: several words. A result is printed as JSON, with the load of the machine."""
    about = sys.modules[work.__module__].__doc__
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    hints = typing.get_type_hints(work)
    for name, one in inspect.signature(work).parameters.items():
        kind = typing.get_args(hints[name])[0] if isinstance(hints[name], types.UnionType) else hints[name]
        how = {"default": None if one.default is one.empty else one.default}
        if kind is bool:
            how["action"] = "store_true"
        else:
            several = typing.get_origin(kind) is list
            how["type"] = typing.get_args(kind)[0] if several else kind
            if one.kind is not one.KEYWORD_ONLY and one.default is not one.empty:
                how["nargs"] = "*" if several else "?"
            elif several:
                how["nargs"] = "+"
        option = [f"--{name.replace('_', '-')}", *(["-o"] if name == "output" else [])]
        how |= {"required": True} if one.kind is one.KEYWORD_ONLY and one.default is one.empty else {}
        parser.add_argument(*(option if one.kind is one.KEYWORD_ONLY else [name]), **how)
    load = [round(os.getloadavg()[0], 1)]
    found = work(**vars(parser.parse_args()))
    if found is not None:
        print(json.dumps({"load": [*load, round(os.getloadavg()[0], 1)]} | found, indent=1))


@dataclass(frozen=True)
class Run:
    exit: int
    seconds: float
    cpu_s: float  # of all threads and of the processes that it waited for
    errors: str  # standard error


def measured(words: list) -> Run:
    start = time.perf_counter()
    child = subprocess.Popen(list(map(str, words)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    errors = child.stderr.read().decode()
    _, status, usage = os.wait4(child.pid, 0)
    seconds, code = time.perf_counter() - start, os.waitstatus_to_exitcode(status)
    return Run(code, seconds, usage.ru_utime + usage.ru_stime, errors)


def answer(*words: object) -> str:
    """Standard output of a program."""
    return subprocess.run(list(map(str, words)), check=True, capture_output=True, text=True).stdout


def ask(*words: object) -> Any:
    """The answer of `pecs WORDS --json`."""
    return json.loads(answer(pecs.program(), *words, "--json"))


def median_s(work: Callable[[], object], passes: int) -> tuple[float, object]:
    """Median wall time of the passes, and what `work` returned last."""
    seconds, value = [], None
    for _ in range(passes):
        start = time.perf_counter()
        value = work()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), value


def by_pixel(events: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Keys (pixel, polarity) and times of events, sorted by key and time."""
    key = (events["y"].astype(np.int64) * width + events["x"]) * 2 + events["p"]
    order = np.lexsort((events["t"], key))
    return key[order], events["t"][order].astype(float)


def partners(a: np.ndarray, b: np.ndarray, within_us: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers in a and in b of events of one pixel and polarity that are nearest to each other, at most so far away."""
    keys = [(((e["y"].astype(np.int64) * 8192 + e["x"]) * 2 + e["p"]) << 40) + e["t"].astype(np.int64) for e in (a, b)]
    orders = [np.argsort(key, kind="stable") for key in keys]
    ka, kb = (key[order] for key, order in zip(keys, orders, strict=True))

    def nearest(of: np.ndarray, among: np.ndarray) -> np.ndarray:
        right = np.clip(np.searchsorted(among, of), 1, len(among) - 1)
        return right - (of - among[right - 1] <= among[right] - of)

    to_b, to_a = nearest(ka, kb), nearest(kb, ka)
    paired = np.flatnonzero((to_a[to_b] == np.arange(len(ka))) & (np.abs(ka - kb[to_b]) <= within_us))
    return orders[0][paired], orders[1][to_b[paired]]
