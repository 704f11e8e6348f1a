"""The page of a fit, one file: values, what constrains them, and each recording beside the model."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._files import write_text
from .._text import html
from . import disk, statistics
from .disk import DiskEvents
from .estimate import Fitted, Value
from .pixel_map import PixelMap
from .recordings import StepEvents

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 1180px; padding: 0 1em; color: #222; }
table { border-collapse: collapse; margin: 0.5em 0 1.5em; } td, th { padding: 0.2em 0.8em; text-align: left;
border-bottom: 1px solid #ddd; } td.strong { background: #fde4c8; } .kept { color: #777; }
figure { display: inline-block; margin: 0 1em 1em 0; } figcaption { font-size: 13px; color: #555; }
svg { background: #fafafa; } svg text { font-size: 11px; fill: #555; }
"""
DATA, MODEL = "#4477aa", "#ee6622"
LEGEND = f"<p><b style='color:{DATA}'>recording</b>, <b style='color:{MODEL}'>model</b></p>"
WIDTH, HEIGHT, EDGE = 340, 170, 28
LARGE = 3.0  # deviations

Floats = NDArray[np.float64]


def write(found: Fitted, path: Path) -> None:
    """Raises PecsOutputError."""
    parts = [
        f"<h1>{html(path.stem)}: a chip profile fitted to recordings</h1>",
        f"<p>Starting profile: {html(found.chip)}. Recordings: {html(', '.join(Path(f).name for f in found.files))}."
        f" Between recording and model, the root mean square of all differences is {found.misfit:.2f} times the noise "
        "of both (1: they agree).</p>",
        "<h2>Values</h2>",
        _values(found),
        "<h2>Recordings that constrain a value</h2>",
        "<p>Factor by which the 95 % interval grows when a recording is left out.</p>",
        _constraints(found),
        "<h2>Correlations</h2>",
        "<p>Values with a correlation near 1 or -1 are known less well than their combination.</p>",
        _correlations(found),
    ]
    for data, simulated in zip(found.data, found.simulated, strict=True):
        parts.append(f"<h2>{html(data.name)}</h2>")
        if isinstance(data, StepEvents):
            parts += _switches(data, simulated)
        if isinstance(data, DiskEvents):
            parts += _disk(data, simulated)
        parts.append(_statistics(found, data.name))
    if found.pixel_map:
        parts += _pixels(found.pixel_map)
    head = "<!doctype html><html lang='en'><meta charset='utf-8'><title>pecs fit</title>"
    write_text(path, f"{head}<style>{STYLE}</style>" + "\n".join(parts) + "</html>\n")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], kinds: Sequence[str] = ()) -> str:
    lines = ["<tr>" + "".join(f"<th>{h}</th>" for h in head) + "</tr>"]
    for i, row in enumerate(rows):
        kind = f" class='{kinds[i]}'" if kinds and kinds[i] else ""
        lines.append(f"<tr{kind}>" + "".join(c if c.startswith("<td") else f"<td>{c}</td>" for c in row) + "</tr>")
    return "<table>" + "\n".join(lines) + "</table>"


def _values(found: Fitted) -> str:
    of: dict[str, Value] = {**found.values, "corner of the photoreceptor at level 1, Hz": found.corner_hz}
    rows, kinds = [], []
    for key, value in sorted(of.items(), key=lambda item: not item[1].fitted):
        low, high = value.interval
        interval = f"{low:.4g} to {high:.4g}" if value.fitted else f"kept: {html(value.why)}"
        start = f"{value.start:.4g}" if value.start else ""
        rows.append([html(key), f"{value.value:.4g}", interval, start])
        kinds.append("" if value.fitted else "kept")
    return _table(["value", "", "95 % interval", "starting profile"], rows, kinds)


def _constraints(found: Fitted) -> str:
    fitted = {k: v for k, v in found.values.items() if v.fitted and v.without}
    names = [d.name for d in found.data]
    rows = []
    for key, value in fitted.items():
        row = [html(key)]
        for name in names:
            factor = (value.without or {})[name]
            kind = " class='strong'" if factor > 2 else ""
            row.append(f"<td{kind}>{'only this one' if factor > 20 else f'{factor:.1f}'}</td>")
        rows.append(row)
    return _table(["value", *map(html, names)], rows)


def _correlations(found: Fitted) -> str:
    keys = [k for k in found.correlations if k not in found.values or found.values[k].fitted]
    rows = []
    for a in keys:
        row = [html(a)]
        for b in keys:
            value = found.correlations[a][b]
            kind = " class='strong'" if a != b and abs(value) > 0.8 else ""
            row.append(f"<td{kind}>{value:.2f}</td>")
        rows.append(row)
    return _table(["", *map(html, keys)], rows)


def _statistics(found: Fitted, name: str) -> str:
    rows = []
    for c in found.compared:
        if c.recording == name:
            off = (c.simulated - c.measured) / c.deviation
            kind = " class='strong'" if abs(off) > LARGE else ""
            cells = [html(c.switch), html(c.name), f"{c.measured:.4g}", f"{c.simulated:.4g}"]
            rows.append([*cells, f"<td{kind}>{off:+.1f}</td>"])
    return _table(["switch", "statistic", "recording", "model", "difference / noise"], rows)


