"""The page of a fit, one file: values, what constrains them, and each recording with the model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._pages import Node, figure, image, plot, row, table, write_page
from .._text import counted
from . import disk, statistics
from .davis import Moving
from .davis_still import StillProblem, StillStatistics
from .disk import DiskEvents
from .estimate import Fitted, Value
from .pixel_map import PixelMap
from .recordings import StepEvents

LARGE = 3.0  # deviations
WIDTH = 340  # pixels of a picture

Floats = NDArray[np.float64]


def write(found: Fitted, path: Path) -> None:
    """Raises PecsOutputError."""
    files = ", ".join(Path(f).name for f in found.files)
    misfit = "No still light was compared with the model."
    if found.misfit is not None:
        misfit = (
            "Between recording and model, the root mean square of all differences is "
            f"{found.misfit:.2f} times the noise of both (1: they agree)."
        )
    body: list[Node] = [
        ["h1", f"{path.stem}: a chip profile fitted to recordings"],
        ["p", f"Starting profile: {found.chip}. Recordings: {files}. {misfit}"],
        ["h2", "Values"],
        _values(found),
    ]
    if any(value.without for value in found.values.values()):
        body += [
            ["h2", "Recordings that constrain a value"],
            ["p", "Factor by which the 95 % interval grows when a recording is left out."],
            _constraints(found),
        ]
    if found.correlations:
        body += [
            ["h2", "Correlations"],
            ["p", "Values with a correlation near 1 or -1 are known less well than their combination."],
            _correlations(found),
        ]
    for file, moving in found.moving.items():
        body += _moving(Path(file).name, moving)
    for data, simulated in zip(found.data, found.simulated, strict=True):
        body.append(["h2", data.name])
        if isinstance(data, StepEvents):
            body.append(row(_switches(data, simulated)))
        if isinstance(data, DiskEvents):
            body.append(row(_disk(data, simulated)))
        if isinstance(data, StillProblem):
            body += _still_windows(data, simulated)
        body.append(_statistics(found, data.name))
    if found.pixel_map:
        body += _pixels(found.pixel_map)
    write_page(path, "pecs fit", body)


def _marked(value: str, is_strong: bool) -> Any:
    return ["td", {"class": "strong"}, value] if is_strong else value


def _values(found: Fitted) -> Node:
    corner = {"corner of the photoreceptor at level 1, Hz": found.corner_hz} if found.corner_hz.value else {}
    of: dict[str, Value] = {**found.values, **corner}
    rows = []
    for key, value in sorted(of.items(), key=lambda item: not item[1].fitted):
        low, high = value.interval
        interval = f"{low:.4g} to {high:.4g}" if value.fitted else f"kept: {value.why}"
        start = "" if key in corner else f"{value.start:.4g}"
        cells = [key, f"{value.value:.4g}", interval, start]
        rows.append(cells if value.fitted else [["td", {"class": "note"}, cell] for cell in cells])
    return table(rows, ["value", "", "95 % interval", "starting profile"])


def _constraints(found: Fitted) -> Node:
    names = [d.name for d in found.data]
    rows = []
    for key, value in found.values.items():
        if value.fitted and value.without:
            factors = [value.without[name] for name in names]
            cells = (_marked("only this one" if f > 20 else f"{f:.1f}", f > 2) for f in factors)
            rows.append([key, *cells])
    return table(rows, ["value", *names])


def _correlations(found: Fitted) -> Node:
    keys = [k for k in found.correlations if k not in found.values or found.values[k].fitted]
    rows = []
    for a in keys:
        values = ((b, found.correlations[a][b]) for b in keys)
        rows.append([a, *(_marked(f"{value:.2f}", a != b and abs(value) > 0.8) for b, value in values)])
    return table(rows, ["", *keys])


def _statistics(found: Fitted, name: str) -> Node:
    rows = []
    for c in found.compared:
        if c.recording == name:
            off = (c.simulated - c.measured) / c.deviation
            rows.append([c.switch, c.name, c.measured, c.simulated, _marked(f"{off:+.1f}", abs(off) > LARGE)])
    return table(rows, ["switch", "statistic", "recording", "model", "difference / noise"])


def _switches(data: StepEvents, simulated: StepEvents) -> list[Node]:
    both = zip(statistics.tables(data), statistics.tables(simulated), strict=True)
    plots = []
    for j, (real, model) in enumerate(both):
        switch = f"level {data.levels[j - 1]:g} to {data.levels[j]:g}"
        plots.append(_histograms(real.count.mean(1), model.count.mean(1), "events per pixel", switch))
        if data.ramps_us is not None:
            continue
        first = _first(real, data.exact), _first(model, data.exact)
        plots.append(_histograms(*first, "time of the first event (us)", switch))
        later = [k for k in range(2, statistics.KEPT_EVENTS + 1) if (real.count >= k).mean() > 0.5]
        lines = [[_median_gap(t, k) * 1e-3 for k in later] for t in (real, model)]
        if later:
            labels = "event number", "median time behind the first (ms)"
            plots.append(_both(later, lines, labels, switch))
    return plots


def _disk(data: DiskEvents, simulated: disk.DiskStatistics) -> list[Node]:
    middles = (data.bins_deg[:-1] + data.bins_deg[1:]) / 2
    both = zip(("ON", "OFF"), disk.per_edge(data), disk.predicted_per_edge(data, simulated), strict=True)
    labels = "rotation since the edge (deg)", "events per pixel and edge"
    return [_both(middles, lines, labels, edge) for edge, *lines in both]


def _moving(name: str, of: Moving) -> list[Node]:
    said = (
        f"Change of ln light of {of.pairs} pairs of frames and of the events between them: correlation "
        f"{of.correlation:.2f}. Value of frames without light: {255 * of.black:.1f} of 255."
    )
    events, frames = of.mean_changes
    lines = [figure(plot(events, {"frames": frames, "equal": events}, ("events (ln)", "frames (ln)")), "changes")]
    return [["h2", f"{name}: moving frames"], ["p", said], row(lines)]


def _still_windows(data: StillProblem, simulated: StillStatistics) -> list[Node]:
    """Frame clock and rank curve of the compared pixels, without hot ones."""
    number, edges = len(data.windows), np.arange(0, data.of.period_us + 500, 500.0)
    plots = []
    for name, is_on in (("ON", True), ("OFF", False)):
        both = (of.phase_us[of.on == is_on] % data.of.period_us for of in (data.recorded, simulated))
        rates = [np.histogram(t_us, edges)[0] * 2 / number for t_us in both]
        label = "ms since the begin of an exposure", "events per ms"
        plots.append(_both(edges[:-1] / 1000, rates, label, f"{name} events"))
    share = np.linspace(0.5, 0.999, 60)
    ranks = []
    for of in (data.recorded, simulated):
        kept = ~data.hot[of.pixel]
        counts = np.bincount(of.pixel[kept], minlength=len(data.light))[~data.hot]
        ranks.append(np.quantile(counts, share) / (1e-6 * number * data.of.period_us))
    plots.append(_both(100 * share, ranks, ("% of the pixels", "Hz"), "pixels by their rate"))
    lamp = f" A lamp flickers at {data.lamp_hz:.1f} Hz." if data.lamp_hz else ""
    pixels = f"{counted(number, 'still window')}, {len(data.light)} pixels"
    said = f"{pixels}; numbers of events are logarithms.{lamp}"
    return [["p", said], row(plots)]


def _pixels(found: PixelMap) -> list[Node]:
    x, y, width, height = found.region
    both = found.threshold_on, found.threshold_off
    reach = 3 * max(float(of.std()) for of in both)
    hot = "" if found.hot_pixels is None else f" {len(found.hot_pixels)} pixels of the sensor are hot."
    said = f"Thresholds of {width}x{height} pixels from {x},{y}, relative to the profile's; black {1 - reach:.2f}, "
    maps = []
    for name, of in zip(("ON", "OFF"), both, strict=True):
        grey = np.clip(127.5 + 127.5 * (of - 1) / max(reach, 1e-9), 0, 255).astype(np.uint8)
        maps.append(figure(image(grey, WIDTH), f"{name} threshold"))
    return [["h2", "Pixel by pixel"], ["p", f"{said}white {1 + reach:.2f}.{hot}"], row(maps)]


def _first(table: statistics.Table, exact: bool) -> Floats:
    first = table.times_us[:, :, 0]
    first = first if exact else first - np.nanmedian(first, axis=0)
    return first[np.isfinite(first)]


def _median_gap(table: statistics.Table, k: int) -> float:
    return float(np.nanmedian(table.times_us[:, :, k - 1] - table.times_us[:, :, 0]))


def _histograms(real: Floats, model: Floats, label: str, caption: str) -> Node:
    """Two histograms over the same bins, each with an area of 1."""
    low, high = np.quantile(np.concatenate([real, model]), (0.005, 0.995))
    edges = np.linspace(low, high + 1e-9 + 1e-9 * abs(high), 26)
    shares = [np.histogram(v, edges)[0] / max(len(v), 1) for v in (real, model)]
    return _both((edges[:-1] + edges[1:]) / 2, shares, (label, "share"), caption)


def _both(x: Sequence[float] | Floats, lines: Sequence[Any], labels: tuple[str, str], caption: str) -> Node:
    return figure(plot(x, dict(zip(("recording", "model"), lines, strict=True)), labels), caption)
