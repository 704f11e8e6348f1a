# SPDX-License-Identifier: GPL-3.0-or-later
"""RGB colours at the three wavelengths of a pass, and the normalisation of lamps with different spectra."""

from __future__ import annotations

import numpy as np

from .spectra import Spectrum, basis

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec. 709, Blender's working space


def band_matrix(rgb_nm: np.ndarray) -> np.ndarray:
    """[3, 3]: reflectances at three wavelengths = matrix @ linear Rec. 709. Mallett & Yuksel 2019: a reflectance is
    r R(lambda) + g G(lambda) + b B(lambda), R + G + B = 1; outside the table (380-780 nm) its end values."""
    lambda_nm, primaries = basis("srgb")
    rows = np.array([np.interp(rgb_nm, lambda_nm, primary) for primary in primaries.T]).T
    return rows / rows.sum(axis=1, keepdims=True)


class Emitters:
    """The lamps' spectra at equal luminance: an emitter of radiance 1 has spectral radiance s(lambda) with
    integral V s = 1, so that naming a spectrum does not change a lamp's brightness. A lamp without visible light has
    the illuminant's radiant power instead."""

    def __init__(self, illuminant: Spectrum):
        self.illuminant = illuminant
        self._per_unit: dict[float | str, tuple[Spectrum, float]] = {}

    def add(self, s: Spectrum) -> None:
        luminous, power = s.luminous(), s.power()
        if luminous < 1e-3 * power:
            luminous = power * self.illuminant.luminous() / self.illuminant.power()
        self._per_unit[s.source] = (s, 1 / luminous)

    @property
    def spectra(self) -> list[Spectrum]:
        return [s for s, _ in self._per_unit.values()]

    def __call__(self, source: float | str, lambda_nm) -> np.ndarray:
        s, scale = self._per_unit[source]
        return scale * s(lambda_nm)

    def norm(self, lambda_nm) -> np.ndarray:
        """n_k: the strongest emitter at each wavelength; Cycles renders the emitters relative to it."""
        return np.max([self(source, lambda_nm) for source in self._per_unit], axis=0)

    def relative(self, source: float | str, lambda_nm) -> np.ndarray:
        norm = self.norm(lambda_nm)
        return np.divide(self(source, lambda_nm), norm, out=np.zeros(np.shape(lambda_nm)), where=norm > 0)

    def mean_pairs(self) -> list[tuple[float, float]] | None:
        """(lambda_nm, power) of all lamps together, for pecs.bands; None if all spectra are constant."""
        tables = [s for s in self.spectra if not s.is_constant]
        if not tables:
            return None
        lambda_nm = np.unique(np.concatenate([s.lambda_nm for s in tables]))
        if len(tables) < len(self.spectra):  # a constant spectrum has no range
            lambda_nm = np.unique(np.concatenate([np.arange(300.0, 1101.0, 5.0), lambda_nm]))
        total = np.sum([self(source, lambda_nm) for source in self._per_unit], axis=0)
        return list(zip(lambda_nm.tolist(), total.tolist(), strict=True))
