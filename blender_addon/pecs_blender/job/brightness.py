# SPDX-License-Identifier: GPL-3.0-or-later
"""The measurements of probe.py as rows of text. `say` translates a text and inserts values for its {names}."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Say = Callable[..., str]

_LINES = (
    ("lux", "illuminance", "lux", 1.0),
    ("luminance_cd_m2", "luminance", "cd/m²", 1.0),
    ("photocurrent_a", "photocurrent", "pA", 1e12),
    ("corner_hz", "bandwidth", "Hz", 1.0),
)


def _plain(text: str, **values: Any) -> str:
    return text.format(**values)


def light_rows(measured: dict[str, Any], scale: float = 1.0, say: Say = _plain) -> list[tuple[str, str]]:
    """Pairs of name and "MEDIAN UNIT (P5–P95)". scale: factor on the light since the measurement; the bandwidth is
    scaled with it, neglecting the dark current."""
    rows = []
    for name, what, unit, factor in _LINES:
        if spread := measured[name]:
            middle, low, high = (_number(spread[key] * factor * scale) for key in ("median", "p5", "p95"))
            text = "{middle} {unit} ({low}–{high})"
            rows.append((say(what), say(text, middle=middle, unit=unit, low=low, high=high)))
        else:
            missing = "no diffuse surface" if name == "lux" else "the camera has no f-number; set --fnumber"
            rows.append((say(what), say(missing)))
    if measured["noise_thresholds"] is not None:
        noise = say("{noise} of a threshold", noise=_number(measured["noise_thresholds"]))
        rows.append((say("render noise"), noise))
    if measured["events_per_s"] is not None and scale == 1:
        rows.append((say("events"), say("{events} per second", events=_number(measured["events_per_s"]))))
    return rows


def _number(value: float) -> str:
    for least, size, unit in ((1e6, 1e6, "M"), (1e4, 1e3, "k")):
        if value >= least:
            return f"{value / size:.0f}{unit}"
    return f"{value:.0f}" if value >= 1000 else f"{value:.{3 if value >= 1 else 2}g}"


def light_words(measured: dict[str, Any]) -> str:
    return "".join(f"{what:24}  {value}\n" for what, value in light_rows(measured))
