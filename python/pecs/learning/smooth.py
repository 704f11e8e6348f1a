"""Pictures from the events before and after them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from itertools import islice, repeat
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .windows import Window

WINDOW_US = 40_000.0  # of the network, whatever the time between pictures: its pictures have less noise
BLOCK_US, AHEAD_US = 2e6, 1e6  # pictures that are made together; events after them that they use
MOST_BYTES = 512 << 20  # of the pictures of a block
MOST_STATES = 16  # of the network at once

Picture = NDArray[np.floating[Any]]


class Recurrent(Protocol):
    """A network whose state a copy continues. size: height and width."""

    size: tuple[int, int]

    def __call__(self, window: Window) -> Picture: ...


def smooth(network: Recurrent, windows: Iterator[Window], length_us: float) -> Iterator[Picture]:
    """Pictures at the ends of consecutive windows: means of those of the network, and of those of the network on events
    backward in time, over a block and what is ahead of it. States take turns in windows that overlap, and pictures of
    all turns are averaged."""
    several = min(max(1, round(WINDOW_US / length_us)), MOST_STATES)  # windows that make one; so many states take turns
    height, width = network.size
    count = min(math.ceil(BLOCK_US / length_us), max(1, MOST_BYTES // (4 * height * width)))
    return _steady(_both_ways(network, windows, length_us, several, count), several)


def _both_ways(
    network: Recurrent, windows: Iterator[Window], length_us: float, several: int, count: int
) -> Iterator[Picture]:
    """count: pictures of a block."""
    span_us, ahead = several * length_us, max(several, min(math.ceil(AHEAD_US / length_us), count // 2))
    forward, number = [copy(network) for _ in range(several)], 0
    before: list[Window] = []
    known = list(islice(windows, count + ahead))
    while known:
        shown: list[Picture] = []
        for window in known[:count]:
            before = [*before, window][-several:]
            begin_us = min(window.end_us - span_us, before[0].begin_us)  # equal, except for rounding
            joined = replace(window, begin_us=begin_us, events=_events(before))
            shown.append(forward[number % several](joined).astype(np.float32))
            number += 1
        backward = [copy(network) for _ in range(several)]
        for k in range(len(known) - 2, -1, -1):
            begin_us, events = known[k].end_us, _events(known[k + 1 : k + 1 + several])
            joined = replace(known[k], begin_us=begin_us, end_us=begin_us + span_us, events=events)
            picture = backward[k % several](_backward(joined))
            if k < len(shown):
                shown[k] = _mean(shown[k], picture)
        yield from shown
        known = known[count:] + list(islice(windows, count))


def _steady(pictures: Iterable[Picture], several: int) -> Iterator[Picture]:
    """Means over `several` pictures, with each in the middle: those of one state alone would differ from the next."""
    weights = np.full(several + 1 - several % 2, 1 / several)
    if several % 2 == 0:
        weights[[0, -1]] /= 2
    after = len(weights) // 2
    near: deque[Picture] = deque(maxlen=len(weights))

    def next_to(picture: Picture) -> Iterator[Picture]:
        near.append(picture)
        if len(near) == len(weights):
            yield np.tensordot(weights, np.stack(near), 1)

    for picture in pictures:
        if not near:
            near.extend(repeat(picture, after))
        yield from next_to(picture)
    if near:
        for picture in repeat(near[-1], after):
            yield from next_to(picture)


def _events(windows: Sequence[Window]) -> NDArray[np.void]:
    return np.concatenate([window.events for window in windows])


def _backward(window: Window) -> Window:
    """As if time ran backward: what became brighter becomes darker."""
    events = window.events[::-1].copy()
    events["t"] = math.ceil(window.begin_us) + math.ceil(window.end_us) - 1 - events["t"]
    events["p"] = 1 - events["p"]
    return replace(window, events=events)


def _mean(one: Picture, other: Picture) -> Picture:
    """Weighted by their variances: the network shows grey where it knows little."""
    weights = np.maximum([one.var(), other.var()], 1e-12)
    return ((weights[0] * one + weights[1] * other) / weights.sum()).astype(np.float32)
