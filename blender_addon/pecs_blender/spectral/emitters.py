# SPDX-License-Identifier: GPL-3.0-or-later
"""The normalisation of lamps with different spectra."""

from __future__ import annotations

import numpy as np

from .bands import BandSet
from .spectra import Spectrum

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec. 709, Blender's working space


class Emitters:
    """The lamps' spectra at equal luminance: an emitter of radiance 1 has spectral radiance s(lambda) with
    integral V s = 1, so that naming a spectrum does not change a lamp's brightness. A lamp without visible light has
    the illuminant's radiant power instead."""

    def __init__(self, illuminant: Spectrum):
        self.illuminant = illuminant
        self._per_unit: dict[float | str, tuple[Spectrum, float]] = {}
        self._dark: dict[float | str, bool] = {}

    def add(self, s: Spectrum, dark: bool = False) -> None:
        """dark: of a shader that emits nothing."""
        self._dark[s.source] = self._dark.get(s.source, True) and dark
        luminous, power = s.luminous(), s.power()
        if luminous < 1e-3 * power:
            luminous = power * self.illuminant.luminous() / self.illuminant.power()
        self._per_unit[s.source] = (s, 1 / luminous)

    @property
    def spectra(self) -> list[Spectrum]:
        """Spectra of emitters that shine; all if none does."""
        return [s for s, _ in self._per_unit.values() if not self._dark[s.source]] or [
            s for s, _ in self._per_unit.values()
        ]

    def spectrum(self, source: float | str) -> Spectrum:
        return self._per_unit[source][0]

    def power(self, source: float | str, lambda_nm) -> np.ndarray:
        s, scale = self._per_unit[source]
        return scale * s(lambda_nm)

    def __call__(self, source: float | str, bands: BandSet) -> np.ndarray:
        s, scale = self._per_unit[source]
        return scale * bands.light(s)

    def norm(self, bands: BandSet) -> np.ndarray:
        """n_k: the strongest emitter in each band; Cycles renders the emitters relative to it."""
        return np.max([self(source, bands) for source in self._per_unit], axis=0)

    def relative(self, source: float | str, bands: BandSet) -> np.ndarray:
        norm = self.norm(bands)
        return np.divide(self(source, bands), norm, out=np.zeros(norm.shape), where=norm > 0)

    def mean_pairs(self) -> list[tuple[float, float]] | None:
        """(lambda_nm, power) of all lamps together, for pecs.bands; None if all spectra are constant."""
        tables = [s for s in self.spectra if not s.is_constant]
        if not tables:
            return None
        lambda_nm = np.unique(np.concatenate([s.lambda_nm for s in tables]))
        if len(tables) < len(self.spectra):  # a constant spectrum has no range
            lambda_nm = np.unique(np.concatenate([np.arange(300.0, 1101.0, 5.0), lambda_nm]))
        total = np.sum([self.power(s.source, lambda_nm) for s in self.spectra], axis=0)
        return list(zip(lambda_nm.tolist(), total.tolist(), strict=True))
