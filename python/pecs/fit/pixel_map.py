"""Thresholds and hot pixels pixel by pixel (docs/reference/sensor.md#pixel-map).

A pixel whose thresholds are higher has fewer events behind each switch. The relation is taken from the sensor: pixels
of known thresholds before the same switches, with the fitted values. A pixel's numbers of events, averaged over cycles,
give its thresholds; of what they say, as much is kept as the numbers are more certain than the spread of all pixels."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._files import write_json
from . import hot as hot_pixels
from . import profile, statistics
from .model import COLUMNS, Model
from .recordings import Still, Switches, load_still, occupied

LIMITS = 0.1, 10.0  # of a map
LEAST_NUMBER = 0.02  # standard deviation of a number of events behind a switch, averaged over cycles

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PixelMap:
    """Values measured pixel by pixel.

    Attributes
    ----------
    region : (x, y, width, height)
        Pixels of the thresholds.
    threshold_on, threshold_off : numpy.ndarray
        Thresholds [height, width], relative to the profile's; 1 for hot pixels.
    deviation : (float, float)
        Standard deviation of what is not known of them, ON and OFF.
    hot_pixels : list of (int, int, float), optional
        Column, row and rate [Hz] of the hot pixels; None without a recording of still light.
    """

    region: tuple[int, int, int, int]
    threshold_on: Floats
    threshold_off: Floats
    deviation: tuple[float, float]
    hot_pixels: list[tuple[int, int, float]] | None


def write(found: PixelMap, path: Path, source: str) -> None:
    """Raises PecsOutputError."""
    out: dict[str, Any] = {"pecs_pixel_map": 1, "source": source, "region": found.region}
    for key in ("threshold_on", "threshold_off"):
        out[key] = np.round(getattr(found, key).ravel(), 4).tolist()
    if found.hot_pixels is not None:
        out["hot_pixels"] = found.hot_pixels
    write_json(path, out)


def measure(
    data: Switches, hot: NDArray[np.bool_] | None, stills: Sequence[Still], model: Model, values: Mapping[str, float],
    light_a: float,
) -> PixelMap:  # fmt: skip
    """data: without the hot pixels; hot: those of its region. values: the fitted profile's."""
    known = _simulated(data, model, values, light_a)
    place = data.place
    assert place
    rows = np.ones((2, place[2] * place[3]))
    cold = slice(None) if hot is None else ~hot
    deviations = []
    for row, up, of in zip(rows, (True, False), known, strict=True):
        row[cold], deviation = _relative(data, up, *of, values["threshold_mismatch"])
        deviations.append(deviation)
    on, off = rows.reshape(2, place[3], place[2])
    return PixelMap(place, on, off, (deviations[0], deviations[1]), _hot(stills))


def _simulated(
    data: Switches, model: Model, values: Mapping[str, float], light_a: float
) -> list[tuple[Floats, list[statistics.Table]]]:
    """ON and OFF: relative thresholds of simulated pixels, and their events behind each switch."""
    pixels = model.pixels if data.ramps_us is None else model.pixels // 2
    normal = [NormalDist().inv_cdf((i + 0.5) / pixels) for i in range(pixels)]
    row = np.clip(1 + values["threshold_mismatch"] * np.array(normal), *LIMITS)
    random = np.random.default_rng(1)
    relative = [random.permutation(row) for _ in range(2)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pixels.json"
        region = 0, 0, COLUMNS, pixels // COLUMNS
        write(PixelMap(region, *relative, (0, 0), None), file, "pixels of a simulation")
        chip = Path(folder) / "chip.json"
        write_json(chip, profile.read(str(model.chip)) | {"pixel_map": file.name})
        events = replace(model, chip=chip, _known={}).switches(data, light_a, values)
    tables = statistics.tables(events)
    return [(of, tables) for of in relative]


def _relative(
    data: Switches, up: bool, known: Floats, tables: list[statistics.Table], mismatch: float
) -> tuple[Floats, float]:
    """Relative thresholds of the recording's pixels, and the standard deviation of their error. The inverse of a
    threshold is linear in the number of events: number = offset + slope / threshold."""
    rises = np.array(data.levels) > np.roll(data.levels, 1)
    sums, weights = np.zeros(data.pixels), 0.0
    for table, simulated, rise in zip(statistics.tables(data), tables, rises, strict=True):
        number = simulated.count.mean(axis=1)
        slope, offset = np.polyfit(1 / known, number, 1)
        if rise != up or slope <= 0:
            continue
        error = float(np.std(number - offset - slope / known))
        weight = (slope / max(error, LEAST_NUMBER)) ** 2
        sums += weight * (table.count.mean(axis=1) - offset) / slope
        weights += weight
    if not weights:
        return np.ones(data.pixels), mismatch
    variance = 1 / weights
    kept = mismatch**2 / (mismatch**2 + variance)
    inverse = 1 + kept * (sums / weights - 1)
    return np.clip(1 / np.maximum(inverse, 1e-3), *LIMITS), float(np.sqrt(kept * variance))


def _hot(stills: Sequence[Still]) -> list[tuple[int, int, float]] | None:
    """Hot pixels in the darkest recording, of all pixels that have events."""
    if not stills:
        return None
    of = min(stills, key=lambda s: s.level)
    x, y, width, _ = region = occupied(of.file)
    found = hot_pixels.find([load_still(of, region)])
    assert found
    hot, quiet = found
    rates = quiet.on[hot] / quiet.seconds - quiet.on[~hot].mean() / quiet.seconds
    return [
        (x + int(i) % width, y + int(i) // width, round(float(hz), 4))
        for i, hz in zip(np.flatnonzero(hot), rates, strict=True)
    ]
