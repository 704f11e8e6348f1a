"""Parameters of trajectories: for every kind a table of name, default, range and unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._config import Fields

REQUIRED = object()


@dataclass(frozen=True)
class Number:
    default: Any
    low: float
    high: float
    unit: str

    def read(self, fields: Fields, key: str) -> float:
        return float(fields.number(key, low=self.low, high=self.high))


@dataclass(frozen=True)
class Count:
    default: int
    low: int
    high: int

    def read(self, fields: Fields, key: str) -> int:
        return fields.integer(key, low=self.low, high=self.high)


@dataclass(frozen=True)
class Numbers:
    """A list of numbers of a shape; -1: any length."""

    default: Any
    shape: tuple[int, ...]
    low: float = -1e6
    high: float = 1e6

    def read(self, fields: Fields, key: str) -> Any:
        array = fields.array(key, *self.shape)
        if not array.size or not ((array >= self.low) & (array <= self.high)).all():
            raise fields.wrong(key, f"numbers from {self.low:g} to {self.high:g}")
        listed = array.tolist()
        return tuple(listed) if array.ndim == 1 else listed


@dataclass(frozen=True)
class Text:
    default: Any
    choices: tuple[str, ...] = ()

    def read(self, fields: Fields, key: str) -> str:
        return fields.text(key, choices=self.choices) if self.choices else str(fields.any(key))


class Speed:
    """One factor, or the factors at the begin and at the end."""

    default = 1.0

    def read(self, fields: Fields, key: str) -> tuple[float, float]:
        if isinstance(fields.any(key), (list, tuple)):
            first, last = fields.numbers(key, count=2, low=1e-3, high=1e3)
            return float(first), float(last)
        factor = float(fields.number(key, low=1e-3, high=1e3))
        return factor, factor


class Pauses:
    """How many to draw, or [[start_s, length_s], …]."""

    default = 0

    def read(self, fields: Fields, key: str) -> Any:
        if not isinstance(value := fields.any(key), (list, tuple)):
            return Count(0, 0, 1000).read(fields, key)
        pauses = [tuple(pause) for pause in Numbers(None, (-1, 2), 0).read(fields, key)] if len(value) else []
        if pauses != sorted(pauses):
            raise fields.wrong(key, "pauses in the order of time")
        return pauses


IDENTITY = np.eye(4).tolist()
COMMON = {
    "duration_s": Number(REQUIRED, 1e-4, 3600, "s"),
    "speed": Speed(),
    "pauses": Pauses(),
    "pause_s": Number(0.1, 0, 3600, "s"),
    "pause_ramp_s": Number(0.05, 1e-4, 60, "s"),
    "clearance_m": Number(0.2, 1e-3, 100, "m"),
    "view_deg": Number(40.0, 1, 170, "deg"),
    "tries": Count(200, 1, 100000),
}
_ROUTE = {"volume": Numbers(None, (2, 3)), "waypoints": Numbers(None, (-1, 3))}
_TARGET = {"target": Numbers(None, (3,))}
_GAZE = {"yaw_deg": Number(None, -360, 360, "deg"), "pitch_deg": Number(0.0, -80, 80, "deg")}
PARAMETERS: dict[str, dict[str, Any]] = {
    "drone": COMMON
    | _ROUTE
    | _TARGET
    | {
        "speed_m_per_s": Number(1.0, 1e-3, 100, "m/s"),
        "step_m": Numbers((0.5, 1.5), (2,), 1e-3),
        "pitch_deg": Number(0.0, -80, 80, "deg"),
        "max_tilt_deg": Number(60.0, 1, 89, "deg"),
        "max_rate_deg_s": Number(360.0, 1, 1e5, "deg/s"),
        "pause_ramp_s": Number(0.4, 1e-4, 60, "s"),
    },
    "hand_held": COMMON
    | _ROUTE
    | _TARGET
    | _GAZE
    | {
        "speed_m_per_s": Number(0.3, 1e-3, 100, "m/s"),
        "step_m": Numbers((0.1, 0.5), (2,), 1e-3),
        "gaze_s": Number(1.0, 1e-3, 100, "s"),
        "wander_deg": Number(5.0, 0, 60, "deg"),
        "shake": Number(1.0, 0, 100, ""),
    },
    "vehicle": COMMON
    | _ROUTE
    | {
        "speed_m_per_s": Number(8.0, 1e-3, 100, "m/s"),
        "step_m": Numbers((2.0, 6.0), (2,), 1e-3),
        "heading_deg": Number(None, -360, 360, "deg"),
        "min_radius_m": Number(5.0, 0.1, 1e4, "m"),
        "pitch_deg": Number(0.0, -80, 80, "deg"),
        "shake": Number(1.0, 0, 100, ""),
    },
    "orbit": COMMON
    | {
        "target": Numbers(REQUIRED, (3,)),
        "radius_m": Number(REQUIRED, 1e-3, 1e4, "m"),
        "height_m": Number(0.0, -1e4, 1e4, "m"),
        "bob_m": Number(0.0, 0, 1e4, "m"),
        "speed_m_per_s": Number(1.0, 1e-3, 1e3, "m/s"),
        "start_deg": Number(None, -360, 360, "deg"),
    },
    "still": COMMON | _TARGET | _GAZE | {"volume": Numbers(None, (2, 3)), "position": Numbers(None, (3,))},
    "recorded": COMMON
    | {
        "file": Text(REQUIRED),
        "format": Text("tum", ("tum", "euroc")),
        "start_s": Number(None, 0, 1e6, "s"),
        "knot_s": Number(None, 1e-3, 100, "s"),
        "world_from_recorded": Numbers(IDENTITY, (4, 4)),
        "body_from_camera": Numbers(IDENTITY, (4, 4)),
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
