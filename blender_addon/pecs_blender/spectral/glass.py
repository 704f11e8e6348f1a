# SPDX-License-Identifier: GPL-3.0-or-later
"""Refractive index of a scene's glass over wavelength."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pecs
from pecs._errors import bad_input

ABBE_RANGE_NM = 350.0, 1100.0  # of pecs.glass from n_d and the Abbe number; constant outside


def glass(name_or_abbe: str | float, nd: float) -> Callable[[float], float]:
    """Index at a wavelength [nm]. A name of lens_data/glasses has its catalogue's formula. An Abbe number has the
    shader's own index nd."""
    if isinstance(name_or_abbe, str):
        pecs.glass(name_or_abbe, 587.56)  # raises for an unknown name
        return cache(lambda nm: float(pecs.glass(name_or_abbe, nm)))
    if not 10 <= name_or_abbe <= 120:
        raise bad_input("material", "pecs_glass", name_or_abbe, "an Abbe number in [10, 120] or a glass's name")
    return cache(lambda nm: float(pecs.glass((nd, name_or_abbe), np.clip(nm, *ABBE_RANGE_NM))))
