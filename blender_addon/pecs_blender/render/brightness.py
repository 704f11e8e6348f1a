# SPDX-License-Identifier: GPL-3.0-or-later
"""The measurements of probe.py as rows of text. `say` translates a text and inserts values for its {names}."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Say = Callable[..., str]

_LINES = (
    ("lux", "illuminance in view", "lux", 1.0),
    ("luminance_cd_m2", "luminance", "cd/m2", 1.0),
    ("photocurrent_a", "photocurrent", "pA", 1e12),
    ("corner_hz", "photoreceptor bandwidth", "Hz", 1.0),
)


def _plain(text: str, **values: Any) -> str:
    return text.format(**values)


def light_rows(found: dict[str, Any], scale: float = 1.0, say: Say = _plain) -> list[tuple[str, str]]:
    """Pairs of name and "MEDIAN UNIT (P5 to P95)". scale: factor on the light since the measurement; the bandwidth is
    scaled with it, neglecting the dark current."""
    rows = []
    for name, what, unit, factor in _LINES:
        if spread := found[name]:
            middle, low, high = (_number(spread[key] * factor * scale) for key in ("median", "p5", "p95"))
            text = "{middle} {unit} ({low} to {high})"
            rows.append((say(what), say(text, middle=middle, unit=unit, low=low, high=high)))
        else:
            missing = "no diffuse surface in view" if name == "lux" else "the camera has no f-number; set --fnumber"
            rows.append((say(what), say(missing)))
    if found["noise_thresholds"] is not None:
        text = "{noise} contrast thresholds with {samples} samples"
        noise = say(text, noise=_number(found["noise_thresholds"]), samples=found["samples"])
        rows.append((say("render noise"), noise))
    if found["events_per_s"] is not None and scale == 1:
        rate = say("{events} per second, without noise", events=_number(found["events_per_s"]))
        rows.append((say("expected events"), rate))
    return rows


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def light_words(found: dict[str, Any]) -> str:
    return "".join(f"{what:24}  {value}\n" for what, value in light_rows(found))
