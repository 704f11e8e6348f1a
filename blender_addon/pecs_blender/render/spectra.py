# SPDX-License-Identifier: GPL-3.0-or-later
"""Spectra: tables of value over wavelength, linear in between; or one number for all wavelengths. Outside its table a
power is zero, and a reflectance keeps its end value."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pecs
from pecs._errors import PecsNotFoundError, bad_input

# Luminous efficacy at the peak of V(lambda) [lm/W]: SI Brochure, 9th edition, K_cd.
K_CD_LM_PER_W = 683.0
VISIBLE_NM = np.arange(380.0, 781.0)
C2_NM_K = 1.438776877e7  # second radiation constant hc/k, CODATA 2018


def spectra_dir() -> Path:
    return pecs.data_dir("lens_data/spectra")


@dataclass(frozen=True)
class Spectrum:
    """`name` is for records, `source` what `spectrum()` takes; lambda_nm rises strictly. A constant has one point."""

    name: str
    lambda_nm: np.ndarray
    value: np.ndarray
    source: float | str

    def __call__(self, lambda_nm) -> np.ndarray:
        """As a power: zero outside the table."""
        return self._at(lambda_nm, 0.0)

    def reflectance(self, lambda_nm) -> np.ndarray:
        """As a reflectance: its end values beyond the table."""
        return self._at(lambda_nm, None)

    def _at(self, lambda_nm, outside) -> np.ndarray:
        lambda_nm = np.asarray(lambda_nm, float)
        if len(self.value) == 1:
            return np.full(lambda_nm.shape, self.value[0])
        return np.interp(lambda_nm, self.lambda_nm, self.value, left=outside, right=outside)

    @property
    def is_constant(self) -> bool:
        return len(self.value) == 1

    def luminous(self) -> float:
        """integral V(lambda) S(lambda) dlambda."""
        return float(np.sum(load("photopic")(VISIBLE_NM) * self(VISIBLE_NM)))

    def power(self) -> float:
        """integral S(lambda) dlambda, over the table; a constant's over the visible."""
        if self.is_constant:
            return float(self.value[0] * (VISIBLE_NM[-1] - VISIBLE_NM[0]))
        return float(np.sum(np.diff(self.lambda_nm) * (self.value[1:] + self.value[:-1]) / 2))


def constant(value: float) -> Spectrum:
    return Spectrum(f"{value:g}", np.array([0.0]), np.array([float(value)]), float(value))


def load(name_or_path: str, folder: Path | None = None) -> Spectrum:
    """A CSV file (wavelength_nm,value; '#' starts a comment), the name of one in lens_data/spectra, `blackbody:T` or
    `daylight:T` (T in kelvin)."""
    if match := re.fullmatch(r"(blackbody|daylight):(.*)", name_or_path):
        return _of_temperature(match[1], match[2])
    if name_or_path.endswith(".csv"):
        path = (folder or Path()).absolute() / name_or_path
    elif re.fullmatch(r"\w+(/\w+)?", name_or_path):
        path = spectra_dir() / f"{name_or_path}.csv"
    else:
        raise PecsNotFoundError(
            f"spectrum: got {name_or_path!r}, wanted a name of the library, a .csv file, blackbody:T or daylight:T"
        )
    rows = _table(path, 2)
    if rows[:, 1].min() < 0:
        raise bad_input(path, "table", rows[:, 1].min(), "values that are not negative")
    source = str(path) if name_or_path.endswith(".csv") else name_or_path
    return Spectrum(path.stem, rows[:, 0], rows[:, 1], source)


def basis(name: str) -> tuple[np.ndarray, np.ndarray]:
    """lambda_nm [n] and columns [n, 3] of a table in lens_data/spectra/basis."""
    rows = _table(spectra_dir() / "basis" / f"{name}.csv", 4)
    return rows[:, 0], rows[:, 1:]


@cache
def _table(path: Path, columns: int) -> np.ndarray:
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in spectra_dir().glob("*.csv")))
        library = spectra_dir()
        name = path.relative_to(library).with_suffix("") if path.is_relative_to(library) else path
        raise PecsNotFoundError(f"{name}: no such spectrum; the library has {known}, colorchecker/...")
    rows = []
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
        if not line.strip() or line.startswith("#") or line.startswith("wavelength_nm"):
            continue
        try:
            row = [float(word) for word in line.split(",")]
        except ValueError:
            row = []
        if len(row) != columns or not np.isfinite(row).all():
            raise bad_input(path, f"line {number}", repr(line), f"{columns} finite numbers: wavelength_nm,value")
        if rows and row[0] <= rows[-1][0]:
            raise bad_input(path, f"line {number}", f"{row[0]} nm after {rows[-1][0]} nm", "rising wavelengths")
        rows.append(row)
    if len(rows) < 2:
        raise bad_input(path, "table", f"{len(rows)} rows", "at least 2")
    return np.array(rows)


def _of_temperature(kind: str, text: str) -> Spectrum:
    low_k, high_k = (500.0, 1e5) if kind == "blackbody" else (4000.0, 25000.0)
    try:
        t_k = float(text)
    except ValueError:
        t_k = float("nan")
    if not low_k <= t_k <= high_k:
        raise bad_input("spectrum", f"{kind}:T", text, f"a temperature in [{low_k:g}, {high_k:g}] K")
    name = f"{kind}:{t_k:g}"
    if kind == "daylight":
        lambda_nm, (s0, s1, s2) = (lambda b: (b[0], b[1].T))(basis("daylight"))
        m1, m2 = _daylight_weights(t_k)
        return Spectrum(name, lambda_nm, np.maximum(s0 + m1 * s1 + m2 * s2, 0.0), name)
    lambda_nm = np.arange(300.0, 1101.0, 5.0)
    # Planck, 100 at 560 nm
    planck = lambda_nm**-5.0 / np.expm1(C2_NM_K / (lambda_nm * t_k))
    return Spectrum(name, lambda_nm, 100 * planck / np.interp(560.0, lambda_nm, planck), name)


def _daylight_weights(t_k: float) -> tuple[float, float]:
    """M1, M2 of a CIE daylight phase: CIE 15:2018, Eqs. 4.6-4.10 (chromaticity, then weights to three decimals)."""
    x = (
        -4.6070e9 / t_k**3 + 2.9678e6 / t_k**2 + 0.09911e3 / t_k + 0.244063
        if t_k <= 7000
        else -2.0064e9 / t_k**3 + 1.9018e6 / t_k**2 + 0.24748e3 / t_k + 0.237040
    )
    y = -3.000 * x**2 + 2.870 * x - 0.275
    m = 0.0241 + 0.2562 * x - 0.7341 * y
    return round((-1.3515 - 1.7703 * x + 5.9114 * y) / m, 3), round((0.0300 - 31.4424 * x + 30.0717 * y) / m, 3)


def spectrum(value: float | str, folder: Path | None = None) -> Spectrum:
    """A number is a constant spectrum, text names a table."""
    return load(value, folder) if isinstance(value, str) else constant(value)


def illuminance_lux(irradiance_per_unit, spectral_irradiance) -> float:
    """E_v = K_cd * integral V(lambda) E(lambda) dlambda, both arguments functions of lambda_nm (arrays)."""
    v = load("photopic")
    return float(
        K_CD_LM_PER_W * np.sum(v(VISIBLE_NM) * irradiance_per_unit(VISIBLE_NM) * spectral_irradiance(VISIBLE_NM))
    )
