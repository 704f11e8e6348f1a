"""Pictures of an RGB camera from a stack's light: exposure along the motion, rolling shutter, shot and read noise,
Bayer pattern, colour.

The three filters are bell curves (PEAKS_NM), assumed: as dye filters of common sensors, behind a filter that cuts the
ultraviolet and infrared. Electrons are photocurrent x exposure / e, so shot noise is that of the light. The colour
matrix gives sRGB's three primaries under the stack's illuminant their own colours with these filters and these bands;
white also stays white with few bands.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._config import read_json
from .._files import write_text
from .._library import data_dir
from ..spectra import spectrum
from .recipe import Film

Spectrum = tuple[NDArray[np.float64], NDArray[np.float64]]  # wavelengths [nm], power
ELECTRON_C = 1.602176634e-19
PEAKS_NM = ((605.0, 40.0), (535.0, 40.0), (460.0, 35.0))  # red, green, blue: peak and standard deviation
CUT_NM = (400.0, 701.0)
WHITE_SHARE = 0.9  # of white: the 99th percentile of a picture
WEAKEST = 0.02  # of the greatest singular value of a colour matrix: weaker ones are noise
CV_NAMES = {"rggb": "BayerBG", "bggr": "BayerRG", "grbg": "BayerGB", "gbrg": "BayerGR"}  # OpenCV names the second row


def filters() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Wavelengths and quantum efficiency [n, 3] of red, green, blue relative to the greatest."""
    lambda_nm = np.arange(*CUT_NM, 5.0)
    qe = [np.exp(-((lambda_nm - peak) ** 2) / (2 * width**2)) for peak, width in PEAKS_NM]
    return lambda_nm, np.stack(qe, 1)


def write_chip(path: Path, channel: int | None, width: int, height: int, pitch_um: float, peak_qe: float) -> Path:
    """A chip profile with the response of one filter, or (None) with their sum, by which the renderer chooses bands."""
    profile = read_json(data_dir("sensor/chips") / "ideal.json")
    lambda_nm, qe = filters()
    values = qe.sum(1) / qe.sum(1).max() if channel is None else qe[:, channel]
    wanted = {"width": width, "height": height, "pixel_pitch_m": pitch_um * 1e-6, "fill_factor": 1, "peak_qe": peak_qe}
    for key, value in wanted.items():
        profile["values"][key] |= {"value": value, "source": "the data set's recipe"}
        if key in ("width", "height"):
            profile["values"][key]["range"] = [1, 8192]
    profile |= {"name": path.stem, "description": "film of an RGB camera"}
    profile["relative_qe"] = {
        "source": "assumed: bell curves, as dye filters of common sensors (pecs.datasets.rgb)",
        "lambda_nm": lambda_nm.tolist(),
        "value": values.tolist(),
    }
    text = json.dumps(profile, indent=1)
    if not path.exists() or path.read_bytes() != text.encode():
        write_text(path, text)
    return path


def colour_matrix(stack: dict[str, Any], illuminant: Spectrum) -> NDArray[np.float64]:
    """[3, 3]: linear sRGB from the filters' photocurrents, up to one scale; what is white under the illuminant is
    neutral. If the bands do not distinguish three colours, the matrix has a lower rank: colours that only the missing
    bands distinguish come out alike."""
    nm = np.array([band["lambda_nm"] for band in stack["bands"]])
    weight = np.array([band["weight_nm"] for band in stack["bands"]])
    lamp = np.interp(nm, *illuminant)
    at, *primaries = spectrum("basis/srgb")
    reflectance = np.array([np.interp(nm, at, primary) for primary in primaries])  # [3, bands]
    filter_nm, qe = filters()
    seen = np.array([np.interp(nm, filter_nm, q, left=0, right=0) for q in qe.T]) * nm * weight  # [3, bands]
    response = seen @ (lamp * reflectance).T  # [filter, primary]
    matrix = np.linalg.pinv(response, rcond=WEAKEST)
    matrix /= (matrix @ response.sum(1))[:, None]  # keeps white neutral
    return np.asarray(matrix / np.abs(matrix).max())


def illuminant(stack: dict[str, Any]) -> Spectrum:
    """Wavelengths and power of the scene's lamps together, each at equal luminance, as stack.json records them."""
    render = stack.get("render", {})
    if "lamps" not in render:  # not rendered by pecs_blender
        lambda_nm, power = spectrum(render.get("illuminant") or "d65")
        return lambda_nm, power
    pairs = np.array(render["lamps"] or [[CUT_NM[0], 1], [CUT_NM[1], 1]], np.float64)
    return pairs[:, 0], pairs[:, 1]


