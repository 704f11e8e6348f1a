"""Parameters of trajectories: for every kind a table of name, default, range and unit. read() refuses the rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .poses import bad_input

REQUIRED = object()


@dataclass(frozen=True)
class Number:
    default: Any
    low: float
    high: float
    unit: str

    def read(self, place: str, value: Any) -> float:
        return number(place, value, self.low, self.high, self.unit)


@dataclass(frozen=True)
class Count:
    default: int
    low: int
    high: int

    def read(self, place: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            raise bad_input(f"{place}: got {value!r}, wanted a whole number from {self.low} to {self.high}")
        return value


@dataclass(frozen=True)
class Numbers:
    """A list of numbers of a shape; -1: any length."""

    default: Any
    shape: tuple[int, ...]
    low: float = -1e6
    high: float = 1e6

    def read(self, place: str, value: Any):
        try:
            array = np.array(value, float)
        except (TypeError, ValueError):
            array = np.zeros(0)
        fits = array.ndim == len(self.shape) and all(w in (-1, n) for n, w in zip(array.shape, self.shape, strict=True))
        if not fits or not array.size or not ((array >= self.low) & (array <= self.high)).all():
            shape = " x ".join("n" if n < 0 else str(n) for n in self.shape)
            raise bad_input(f"{place}: got {value!r}, wanted {shape} numbers from {self.low:g} to {self.high:g}")
        listed = array.tolist()
        return tuple(listed) if array.ndim == 1 else listed


@dataclass(frozen=True)
class Text:
    default: Any
    choices: tuple[str, ...] = ()

    def read(self, place: str, value: Any) -> str:
        text = str(value)
        if not text or self.choices and text not in self.choices:
            raise bad_input(f"{place}: got {text!r}, wanted {' or '.join(self.choices) or 'some text'}")
        return text


class Speed:
    """One factor, or two: from, to."""

    default = 1.0

    def read(self, place: str, value: Any) -> tuple[float, float]:
        pair = value if isinstance(value, (list, tuple)) else (value, value)
        if len(pair) != 2:
            raise bad_input(f"{place}: got {value!r}, wanted a number or two")
        first, last = (number(place, v, 1e-3, 1e3, "") for v in pair)
        return first, last


class Pauses:
    """How many to draw, or [[start_s, length_s], …]."""

    default = 0

    def read(self, place: str, value: Any):
        if not isinstance(value, (list, tuple)):
            return Count(0, 0, 1000).read(place, value)
        pauses = [Numbers(None, (2,), 0).read(place, pause) for pause in value]
        if pauses != sorted(pauses):
            raise bad_input(f"{place}: got {value!r}, wanted them in order")
        return pauses


def number(place: str, value: Any, low: float, high: float, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:  # nor NaN
        raise bad_input(f"{place}: got {value!r}, wanted a number from {low:g} to {high:g} {unit}".rstrip())
    return float(value)


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
    """The values of a kind's parameters, defaults filled in; None where a default is drawn or absent."""
    table = PARAMETERS[kind]
    for key in given:
        if key not in table:
            raise bad_input(f"{kind}: got an unknown parameter {key!r}, wanted one of {', '.join(table)}")
    values = {}
    for key, entry in table.items():
        value = given.get(key, entry.default)
        if value is REQUIRED:
            raise bad_input(f"{kind}: got no {key}, wanted it")
        values[key] = None if value is None else entry.read(f"{kind}: {key}", value)
    for key in ("volume", "step_m"):
        pair = values.get(key)
        if pair is not None and (np.array(pair[0]) > np.array(pair[1])).any():
            raise bad_input(f"{kind}: {key}: got {pair}, wanted the lower end first")
    for key in ("world_from_recorded", "body_from_camera"):
        if key in values and not _rigid(np.array(values[key])):
            raise bad_input(f"{kind}: {key}: got {values[key]}, wanted a rotation and a translation")
    return values


def _rigid(m: np.ndarray) -> bool:
    turn = m[:3, :3]
    near = np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and math.isclose(np.linalg.det(turn), 1, abs_tol=1e-6)
    return near and np.allclose(m[3], [0, 0, 0, 1])
