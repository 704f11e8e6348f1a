"""Sequences for training that need no renderer: textures, text and shapes in layers that move smoothly, simulated.

Sequence `number` of a seed is the same in every run, whatever is drawn beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..chip import Chip
from ..sensor import simulate
from .clips import eight_bit
from .limits import ProceduralConfig

CHIP = "davis346"
TEXTURE_PX = 320  # side of a layer's texture
MOTION_HZ, SHAKE_HZ = (0.4, 1.1, 2.9, 6.0), (1.3, 2.3, 3.7, 6.0, 9.1)
LETTERS = list("ABCDEFGHKMNPRSTXYZ0123456789agkmx")
FASTEST_PX_S = (20, 1200)  # of the background, drawn log-uniformly
HELD, SHAKE_PX = 0.6, (2, 24)  # cameras in a hand, and how far they shake: they see the edges of large things only
TRUTH_US = 5000  # between pictures
WHITE_A = (3e-15, 4e-12)  # photocurrent of white, drawn log-uniformly: corners of 2 Hz to 2.4 kHz
THRESHOLDS = (0.08, 0.5)  # mean of ON and OFF, drawn log-uniformly

Rng = np.random.Generator
Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Layer:
    """A texture with its coverage (0 … 1), moved by x, y [px], turned by angle [rad] and scaled, each [n]."""

    texture: Picture
    cover: Picture
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    angle: NDArray[np.float64]
    scale: NDArray[np.float64]


def _uniform_log(rng: Rng, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _noise(rng: Rng) -> Picture:
    """A spectrum of f^-1.6 to f^-3.2 in power, as photographs have."""
    f = np.fft.fftfreq(TEXTURE_PX)
    radius = np.hypot(f[:, None], f)
    radius[0, 0] = 1
    values = np.fft.ifft2(np.fft.fft2(rng.normal(size=radius.shape)) / radius ** rng.uniform(0.8, 1.6)).real
    low, high = np.percentile(values, (1, 99))
    return np.clip((values - low) / (high - low), 0, 1).astype(np.float32)


def _polygon(rng: Rng, spread: float) -> NDArray[np.int32]:
    corners = rng.uniform(0, TEXTURE_PX, 2) + rng.normal(0, spread, (int(rng.integers(3, 7)), 2))
    return corners.astype(np.int32)


def _shapes(rng: Rng) -> Picture:
    out = np.full((TEXTURE_PX, TEXTURE_PX), rng.uniform(0.1, 0.9), np.float32)
    for _ in range(round(_uniform_log(rng, 3, 60))):
        cv2.fillPoly(out, [_polygon(rng, rng.uniform(5, 110))], float(rng.uniform(0, 1)), lineType=cv2.LINE_AA)
    return out


def _text(rng: Rng) -> Picture:
    out = np.full((TEXTURE_PX, TEXTURE_PX), rng.uniform(0.5, 1), np.float32)
    for _ in range(round(_uniform_log(rng, 1, 50))):
        word = "".join(rng.choice(LETTERS, int(rng.integers(2, 8))))
        at = tuple(int(v) for v in rng.uniform(0, TEXTURE_PX, 2))
        font, size, ink = int(rng.integers(0, 8)), rng.uniform(0.3, 1.8), float(rng.uniform(0, 0.6))
        cv2.putText(out, word, at, font, size, ink, int(rng.integers(1, 4)), cv2.LINE_AA)
    return 1 - out if rng.random() < 0.3 else out


def _checks(rng: Rng) -> Picture:
    y, x = np.mgrid[0:TEXTURE_PX, 0:TEXTURE_PX]
    turn, width, stripes = rng.uniform(0, math.pi), rng.uniform(6, 40), rng.random() < 0.5
    across, along = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    on = (across // width + (0 if stripes else along // width)) % 2
    return cv2.GaussianBlur(on.astype(np.float32), (0, 0), 0.7)


def _plain(rng: Rng) -> Picture:
    """Most things are dark or bright."""
    return np.full((TEXTURE_PX, TEXTURE_PX), rng.beta(0.5, 0.5), np.float32)


def _texture(rng: Rng, plain: float) -> Picture:
    """Reflectance, 0.02 to 1. plain: how many are uniform."""
    kinds = (0.3, 0.35, 0.25, 0.1)
    made = _plain(rng) if rng.random() < plain else (_noise, _shapes, _text, _checks)[rng.choice(4, p=kinds)](rng)
    if rng.random() < 0.3:
        made = made * (0.5 + 0.5 * _noise(rng))
    dark, bright = np.sort(rng.uniform(0.02, 1, 2)) if rng.random() < 0.5 else (0.03, rng.uniform(0.5, 1))
    return (dark + (bright - dark) * made).astype(np.float32)


def _cover(rng: Rng) -> Picture:
    out = np.zeros((TEXTURE_PX, TEXTURE_PX), np.float32)
    middle, sides = rng.uniform(60, TEXTURE_PX - 60, 2), rng.uniform(12, 110, 2)
    kind = rng.random()
    if kind < 0.35:
        cv2.ellipse(out, (tuple(middle), tuple(2 * sides), rng.uniform(0, 180)), 1, -1, cv2.LINE_AA)
    elif kind < 0.7:
        corners = cv2.boxPoints((tuple(middle), tuple(1.6 * sides), rng.normal(0, 8))).astype(np.int32)
        cv2.fillPoly(out, [corners], 1, lineType=cv2.LINE_AA)
    else:
        corners = (middle + rng.normal(0, 55, (int(rng.integers(3, 7)), 2))).astype(np.int32)
        cv2.fillPoly(out, [corners], 1, lineType=cv2.LINE_AA)
    return out


def _path(
    rng: Rng, times_s: NDArray[np.float64], still: NDArray[np.bool_], fastest: float, shakes: float
) -> NDArray[np.float64]:
    """Position over time whose largest speed is `fastest` per second; it stands where `still`. shakes: how likely."""
    speed = np.zeros(len(times_s))
    for hz in SHAKE_HZ if rng.random() < shakes else MOTION_HZ:
        speed += rng.normal() * np.sin(2 * math.pi * hz * times_s + rng.uniform(0, 2 * math.pi)) / hz**0.8
    speed *= fastest / max(float(np.abs(speed).max()), 1e-9)
    speed[still] = 0
    return np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(times_s))])


def _pauses(rng: Rng, times_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    still, end = np.zeros(len(times_s), bool), times_s[-1]
    if rng.random() < 0.65:
        begin = rng.uniform(0.15, 0.7) * end
        still |= (times_s >= begin) & (times_s < begin + rng.uniform(0.15, 0.5) * end)
    return still


def _layers(rng: Rng, times_s: NDArray[np.float64], fastest_px_s: float, held: bool) -> Iterator[Layer]:
    """The background and up to four things before it. Each moves by itself, or the camera moves, so that things at one
    distance move alike: always if it is held, and in half of the other sequences. All stand in pauses, or each does."""
    common = _pauses(rng, times_s) if held or rng.random() < 0.7 else None
    flat = rng.permutation([1.0, _uniform_log(rng, 0.1, 1)]) if held else np.ones(2)  # hands shake along one direction

    def motion(near: float) -> Iterator[NDArray[np.float64]]:
        still = _pauses(rng, times_s) if common is None else common
        turn, grow = (0.03, 0.01) if held else (1, 1)
        x, y = near * fastest_px_s * flat
        fastest = x, y, turn * _uniform_log(rng, 0.03, 2), grow * _uniform_log(rng, 0.01, 0.5)
        return (_path(rng, times_s, still, most, 0.9 if held else 0.4) for most in fastest)

    shared = list(motion(1)) if held or rng.random() < 0.5 else None
    for i in range(int(rng.integers(1, 6))):
        cover = _cover(rng) if i else np.ones((TEXTURE_PX,) * 2, np.float32)
        apart = rng.uniform(-60, 60, 2) if i else (0, 0)
        nearer = rng.uniform(0.9, 1.2) if i else 1
        x, y, turn, grow = [nearer * a for a in shared] if shared else motion(rng.uniform(0.2, 1) if i else 1)
        yield Layer(_texture(rng, 0.4 if i else 0.3), cover, x + apart[0], y + apart[1], turn, np.exp(grow))


def light(rng: Rng, config: ProceduralConfig) -> tuple[NDArray[np.float64], Picture]:
    """Times [n] us, half a pixel of the fastest motion or 2 ms apart at most, and light [n, H, W]; 1: white."""
    held = rng.random() < HELD
    fastest = 2 * math.pi * SHAKE_HZ[1] * _uniform_log(rng, *SHAKE_PX) if held else _uniform_log(rng, *FASTEST_PX_S)
    n = math.ceil(config.duration_us * 1e-6 * min(max(2 * fastest, 500), 1000))
    times_us = np.linspace(0, config.duration_us, n + 1)
    layers, side, middle = list(_layers(rng, times_us * 1e-6, fastest, held)), config.size, TEXTURE_PX / 2
    lamp = cv2.resize(_noise(rng)[:6, :6], (side, side), interpolation=cv2.INTER_CUBIC)
    lamp = np.exp((lamp - lamp.mean()) * rng.uniform(0, 1)).astype(np.float32)  # uneven light
    blur = rng.uniform(0.4, 1.2) if rng.random() < 0.6 else 0  # of a lens [px]
    out = np.empty((n + 1, side, side), np.float32)
    for k, picture in enumerate(out):
        for i, layer in enumerate(layers):
            c, s = (f(layer.angle[k]) * layer.scale[k] for f in (math.cos, math.sin))
            at_x, at_y = side / 2 + layer.x[k] - (c - s) * middle, side / 2 + layer.y[k] - (s + c) * middle
            turn = np.array([[c, -s, at_x], [s, c, at_y]])
            moved = cv2.warpAffine(layer.texture, turn, (side, side), borderMode=cv2.BORDER_REFLECT)
            if i:
                cover = cv2.warpAffine(layer.cover, turn, (side, side))
                moved = picture + cover * (moved - picture)
            picture[:] = moved
        picture *= lamp
        if blur:
            cv2.GaussianBlur(picture, (0, 0), blur, dst=picture)
    return times_us, out / max(float(np.percentile(out, 99)), 1e-3)


def camera(rng: Rng) -> dict[str, Any]:
    """Options of `simulate` for a sequence: light, and values of the chip from good to bad cameras."""
    photocurrent_a = _uniform_log(rng, *WHITE_A)
    threshold, ratio = _uniform_log(rng, *THRESHOLDS), math.exp(rng.normal(0, 0.2))
    values = {
        "contrast_threshold_on": min(threshold * ratio, 1.5),
        "contrast_threshold_off": min(threshold / ratio, 1.5),
        "threshold_mismatch": rng.uniform(0.02, 0.25),
        "background_on_hz": _uniform_log(rng, 0.03, 3),
        "background_off_hz": _uniform_log(rng, 0.03, 3),
        "leak_rate_hz": _uniform_log(rng, 0.01, 0.5),
        "hot_pixel_fraction": _uniform_log(rng, 1e-4, 3e-3),
        "hot_pixel_hz": _uniform_log(rng, 10, 300),
        "refractory_period_s": _uniform_log(rng, 1e-5, 2e-3),
        "amplifier_cutoff_hz": _uniform_log(rng, 100, 3000),
        "noise_std": rng.uniform(0, 0.06) if threshold > 0.15 else 0.02,
    }
    frames = rng.random() < 0.4  # a DAVIS also takes frames, whose exposures disturb its pixels
    if frames:
        period_s = _uniform_log(rng, 0.03, 0.15)
        values |= {
            "frame_period_s": period_s,
            "frame_exposure_s": rng.uniform(0.1, 0.7) * period_s,
            "frame_dead_s": 0.25 * period_s,
            "frame_step": threshold * _uniform_log(rng, 0.1, 0.6),
            "frame_step_spread": rng.uniform(0.1, 1),
            "frame_step_slow": threshold * _uniform_log(rng, 0.05, 0.3),
            "frame_step_slow_s": _uniform_log(rng, 2e-3, 1e-2),
        }
    return {"photocurrent_a": photocurrent_a, "overrides": values, "chip_frames": frames}


@dataclass(frozen=True)
class Procedural:
    """A `Source` of clips."""

    events: NDArray[Any]
    times_us: NDArray[np.int64]
    pictures: NDArray[np.uint8]
    corner_hz: float | None


def sequence(
    number: int, seed: int, config: ProceduralConfig, camera: Callable[[Rng], dict[str, Any]] = camera
) -> Procedural:
    rng = np.random.Generator(np.random.Philox(key=[seed, number]))
    times_us, planes = light(rng, config)
    drawn = {"chip": CHIP, "seed": number, "readout": "ideal", "threads": 1, "model": config.model} | camera(rng)
    found = simulate(planes, times_us, **drawn)
    events = found[0] if drawn.get("chip_frames") else found
    shown_us = np.arange(0, config.duration_us + 1, TRUTH_US)
    shown = planes[np.searchsorted(times_us, shown_us - 1e-6)]
    with Chip(CHIP) as chip:
        slow_hz = chip.corner_hz_per_a * drawn["photocurrent_a"] * float(planes.mean())
    return Procedural(events, shown_us, eight_bit(shown), slow_hz if config.model == "pecs" else None)


def sequences(seed: int, config: ProceduralConfig, progress: Callable[[int], None] | None = None) -> list[Procedural]:
    """Made by all cores; progress: number of sequences so far."""
    found: list[Procedural] = []
    with ThreadPoolExecutor() as pool:
        for made in pool.map(lambda number: sequence(number, seed, config), range(config.count)):
            found.append(made)
            if progress:
                progress(len(found))
    return found