def _switches(data: StepEvents, simulated: StepEvents) -> list[str]:
    both = zip(statistics.tables(data), statistics.tables(simulated), strict=True)
    parts = [LEGEND]
    for j, (real, model) in enumerate(both):
        switch = f"level {data.levels[j - 1]:g} to {data.levels[j]:g}"
        parts.append(_figure(real.count.mean(1), model.count.mean(1), f"{switch}: events per pixel"))
        if data.ramps_us is not None:
            continue
        parts.append(_figure(_first(real, data.exact), _first(model, data.exact), f"{switch}: first event, us"))
        later = [k for k in range(2, statistics.KEPT_EVENTS + 1) if (real.count >= k).mean() > 0.5]
        lines = [[_median_gap(t, k) * 1e-3 for k in later] for t in (real, model)]
        if later:
            parts.append(_curves(later, lines, f"{switch}: median time of event n behind the first, ms"))
    return parts


def _disk(data: DiskEvents, simulated: disk.DiskStatistics) -> list[str]:
    middles = (data.bins_deg[:-1] + data.bins_deg[1:]) / 2
    both = zip(("ON", "OFF"), disk.per_edge(data), disk.predicted_per_edge(data, simulated), strict=True)
    captions = "events per pixel and edge, by rotation since the edge, deg"
    return [LEGEND, *(_curves(middles, lines, f"{edge}: {captions}") for edge, *lines in both)]


def _pixels(found: PixelMap) -> list[str]:
    x, y, width, height = found.region
    both = found.threshold_on, found.threshold_off
    reach = 3 * max(float(of.std()) for of in both)
    hot = "" if found.hot_pixels is None else f" {len(found.hot_pixels)} pixels of the sensor are hot."
    parts = [
        "<h2>Pixel by pixel</h2>",
        f"<p>Thresholds of {width}x{height} pixels from {x},{y}, relative to the profile's; black {1 - reach:.2f}, "
        f"white {1 + reach:.2f}.{hot}</p>",
    ]
    for name, of in zip(("ON", "OFF"), both, strict=True):
        grey = np.clip(127.5 + 127.5 * (of - 1) / max(reach, 1e-9), 0, 255).astype(np.uint8)
        parts.append(f"<figure>{_picture(grey)}<figcaption>{name} threshold</figcaption></figure>")
    return parts


def _picture(grey: NDArray[np.uint8]) -> str:
    """A PNG of 8 bits, its pixels as squares."""
    height, width = grey.shape
    rows = np.pad(grey, ((0, 0), (1, 0))).tobytes()  # each begins with the number of its filter, 0
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows)),
        (b"IEND", b""),
    )
    png = b"\x89PNG\r\n\x1a\n"
    for kind, data in parts:
        png += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return f"<img width='{WIDTH}' style='image-rendering: pixelated' src='{source}' alt=''>"


def _first(table: statistics.Table, exact: bool) -> Floats:
    first = table.times_us[:, :, 0]
    first = first if exact else first - np.nanmedian(first, axis=0)
    return first[np.isfinite(first)]


def _median_gap(table: statistics.Table, k: int) -> float:
    return float(np.nanmedian(table.times_us[:, :, k - 1] - table.times_us[:, :, 0]))


def _figure(real: Floats, model: Floats, caption: str) -> str:
    """Two histograms over the same bins, each with an area of 1."""
    low, high = np.quantile(np.concatenate([real, model]), (0.005, 0.995))
    edges = np.linspace(low, high + 1e-9 + 1e-9 * abs(high), 26)
    heights = [np.histogram(v, edges)[0] / max(len(v), 1) for v in (real, model)]
    middles = (edges[:-1] + edges[1:]) / 2
    return _curves(middles, heights, caption)


def _curves(x: Sequence[float] | Floats, lines: Sequence[Any], caption: str) -> str:
    top = max(float(np.max(line)) for line in lines) or 1.0
    low, high = float(x[0]), float(x[-1]) if x[-1] > x[0] else float(x[0]) + 1
    drawn = []
    for colour, line in zip((DATA, MODEL), lines, strict=True):
        across = EDGE + (WIDTH - 2 * EDGE) * (np.asarray(x) - low) / (high - low)
        down = HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * np.asarray(line) / top
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, down, strict=True))
        drawn.append(f"<polyline fill='none' stroke='{colour}' stroke-width='1.6' points='{points}'/>")
    labels = (
        f"<text x='{EDGE}' y='{HEIGHT - 8}'>{low:.4g}</text>"
        f"<text x='{WIDTH - EDGE}' y='{HEIGHT - 8}' text-anchor='end'>{high:.4g}</text>"
        f"<text x='{EDGE}' y='16'>{top:.3g}</text>"
    )
    svg = f"<svg width='{WIDTH}' height='{HEIGHT}'>{''.join(drawn)}{labels}</svg>"
    return f"<figure>{svg}<figcaption>{html(caption)}</figcaption></figure>"
