# SPDX-License-Identifier: GPL-3.0-or-later
"""Refractive index of a scene's glass over wavelength, from n_d and Abbe number: Cauchy's n = A + B / lambda^2. (The
lens itself is traced with the full formulas.)"""

from __future__ import annotations

from dataclasses import dataclass

import pecs
from pecs._config import Fields, read_json
from pecs._errors import PecsNotFoundError, bad_input

C_NM, D_NM, F_NM = 656.2725, 587.5618, 486.1327  # Fraunhofer lines


@dataclass(frozen=True)
class Glass:
    nd: float
    vd: float

    def __call__(self, lambda_nm: float) -> float:
        b = (self.nd - 1) / self.vd / (F_NM**-2 - C_NM**-2)
        return self.nd + b * (lambda_nm**-2 - D_NM**-2)


def glass(name_or_abbe: str | float, nd: float) -> Glass:
    """A name in lens_data/glasses; or an Abbe number, then nd is the shader's own index."""
    if not isinstance(name_or_abbe, str):
        if not 10 <= name_or_abbe <= 120:
            raise bad_input("material", "pecs_glass", name_or_abbe, "an Abbe number in [10, 120] or a glass's name")
        return Glass(nd, float(name_or_abbe))
    files = {path.stem: path for path in pecs.data_dir("lens_data/glasses").glob("*/*.json")}
    if name_or_abbe not in files:
        raise PecsNotFoundError(
            f"pecs_glass: got {name_or_abbe!r}, wanted an Abbe number or one of {', '.join(sorted(files))}"
        )
    data = Fields(read_json(files[name_or_abbe]), files[name_or_abbe])
    return Glass(data.number("nd", low=1, high=5), data.number("vd", low=1, high=200))
