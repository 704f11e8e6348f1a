"""Parameters of trajectories: for every kind a table of name, default and range; names end with the unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._config import Fields

REQUIRED = object()


@dataclass(frozen=True)
class Parameter:
    """read(fields, key): the value, checked."""

    default: Any
    read: Callable[[Fields, str], Any]


def _number(default: Any, low: float, high: float) -> Parameter:
    return Parameter(default, lambda fields, key: float(fields.number(key, low=low, high=high)))


def _numbers(default: Any, *shape: int, low: float = -1e6, high: float = 1e6) -> Parameter:
    """A list of numbers of a shape; -1: any length."""

    def read(fields: Fields, key: str) -> Any:
        array = fields.array(key, *shape)
        if not array.size or not ((array >= low) & (array <= high)).all():
            raise fields.wrong(key, f"numbers from {low:g} to {high:g}")
        listed = array.tolist()
        return tuple(listed) if array.ndim == 1 else listed

    return Parameter(default, read)


def _speed(fields: Fields, key: str) -> tuple[float, float]:
    """One factor, or the factors at the start and at the end."""
    if isinstance(fields.any(key), (list, tuple)):
        first, last = fields.numbers(key, count=2, low=1e-3, high=1e3)
        return float(first), float(last)
    factor = float(fields.number(key, low=1e-3, high=1e3))
    return factor, factor


def _pauses(fields: Fields, key: str) -> Any:
    """A number of pauses to draw, or [[start_s, length_s], …]."""
    if not isinstance(value := fields.any(key), (list, tuple)):
        return fields.integer(key, low=0, high=1000)
    pauses = [tuple(pause) for pause in _numbers(None, -1, 2, low=0).read(fields, key)] if len(value) else []
    if pauses != sorted(pauses):
        raise fields.wrong(key, "pauses in the order of time")
    return pauses


IDENTITY = np.eye(4).tolist()
COMMON = {
    "duration_s": _number(REQUIRED, 1e-4, 3600),
    "speed": Parameter(1.0, _speed),
    "pauses": Parameter(0, _pauses),
    "pause_s": _number(0.1, 0, 3600),
    "pause_ramp_s": _number(0.05, 1e-4, 60),
    "clearance_m": _number(0.2, 1e-3, 100),
    "view_deg": _number(40.0, 1, 170),
    "max_speed_m_per_s": _number(None, 1e-3, 1e4),
    "tries": Parameter(200, lambda fields, key: fields.integer(key, low=1, high=100000)),
}
_ROUTE = {"volume": _numbers(None, 2, 3), "waypoints": _numbers(None, -1, 3)}
_TARGET = {"target": _numbers(None, 3)}
_GAZE = {"yaw_deg": _number(None, -360, 360), "pitch_deg": _number(0.0, -80, 80)}
PARAMETERS: dict[str, dict[str, Any]] = {
    "drone": {
        **COMMON,
        **_ROUTE,
        **_TARGET,
        "speed_m_per_s": _number(1.0, 1e-3, 100),
        "step_m": _numbers((0.5, 1.5), 2, low=1e-3),
        "pitch_deg": _number(0.0, -80, 80),
        "max_tilt_deg": _number(60.0, 1, 89),
        "max_rate_deg_s": _number(360.0, 1, 1e5),
        "pause_ramp_s": _number(0.4, 1e-4, 60),
    },
    "hand_held": {
        **COMMON,
        **_ROUTE,
        **_TARGET,
        **_GAZE,
        "speed_m_per_s": _number(0.3, 1e-3, 100),
        "step_m": _numbers((0.1, 0.5), 2, low=1e-3),
        "gaze_s": _number(1.0, 1e-3, 100),
        "wander_deg": _number(5.0, 0, 60),
        "shake": _number(1.0, 0, 100),
    },
    "vehicle": {
        **COMMON,
        **_ROUTE,
        "speed_m_per_s": _number(8.0, 1e-3, 100),
        "step_m": _numbers((2.0, 6.0), 2, low=1e-3),
        "heading_deg": _number(None, -360, 360),
        "min_radius_m": _number(5.0, 0.1, 1e4),
        "pitch_deg": _number(0.0, -80, 80),
        "shake": _number(1.0, 0, 100),
    },
    "orbit": {
        **COMMON,
        "target": _numbers(REQUIRED, 3),
        "radius_m": _number(REQUIRED, 1e-3, 1e4),
        "height_m": _number(0.0, -1e4, 1e4),
        "bob_m": _number(0.0, 0, 1e4),
        "speed_m_per_s": _number(1.0, 1e-3, 1e3),
        "start_deg": _number(None, -360, 360),
    },
    "still": {**COMMON, **_TARGET, **_GAZE, "volume": _numbers(None, 2, 3), "position": _numbers(None, 3)},
    "recorded": {
        **COMMON,
        "file": Parameter(REQUIRED, lambda fields, key: str(fields.any(key))),
        "format": Parameter("tum", lambda fields, key: fields.text(key, choices=("tum", "euroc"))),
        "start_s": _number(None, 0, 1e6),
        "knot_s": _number(None, 1e-3, 100),
        "world_from_recorded": _numbers(IDENTITY, 4, 4),
        "body_from_camera": _numbers(IDENTITY, 4, 4),
    },
}


def read(kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a kind's parameters with defaults filled in; None where a default is drawn or absent. Raises
    PecsInputError for an unknown parameter and for a wrong value."""
    fields = Fields(dict(given), kind)
    values: dict[str, Any] = {}
    for key, entry in PARAMETERS[kind].items():
        if fields.has(key) or entry.default is REQUIRED:
            values[key] = entry.read(fields, key)
        else:
            values[key] = None if entry.default is None else entry.read(Fields({key: entry.default}, kind), key)
    fields.done()
    for key in ("volume", "step_m"):
        pair = values.get(key)
        if pair is not None and (np.array(pair[0]) > np.array(pair[1])).any():
            raise fields.wrong(key, "the lower end first")
    for key in ("world_from_recorded", "body_from_camera"):
        if key in values and not _rigid(np.array(values[key])):
            raise fields.wrong(key, "a rotation and a translation")
    return values


def _rigid(m: np.ndarray) -> bool:
    turn = m[:3, :3]
    near = np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and math.isclose(np.linalg.det(turn), 1, abs_tol=1e-6)
    return near and np.allclose(m[3], [0, 0, 0, 1])
