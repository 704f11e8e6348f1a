"""Spectra by name, and refractive indices of glasses (lens_data/)."""

from __future__ import annotations

from os import PathLike

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._c_types import DOUBLES, INT64, POINTER, TEXT
from ._library import function, options_bytes, path_bytes, take_json

_spectrum = function("pecs_spectrum", POINTER, TEXT)
_glass = function("pecs_glass_index", INT64, TEXT, DOUBLES, INT64, DOUBLES, INT64)


def spectrum(name_or_path: str | PathLike[str], lambda_nm: ArrayLike | None = None) -> NDArray[np.float64]:
    """A spectrum at wavelengths [nm], linear between its points and 0 outside them; without wavelengths the table
    itself, [2, points].

        pecs.spectrum("d65", [450, 550, 650])
        lambda_nm, power = pecs.spectrum("blackbody:2856")     # the table itself, [2, points]

    Names are those of lens_data/spectra ("d65", "colorchecker/red"), a .csv file (wavelength [nm], value),
    "blackbody:T" or "daylight:T" with T in K. "basis/srgb" and "basis/daylight" contain three functions: a first axis
    of 3, or [4, points].
    """
    table = np.array(take_json(_spectrum(path_bytes(name_or_path)))).T
    if lambda_nm is None:
        return table
    at = np.asarray(lambda_nm, np.float64)
    values = np.array([np.interp(at, table[0], column, left=0, right=0) for column in table[1:]])
    return values[0] if len(values) == 1 else values


def glass(glass: str | tuple[float, float], lambda_nm: ArrayLike) -> NDArray[np.float64]:
    """Refractive index relative to air at wavelengths [nm].

        pecs.glass("N-BK7", 550)
        pecs.glass((1.5168, 64.2), [450, 550, 650])            # n_d and the Abbe number

    A name of lens_data/glasses ("N-BK7", or "schott/N-BK7") has the manufacturer's formula; n_d and Abbe number have
    Hartmann's formula through both and the normal line (350 to 1100 nm).
    """
    options = {"name": glass} if isinstance(glass, str) else {"nd": float(glass[0]), "vd": float(glass[1])}
    at = np.ascontiguousarray(lambda_nm, np.float64)
    index = np.empty_like(at)
    _glass(options_bytes(options), at, at.size, index, index.size)
    return index.reshape(np.shape(lambda_nm))
