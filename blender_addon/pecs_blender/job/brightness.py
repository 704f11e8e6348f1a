# SPDX-License-Identifier: GPL-3.0-or-later
"""The measurements of probe.py as rows of text."""

from __future__ import annotations

from typing import Any

_LINES = (
    ("lux", "illuminance", "lux", 1.0),
    ("luminance_cd_m2", "luminance", "cd/m²", 1.0),
    ("photocurrent_a", "photocurrent", "pA", 1e12),
    ("corner_hz", "corner", "Hz", 1.0),
)


def light_rows(measured: dict[str, Any], scale: float = 1.0) -> list[tuple[str, str]]:
    """Pairs of name and "MEDIAN UNIT (P5–P95)". scale: factor on the light since the measurement; the corner is
    scaled with it, neglecting the dark current."""
    rows = []
    for name, what, unit, factor in _LINES:
        if spread := measured[name]:
            middle, low, high = (_number(spread[key] * factor * scale) for key in ("median", "p5", "p95"))
            rows.append((what, f"{middle} {unit} ({low}–{high})"))
        else:
            missing = "no diffuse surface" if name == "lux" else "the camera has no f-number; set --fnumber"
            if name == "corner_hz" and measured["photocurrent_a"]:
                missing = "none: the chip follows at once"
            rows.append((what, missing))
    if (noise := measured["noise_thresholds"]) is not None:
        rows.append(("render noise", f"{_number(noise) if noise >= 1e-3 else '< 0.001'} thresholds"))
    if measured["events_per_s"] is not None and scale == 1:
        count = f"{_number(measured['events_per_s'])}/s" if measured["events_per_s"] else "none (without noise)"
        rows.append(("events", f"{count} over {1e3 * measured['events_over_s']:.3g} ms"))
    return rows


def _number(value: float) -> str:
    for least, size, unit in ((1e6, 1e6, "M"), (1e4, 1e3, "k")):
        if value >= least:
            return f"{value / size:.0f}{unit}"
    return f"{value:.0f}" if value >= 1000 else f"{value:.{3 if value >= 1 else 2}g}"


def light_words(measured: dict[str, Any]) -> str:
    return "".join(f"{what:24}  {value}\n" for what, value in light_rows(measured))