class Developer:
    """Photocurrents [A] of the three filters [3, H, W] to 8 bit sRGB [H, W, 3].

    `some`: planes of some instants of the sequence. The median one of them sets the gain, and a neutral filter before
    the lens where its light would overflow the wells."""

    def __init__(
        self,
        film: Film,
        exposure_ms: float,
        matrix: NDArray[np.float64],
        some: Iterable[NDArray[np.float32]],
        rng: np.random.Generator,
    ):
        self._film, self._matrix, self._rng = film, matrix, rng
        white = np.linalg.pinv(matrix, rcond=WEAKEST).sum(1)
        self._white = white / white.max()  # response of the filters to white
        self._electrons_per_a = exposure_ms * 1e-3 / ELECTRON_C
        seen = [self._brightness(self._electrons(planes)) for planes in some]
        electrons, linear = np.median(seen, axis=0)
        filtered = min(1.0, WHITE_SHARE * film.full_well_e / max(electrons, 1e-30))
        self._electrons_per_a *= filtered
        self._gain = WHITE_SHARE / max(linear * filtered, 1e-30)

    def _brightness(self, electrons: NDArray[np.float64]) -> tuple[float, float]:
        """99th percentiles of the pixels: of the brightest filter, and in linear sRGB."""
        linear = np.einsum("ij,jyx->yxi", self._matrix, electrons)
        return float(np.percentile(electrons.max(0), 99)), float(np.percentile(linear.max(-1), 99))

    def picture(self, planes_a: NDArray[np.float32]) -> NDArray[np.uint8]:
        """From the mean over the exposure, with shot noise, read noise, full well and Bayer pattern."""
        clean, pattern = self._electrons(planes_a), self._film.bayer
        raw = clean if pattern == "none" else _mosaic(clean, pattern)
        raw = self._rng.poisson(raw) + self._rng.normal(0, self._film.read_noise_e, raw.shape)
        raw = np.clip(raw, 0, self._film.full_well_e)
        return self._developed(raw if pattern == "none" else _demosaiced(raw, pattern))

    def sharp(self, planes_a: NDArray[np.float32]) -> NDArray[np.uint8]:
        """From the light of one time, without noise and Bayer pattern."""
        return self._developed(np.minimum(self._electrons(planes_a), self._film.full_well_e))

    def _electrons(self, planes_a: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.maximum(np.nan_to_num(planes_a.astype(np.float64)), 0) * self._electrons_per_a

    def _developed(self, electrons: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Saturates all filters where the first one does, so that white stays white."""
        white = self._white[:, None, None]
        balanced = np.minimum(electrons / white, self._film.full_well_e)
        return srgb(np.einsum("ij,jyx->yxi", self._matrix, balanced * white) * self._gain)


def srgb(linear: NDArray[np.float64]) -> NDArray[np.uint8]:
    """IEC 61966-2-1."""
    x = np.clip(linear, 0, 1)
    return np.round(255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)).astype(np.uint8)


def _mosaic(planes: NDArray[np.float64], pattern: str) -> NDArray[np.float64]:
    out = np.empty(planes.shape[1:])
    for i, colour in enumerate(pattern):
        at = np.s_[i // 2 :: 2, i % 2 :: 2]
        out[at] = planes["rgb".index(colour)][at]
    return out


def _demosaiced(raw: NDArray[np.float64], pattern: str) -> NDArray[np.float64]:
    """[3, H, W] by OpenCV's edge-aware method, in 16 bits over the picture's range."""
    import cv2

    most = max(float(raw.max()), 1e-30)
    code = getattr(cv2, f"COLOR_{CV_NAMES[pattern]}2RGB_EA")
    rgb = cv2.demosaicing(np.round(raw * (65535 / most)).astype(np.uint16), code)
    return np.moveaxis(rgb.astype(np.float64), -1, 0) * (most / 65535)


def frame_times_us(
    film: Film, height: int, duration_us: float, exposure_ms: float, phase_ms: float
) -> list[tuple[int, int]]:
    """Begin and end of the middle row's exposure, of the pictures all of whose rows lie within the sequence."""
    exposure_us, period_us, rolled_us = exposure_ms * 1e3, 1e6 / film.fps, film.rolled_us(height)
    begin = phase_ms * 1e3 + np.arange(math.ceil(duration_us / period_us)) * period_us
    whole = (begin >= rolled_us) & (begin + exposure_us + rolled_us <= duration_us)
    return [(round(b), round(b + exposure_us)) for b in begin[whole]]
