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
from .recordings import StepEvents, Still, load_still_everywhere

LIMITS = 0.1, 10.0  # of a map
LEAST_NUMBER = 0.02  # standard deviation of a number of events behind a switch, averaged over cycles

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PixelMap:
    """Values measured pixel by pixel: in `region` (x, y, width, height), thresholds [height, width] relative to the
    profile's (1 for hot pixels), with the standard `deviation` (ON, OFF) of what is not known of them; `hot_pixels` as
    (column, row, rate [Hz]), None without a recording of still light."""

    region: tuple[int, int, int, int]
    threshold_on: Floats
    threshold_off: Floats
    deviation: tuple[float, float]
    hot_pixels: list[tuple[int, int, float]] | None

    def write(self, path: Path, source: str) -> None:
        """Raises PecsOutputError."""
        out: dict[str, Any] = {"pecs_pixel_map": 1, "source": source, "region": self.region}
        for key in ("threshold_on", "threshold_off"):
            out[key] = [round(v, 4) for v in getattr(self, key).ravel().tolist()]
        if self.hot_pixels is not None:
            out["hot_pixels"] = self.hot_pixels
        write_json(path, out)


def measure(
    data: StepEvents, hot: NDArray[np.bool_] | None, stills: Sequence[Still], model: Model, values: Mapping[str, float],
    light_a: float,
) -> PixelMap:  # fmt: skip
    """data: without the hot pixels; hot: those of its region. values: the fitted profile's."""
    place = data.place
    assert place
    relative, simulated = _simulated(data, model, values, light_a)
    recorded, mismatch = statistics.tables(data), values["threshold_mismatch"]
    rises = np.array(data.levels) > np.roll(data.levels, 1)
    rows, deviations = np.ones((2, place[2] * place[3])), []
    cold = slice(None) if hot is None else ~hot
    for row, up, known in zip(rows, (True, False), relative, strict=True):
        switches = [both for both, rise in zip(zip(recorded, simulated, strict=True), rises, strict=True) if rise == up]
        row[cold], deviation = _relative(switches, known, mismatch)
        deviations.append(deviation)
    on, off = rows.reshape(2, place[3], place[2])
    return PixelMap(place, on, off, (deviations[0], deviations[1]), _hot(stills))


def _simulated(
    data: StepEvents, model: Model, values: Mapping[str, float], light_a: float
) -> tuple[list[Floats], list[statistics.Table]]:
    """Relative thresholds of simulated pixels, ON and OFF, and their events behind each switch."""
    pixels = model.pixels if data.ramps_us is None else model.pixels // 2
    normal = [NormalDist().inv_cdf((i + 0.5) / pixels) for i in range(pixels)]
    row = np.clip(1 + values["threshold_mismatch"] * np.array(normal), *LIMITS)
    random = np.random.default_rng(1)
    relative = [random.permutation(row) for _ in range(2)]
    with tempfile.TemporaryDirectory() as folder:
        file, chip = Path(folder) / "pixels.json", Path(folder) / "chip.json"
        known = PixelMap((0, 0, COLUMNS, pixels // COLUMNS), *relative, (0, 0), None)
        known.write(file, "pixels of a simulation")
        write_json(chip, profile.read(str(model.chip)) | {"pixel_map": file.name})
        events = replace(model, chip=chip, _known={}).switches(data, light_a, values)
    return relative, statistics.tables(events)


def _relative(
    switches: Sequence[tuple[statistics.Table, statistics.Table]], known: Floats, mismatch: float
) -> tuple[Floats, float]:
    """Relative thresholds of the recording's pixels, and the standard deviation of their error, from switches of one
    direction, recorded and simulated. The inverse of a threshold is linear in the number of events:
    number = offset + slope / threshold."""
    pixels = len(switches[0][0].count)
    sums, weights = np.zeros(pixels), 0.0
    for recorded, simulated in switches:
        number = simulated.count.mean(axis=1)
        slope, offset = np.polyfit(1 / known, number, 1)
        if slope > 0:
            error = float(np.std(number - offset - slope / known))
            weight = (slope / max(error, LEAST_NUMBER)) ** 2
            sums += weight * (recorded.count.mean(axis=1) - offset) / slope
            weights += weight
    if not weights:
        return np.ones(pixels), mismatch
    variance = 1 / weights
    kept = mismatch**2 / (mismatch**2 + variance)
    inverse = 1 + kept * (sums / weights - 1)
    return np.clip(1 / np.maximum(inverse, 1e-3), *LIMITS), float(np.sqrt(kept * variance))


def _hot(stills: Sequence[Still]) -> list[tuple[int, int, float]] | None:
    """Hot pixels in the darkest recording, of all pixels that have events."""
    if not stills:
        return None
    still, (x, y, width, _) = load_still_everywhere(min(stills, key=lambda s: s.level))
    found = hot_pixels.find([still])
    assert found
    numbers = np.flatnonzero(found[0]).tolist()
    rates = hot_pixels.rates_hz(*found).tolist()
    return [(x + i % width, y + i // width, round(hz, 4)) for i, hz in zip(numbers, rates, strict=True)]
