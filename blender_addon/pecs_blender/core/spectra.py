# SPDX-License-Identifier: GPL-3.0-or-later
"""Spectra: tables of value over wavelength, linear in between, zero outside; or one number for all wavelengths."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import NOT_FOUND, RenderError, bad_input

# Luminous efficacy at the peak of V(lambda) [lm/W]: SI Brochure, 9th edition, K_cd.
K_CD_LM_PER_W = 683.0


def spectra_dir() -> Path:
    import pecs  # here: bpy must come first where it is used

    return pecs.data_dir("lens_data/spectra")


@dataclass(frozen=True)
class Spectrum:
    """`name` is for records; lambda_nm rises strictly. A constant spectrum has one point."""

    name: str
    lambda_nm: np.ndarray
    value: np.ndarray

    def __call__(self, lambda_nm) -> np.ndarray:
        lambda_nm = np.asarray(lambda_nm, float)
        if len(self.value) == 1:
            return np.full(lambda_nm.shape, self.value[0])
        return np.interp(lambda_nm, self.lambda_nm, self.value, left=0.0, right=0.0)

    def pairs(self) -> list[tuple[float, float]] | None:
        """As pecs.bands takes an illuminant; None for a constant."""
        if len(self.value) == 1:
            return None
        return list(zip(self.lambda_nm.tolist(), self.value.tolist(), strict=True))


def constant(value: float) -> Spectrum:
    return Spectrum(f"{value:g}", np.array([0.0]), np.array([float(value)]))


def load(name_or_path: str, folder: Path | None = None) -> Spectrum:
    """A CSV file (wavelength_nm,value; '#' starts a comment), or the name of one in lens_data/spectra."""
    path = Path(name_or_path)
    if path.suffix == ".csv":
        path = (folder or Path()) / path
    else:
        path = spectra_dir() / f"{name_or_path}.csv"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in spectra_dir().glob("*.csv")))
        raise RenderError(NOT_FOUND, f"{path}: no such spectrum; the library has {known}")
    rows = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if not line.strip() or line.startswith("#") or line.startswith("wavelength_nm"):
            continue
        try:
            lambda_nm, value = map(float, line.split(","))
        except ValueError:
            raise bad_input(path, f"line {number}", repr(line), "wavelength_nm,value") from None
        if not (np.isfinite(lambda_nm) and np.isfinite(value) and value >= 0):
            raise bad_input(path, f"line {number}", repr(line), "finite numbers, the value not negative")
        if rows and lambda_nm <= rows[-1][0]:
            raise bad_input(path, f"line {number}", f"{lambda_nm} nm after {rows[-1][0]} nm", "rising wavelengths")
        rows.append((lambda_nm, value))
    if len(rows) < 2:
        raise bad_input(path, "table", f"{len(rows)} rows", "at least 2")
    table = np.array(rows)
    return Spectrum(path.stem, table[:, 0], table[:, 1])


def spectrum(value: float | str, folder: Path | None = None) -> Spectrum:
    """A number is a constant spectrum, text names a table."""
    return load(value, folder) if isinstance(value, str) else constant(value)


def illuminance_lux(irradiance_per_unit, spectral_irradiance) -> float:
    """E_v = K_cd * integral V(lambda) E(lambda) dlambda, both arguments functions of lambda_nm (arrays)."""
    v = load("photopic")
    grid_nm = np.arange(380.0, 781.0)
    return float(K_CD_LM_PER_W * np.sum(v(grid_nm) * irradiance_per_unit(grid_nm) * spectral_irradiance(grid_nm)))
