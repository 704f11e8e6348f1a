# SPDX-License-Identifier: GPL-3.0-or-later
"""Spectra of lamps and surfaces: tables of value over wavelength, linear in between, or one number for all wavelengths.
Outside its table a power is zero, and a reflectance keeps its end value. Refractive indices of glass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pecs
from pecs._errors import bad_input

# Luminous efficacy at the peak of V(lambda) [lm/W]: SI Brochure, 9th edition, K_cd.
K_CD_LM_PER_W = 683.0
VISIBLE_NM = np.arange(380.0, 781.0)
OCIO = "BLENDER_OCIO", "OCIO"  # in the environment: name a configuration instead of Blender's own colour spaces
ABBE_RANGE_NM = 350.0, 1100.0  # of pecs.glass from n_d and the Abbe number; constant outside


@dataclass(frozen=True)
class Spectrum:
    """name: for records; source: argument of `spectrum()`; lambda_nm: increasing. A constant has one point."""

    name: str
    lambda_nm: np.ndarray
    value: np.ndarray
    source: float | str

    def __call__(self, lambda_nm) -> np.ndarray:
        """As a power: zero outside the table."""
        return self._at(lambda_nm, 0.0)

    def reflectance(self, lambda_nm) -> np.ndarray:
        """As a reflectance: its end values outside the table."""
        return self._at(lambda_nm, None)

    def _at(self, lambda_nm, outside) -> np.ndarray:
        lambda_nm = np.asarray(lambda_nm, float)
        if self.is_constant:
            return np.full(lambda_nm.shape, self.value[0])
        return np.interp(lambda_nm, self.lambda_nm, self.value, left=outside, right=outside)

    @property
    def is_constant(self) -> bool:
        return len(self.value) == 1

    def luminous(self) -> float:
        """integral V(lambda) S(lambda) dlambda."""
        return float(np.sum(load("photopic")(VISIBLE_NM) * self(VISIBLE_NM)))

    def power(self) -> float:
        """integral S(lambda) dlambda over the table; of a constant, over the visible range."""
        if self.is_constant:
            return float(self.value[0] * (VISIBLE_NM[-1] - VISIBLE_NM[0]))
        return float(np.sum(np.diff(self.lambda_nm) * (self.value[1:] + self.value[:-1]) / 2))


def constant(value: float) -> Spectrum:
    return Spectrum(f"{value:g}", np.array([0.0]), np.array([float(value)]), float(value))


def load(name_or_path: str, folder: Path | None = None) -> Spectrum:
    """A spectrum as in pecs.spectrum; `folder`: of relative CSV paths."""
    is_file = name_or_path.endswith(".csv")
    source = str((folder or Path()).absolute() / name_or_path) if is_file else name_or_path
    lambda_nm, value = _table(source)
    has_stem = is_file or ":" not in source  # blackbody:2856 has none
    return Spectrum(Path(source).stem if has_stem else source, lambda_nm, value, source)


@cache
def _table(source: str) -> np.ndarray:
    return pecs.spectrum(source)


def spectrum(value: float | str, folder: Path | None = None) -> Spectrum:
    """A number is a constant spectrum, text names a table."""
    return load(value, folder) if isinstance(value, str) else constant(value)


def basis(name: str) -> tuple[np.ndarray, np.ndarray]:
    """lambda_nm [n] and columns [n, 3] of a table in lens_data/spectra/basis."""
    lambda_nm, *columns = _table(f"basis/{name}")
    return lambda_nm, np.stack(columns, axis=1)


def srgb_reflectances(lambda_nm: np.ndarray) -> np.ndarray:
    """[n, 3]: reflectances = matrix @ linear Rec. 709. Mallett & Yuksel 2019: a reflectance is r R(lambda) +
    g G(lambda) + b B(lambda), R + G + B = 1; outside the table (380-780 nm) its end values."""
    at_nm, primaries = basis("srgb")
    rows = np.array([np.interp(lambda_nm, at_nm, primary) for primary in primaries.T]).T
    return rows / rows.sum(axis=1, keepdims=True)


def illuminance_lux(irradiance_per_unit, spectral_irradiance) -> float:
    """E_v = K_cd * integral V(lambda) E(lambda) dlambda, both arguments functions of lambda_nm (arrays)."""
    v = load("photopic")
    return float(
        K_CD_LM_PER_W * np.sum(v(VISIBLE_NM) * irradiance_per_unit(VISIBLE_NM) * spectral_irradiance(VISIBLE_NM))
    )


def glass(name_or_abbe: str | float, nd: float) -> Callable[[float], float]:
    """Refractive index at a wavelength [nm]. A name of lens_data/glasses has its catalogue's formula, an Abbe number
    the shader's own index nd."""
    if isinstance(name_or_abbe, str):
        pecs.glass(name_or_abbe, 587.56)  # raises for an unknown name
        return cache(lambda nm: float(pecs.glass(name_or_abbe, nm)))
    if not 10 <= name_or_abbe <= 120:
        raise bad_input("material", "pecs_glass", name_or_abbe, "an Abbe number in [10, 120] or a glass's name")
    return cache(lambda nm: float(pecs.glass((nd, name_or_abbe), np.clip(nm, *ABBE_RANGE_NM))))
